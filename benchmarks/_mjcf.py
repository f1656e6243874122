"""Any Pinocchio model as MJCF, and states and forces in MuJoCo's conventions.

MuJoCo's free joint has linear velocity and force in inertial axes, the angular ones in body axes.
MuJoCo wants mass and a proper inertia on every moving body. Where a body lacks them, some are lent from its
parent in a way that leaves the motion as it was: rotational inertia to a body that only slides, mass on the
axis and inertia across it to a body that only turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import pinocchio as pin

from smsid.model.assembly import move_parameters, parameters_to_matrix

LENT = 1e-6  # [kg], [kg m^2] what is lent to bodies that lack it


class UnsupportedError(Exception):
    """The model cannot be written as MJCF; the message says why."""


@dataclass(frozen=True)
class Twin:
    """A Pinocchio model in MuJoCo: maps of q and v, as indices into MuJoCo's qpos and qvel."""

    pin: pin.Model
    model: mujoco.MjModel
    data: mujoco.MjData
    dof: np.ndarray  # (nv,)

    def position(self, q: np.ndarray) -> np.ndarray:
        """Return qpos of q (nq,)."""
        out = np.zeros(self.model.nq)
        for j in range(1, self.pin.njoints):
            joint, at = self.pin.joints[j], q[self.pin.joints[j].idx_q :]
            k = self.model.jnt_qposadr[self._first(j)]
            if joint.nq == 7:
                out[k : k + 7] = *at[:3], at[6], *at[3:6]
            elif joint.nq == 2:
                out[k] = np.arctan2(at[1], at[0])
            else:
                out[k : k + joint.nq] = at[: joint.nq]
        return out

    def velocity(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return qvel of v (nv,)."""
        out = np.zeros(self.model.nv)
        out[self.dof] = v
        if self.pin.joints[1].nq == 7:
            out[:3] = _rotation(q) @ v[:3]
        return out

    def acceleration(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return qacc of a = vdot (nv,)."""
        if self.pin.joints[1].nq == 7:
            a = np.concatenate([a[:3] + np.cross(v[3:6], v[:3]), a[3:]])
        return self.velocity(q, a)

    def force(self, q: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Return generalised forces (nv,) in Pinocchio's order and axes from MuJoCo's."""
        out = force[self.dof]
        if self.pin.joints[1].nq == 7:
            out[:3] = _rotation(q).T @ force[:3]
        return out

    def state(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Return (q, v) in Pinocchio's order and axes; for joints whose coordinates are the same in both."""
        q = np.empty(self.pin.nq)
        for j in range(1, self.pin.njoints):
            joint, k = self.pin.joints[j], self.model.jnt_qposadr[self._first(j)]
            at = qpos[k : k + joint.nq]
            q[joint.idx_q : joint.idx_q + joint.nq] = (
                np.concatenate([at[:3], at[4:7], at[3:4]]) if joint.nq == 7 else at
            )
        return np.concatenate([q, self.force(q, qvel)])

    def _first(self, joint: int) -> int:
        return mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, f"{joint}.0")


def mujoco_twin(
    model: pin.Model, stiffness: np.ndarray | None = None, damping: np.ndarray | None = None
) -> Twin:
    """Return the model in MuJoCo, with springs and dampers (nv,) per degree of freedom.

    Raises `UnsupportedError` for joints without a counterpart or inertia that MuJoCo refuses.
    """
    try:
        mj = mujoco.MjModel.from_xml_string(write_mjcf(model, stiffness, damping))
    except ValueError as error:
        raise UnsupportedError(f"MuJoCo refuses the model: {error}") from error
    dof = np.empty(model.nv, dtype=int)
    for j in range(1, model.njoints):
        first = mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_JOINT, f"{j}.0")
        k = model.joints[j].idx_v
        dof[k : k + model.joints[j].nv] = mj.jnt_dofadr[first] + np.arange(model.joints[j].nv)
    return Twin(model, mj, mujoco.MjData(mj), dof)


def write_mjcf(
    model: pin.Model, stiffness: np.ndarray | None = None, damping: np.ndarray | None = None
) -> str:
    """Return the model as MJCF text; joint ``j`` of Pinocchio becomes ``j.0`` (``j.1``, ``j.2``)."""
    stiffness = np.zeros(model.nv) if stiffness is None else stiffness
    damping = np.zeros(model.nv) if damping is None else damping
    subspace = _subspaces(model)
    theta = _with_lent_inertia(model, subspace)
    children: dict[int, list[int]] = {j: [] for j in range(model.njoints)}
    for j in range(1, model.njoints):
        children[model.parents[j]].append(j)

    def body(j: int) -> str:
        place = model.jointPlacements[j]
        x, y, z, w = pin.Quaternion(place.rotation).coeffs()
        text = f'<body name="b{j}" pos="{_text(place.translation)}" quat="{_text([w, x, y, z])}">'
        k = model.joints[j].idx_v
        if model.joints[j].nq == 7:
            if not place.isIdentity(1e-15):
                raise UnsupportedError("A free joint away from the origin.")
            text += f'<freejoint name="{j}.0"/>'
        else:
            for i, column in enumerate(subspace[j].T):
                kind, axis = ("slide", column[:3]) if column[:3].any() else ("hinge", column[3:])
                text += (
                    f'<joint name="{j}.{i}" type="{kind}" axis="{_text(axis)}" '
                    f'stiffness="{float(stiffness[k + i])!r}" damping="{float(damping[k + i])!r}"/>'
                )
        return text + _inertial(theta[j]) + "".join(body(c) for c in children[j]) + "</body>\n"

    return (
        '<mujoco><compiler angle="radian" autolimits="false" inertiafromgeom="false" balanceinertia="false"/>'
        f'<option gravity="{_text(model.gravity.linear)}" integrator="RK4">'
        '<flag contact="disable" constraint="disable"/></option><worldbody>'
        + "".join(body(c) for c in children[0])
        + "</worldbody></mujoco>"
    )


def _subspaces(model: pin.Model) -> dict[int, np.ndarray]:
    """Motion subspace (6, nv) of every joint; raises for those that are not free, hinges or slides."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model), np.zeros(model.nv))
    found = {}
    for j in range(1, model.njoints):
        s = np.asarray(data.joints[j].S).reshape(6, -1)
        simple = s.shape[1] == 1 and not (s[:3].any() and s[3:].any())
        if not (simple or model.joints[j].nq == 7 or model.joints[j].shortname() == "JointModelTranslation"):
            raise UnsupportedError(f"Joint '{model.names[j]}' is a {model.joints[j].shortname()}.")
        found[j] = s
    return found


def _with_lent_inertia(model: pin.Model, subspace: dict[int, np.ndarray]) -> list[np.ndarray]:
    theta = [np.asarray(i.toDynamicParameters()) for i in model.inertias]
    for j in range(model.njoints - 1, 0, -1):
        about = parameters_to_matrix(_about_centre(theta[j])) if theta[j][0] > 0.0 else np.zeros((3, 3))
        if theta[j][0] > 0.0 and np.linalg.eigvalsh(about)[0] > 1e-9:
            continue
        column = subspace[j][:, 0]
        if column[:3].any():
            lent = np.array([0.0, 0, 0, 0, LENT, 0, LENT, 0, 0, LENT])
        else:
            axis = column[3:]
            spin = float(axis @ parameters_to_matrix(theta[j]) @ axis)
            across = max(spin / 2, LENT) * (np.eye(3) - np.outer(axis, axis))
            xx, xy, xz, _, yy, yz, _, _, zz = across.ravel()
            lent = np.array([LENT if theta[j][0] <= 0.0 else 0.0, 0, 0, 0, xx, xy, yy, xz, yz, zz])
        theta[j] = theta[j] + lent
        if model.parents[j]:
            theta[model.parents[j]] = theta[model.parents[j]] - move_parameters(
                model.jointPlacements[j], lent
            )
    return theta


def _about_centre(theta: np.ndarray) -> np.ndarray:
    centre = theta[1:4] / theta[0]
    return move_parameters(pin.SE3(np.eye(3), -centre), theta)


def _inertial(theta: np.ndarray) -> str:
    own = _about_centre(theta)
    xx, xy, yy, xz, yz, zz = own[4:]
    return (
        f'<inertial mass="{float(theta[0])!r}" pos="{_text(theta[1:4] / theta[0])}" '
        f'fullinertia="{_text([xx, yy, zz, xy, xz, yz])}"/>'
    )


def _rotation(q: np.ndarray) -> np.ndarray:
    return pin.Quaternion(*q[[6, 3, 4, 5]]).toRotationMatrix()


def _text(values: object) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))
