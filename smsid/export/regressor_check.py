"""How accurate the regressors of a machine are, and how long they take."""

from __future__ import annotations

import importlib.util
import time
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.errors import SmsidError
from smsid.export._mjcf import joint_name, write_mjcf
from smsid.model.identifiable import BaseParameters, base_parameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel

ROUNDS = 5  # of which the median is told
STATES_OF_RANK = 50  # random states, at least, that base parameters are told by: fewer give too low a rank


@dataclass(frozen=True)
class RegressorCheck:
    """What was found at random states.

    ``errors``: worst error by quantity and source, relative to the largest value. ``base``: of the torque
    regressor; its ``condition`` is that of the columns kept, each of unit length. ``microseconds`` per state,
    median, by regressor. ``not_compared``: why an engine is missing.
    """

    states: int
    errors: dict[str, float]
    base: BaseParameters
    parameters: int
    microseconds: dict[str, float]
    not_compared: tuple[str, ...] = ()


def check_regressor(model: SpacecraftModel, rng: np.random.Generator, *, states: int = 50) -> RegressorCheck:
    """Compare momentum and torque regressors with what engines and identities say, at random states.

    Pinocchio's centroidal momentum and inverse dynamics; MuJoCo's inverse dynamics of the exported model,
    where it is installed; and for every parameter by itself, that v'Y(v) is twice the kinetic energy of a
    body that has that parameter alone. Base parameters are those of `STATES_OF_RANK` states at least.

    Raises `DescriptionError` for a model that cannot be written for MuJoCo.
    """
    p = model.pin

    def drawn(count: int) -> list[tuple[np.ndarray, ...]]:
        return [
            (pin.integrate(p, pin.neutral(p), rng.uniform(-1.5, 1.5, p.nv)), *rng.normal(size=(2, p.nv)))
            for _ in range(count)
        ]

    samples = drawn(states)
    q, v, a = (np.array(x) for x in zip(*samples, strict=True))
    regressor = Regressor(model)
    theta = regressor.parameters
    generalised = torque = np.zeros(0)
    regressor.torque(q, v, a)  # the first call is slower
    rounds = []
    for _ in range(ROUNDS):
        started = time.perf_counter()
        generalised = regressor.generalised_momentum(q, v)
        middle = time.perf_counter()
        torque = regressor.torque(q, v, a)
        rounds.append((middle - started, time.perf_counter() - middle))
    seconds = np.median(rounds, axis=0).tolist()
    data = p.createData()
    errors = {
        "torque, Pinocchio rnea": _worst(
            torque @ theta, np.array([pin.rnea(p, data, *x) for x in samples], dtype=float)
        ),
        "kinetic energy, every parameter alone": _energy_error(p, generalised, q, v),
    }
    if model.free:
        direct = []
        for q_i, v_i in zip(q, v, strict=True):
            h = pin.computeCentroidalMomentum(p, data, q_i, v_i)
            bus, com = data.oMi[1], data.com[0]
            angular = h.angular + np.cross(com - bus.translation, h.linear)
            direct.append(np.r_[bus.rotation.T @ h.linear, bus.rotation.T @ angular])
        errors["momentum, Pinocchio centroidal"] = _worst(generalised[:, :6] @ theta, np.array(direct))
    missing = []
    if importlib.util.find_spec("mujoco") is None:
        missing.append("MuJoCo is not installed: pip install mujoco")
    else:
        try:
            xml = write_mjcf(model)
        except SmsidError as error:
            missing.append(f"MuJoCo: {error.message}")
        else:
            errors["torque, MuJoCo inverse"] = _worst(torque @ theta, mujoco_torques(model, xml, q, v, a))
    rows = torque.reshape(-1, regressor.columns)
    if states < STATES_OF_RANK:
        more = (np.array(x) for x in zip(*drawn(STATES_OF_RANK - states), strict=True))
        rows = np.vstack([rows, regressor.torque(*more).reshape(-1, regressor.columns)])
    base = base_parameters(rows, regressor.names, regressor.units)
    return RegressorCheck(
        states,
        errors,
        base,
        regressor.columns,
        {name: 1e6 * s / states for name, s in zip(("momentum", "torque"), seconds, strict=True)},
        tuple(missing),
    )


def _worst(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(found - expected).max() / max(np.abs(expected).max(), 1e-300))


def _energy_error(p: pin.Model, rows: np.ndarray, q: np.ndarray, v: np.ndarray) -> float:
    """Worst difference of v'Y(v) from V' I V, body by body, I linear in its ten parameters."""
    data = p.createData()
    expected = np.empty((len(q), 10 * (p.njoints - 1)))
    for i in range(len(q)):
        pin.forwardKinematics(p, data, q[i], v[i])
        for j in range(1, p.njoints):
            x, w = data.v[j].linear, data.v[j].angular
            cross = 2.0 * np.cross(x, w)
            squares = [w[0] ** 2, 2 * w[0] * w[1], w[1] ** 2, 2 * w[0] * w[2], 2 * w[1] * w[2], w[2] ** 2]
            expected[i, 10 * (j - 1) : 10 * j] = [x @ x, *cross, *squares]
    return _worst(np.einsum("ni,nik->nk", v, rows), expected)


def mujoco_torques(
    model: SpacecraftModel, xml: str, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> np.ndarray:
    """Return MuJoCo's inverse dynamics (N, nv) of an exported model, without friction, springs, limits and
    forces that keep followers with their leaders.

    Args:
        model: with Pinocchio's order and axes.
        xml: the MJCF that `write_mjcf` made of it.
        q: configurations (N, nq).
        v: rates (N, nv).
        a: accelerations (N, nv).
    """
    import mujoco

    engine = mujoco.MjModel.from_xml_string(xml)
    engine.dof_damping[:], engine.dof_frictionloss[:], engine.jnt_stiffness[:] = 0.0, 0.0, 0.0
    engine.jnt_limited[:] = 0
    off = mujoco.mjtDisableBit
    engine.opt.disableflags |= int(off.mjDSBL_CONTACT) | int(off.mjDSBL_EQUALITY)
    state = mujoco.MjData(engine)
    p, out, turn = model.pin, np.empty_like(v), np.eye(3)
    free = [j for j in range(1, p.njoints) if p.joints[j].nq == 7]
    single = [  # joint, which of its coordinates, MuJoCo's joint
        (p.joints[j], i, engine.joint(joint_name(p, j, i)))
        for j in range(1, p.njoints)
        if j not in free
        for i in range(p.joints[j].nv)
    ]
    for n in range(len(q)):
        # the root, with linear velocity in inertial axes and the scalar of the quaternion first
        for j in free:
            iq, iv, here = p.joints[j].idx_q, p.joints[j].idx_v, engine.joint(p.names[j])
            at, dof = int(here.qposadr[0]), int(here.dofadr[0])
            turn = pin.Quaternion(q[n, iq + 3 : iq + 7]).toRotationMatrix()
            state.qpos[at : at + 7] = q[n, [iq, iq + 1, iq + 2, iq + 6, iq + 3, iq + 4, iq + 5]]
            x, w = v[n, iv : iv + 3], v[n, iv + 3 : iv + 6]
            state.qvel[dof : dof + 6] = [*(turn @ x), *w]
            linear = turn @ (a[n, iv : iv + 3] + np.cross(w, x))
            state.qacc[dof : dof + 6] = [*linear, *a[n, iv + 3 : iv + 6]]
        for joint, i, here in single:
            iq, iv, dof = joint.idx_q, joint.idx_v + i, int(here.dofadr[0])
            angle = np.arctan2(q[n, iq + 1], q[n, iq]) if joint.nq > joint.nv else q[n, iq + i]
            state.qpos[int(here.qposadr[0])] = angle
            state.qvel[dof], state.qacc[dof] = v[n, iv], a[n, iv]
        mujoco.mj_inverse(engine, state)
        for j in free:
            iv, dof = p.joints[j].idx_v, int(engine.joint(p.names[j]).dofadr[0])
            force = state.qfrc_inverse[dof : dof + 6]
            out[n, iv : iv + 6] = [*(turn.T @ force[:3]), *force[3:]]
        for joint, i, here in single:
            out[n, joint.idx_v + i] = state.qfrc_inverse[int(here.dofadr[0])]
    return out
