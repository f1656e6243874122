"""The rigid free-flyer in MuJoCo, and its fit by `mujoco.sysid`."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout
from scipy.spatial.transform import Rotation

from smsid.recording import Recording

STEP, DURATION = 0.01, 30.0
TIMES = np.arange(round(DURATION / STEP) + 1) * STEP
POINT = (0.5, 1.5, 0.6)
TRUTH = (2000.0, np.array([0.1, 0.05, -0.08]), np.array([1500.0, 1300.0, 1700.0, 30.0, -50.0, 20.0]))
THETA = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
CHANNELS = {
    "pose.position": slice(0, 3),
    "pose.attitude": slice(3, 7),
    "pose.velocity": slice(7, 10),
    "imu.angular_rate": slice(10, 13),
    "imu.acceleration": slice(13, 16),
}
KINDS = ("held", "free")

XML = """<mujoco><compiler autolimits="false" inertiafromgeom="false"/>
<option gravity="0 0 0" integrator="RK4" timestep="{step}">
<flag contact="disable" constraint="disable"/></option>
<worldbody><body name="bus">{joints}<inertial mass="{mass}" pos="{centre}" fullinertia="{inertia}"/>
<site name="origin"/><site name="p" pos="{point}"/></body></worldbody>
<actuator>{motors}</actuator>
<sensor><framepos name="position" objtype="site" objname="p"/>
<framequat name="attitude" objtype="site" objname="p"/>
<framelinvel name="velocity" objtype="site" objname="p"/><gyro name="rate" site="p"/>
<accelerometer name="acceleration" site="p"/></sensor></mujoco>"""


def text(values: Any) -> str:
    return " ".join(repr(float(x)) for x in np.ravel(values))


def xml(kind: str, values: tuple[float, np.ndarray, np.ndarray], step: float = STEP) -> str:
    """The free-flyer; "held": it cannot turn, and is pushed; "free": it is turned."""
    axes = np.eye(3)
    slides = "".join(f'<joint name="s{k}" type="slide" axis="{text(axes[k])}"/>' for k in range(3))
    gear = [np.r_[axes[k], 0, 0, 0] if kind == "held" else np.r_[0, 0, 0, axes[k]] for k in range(3)]
    return XML.format(
        step=step,
        joints=slides if kind == "held" else "<freejoint/>",
        mass=values[0],
        centre=text(values[1]),
        inertia=text(values[2]),
        point=text(POINT),
        motors="".join(f'<motor name="u{k}" site="origin" gear="{text(gear[k])}"/>' for k in range(3)),
    )


def drive(kind: str) -> np.ndarray:
    """Force [N] or torque [N m] (N, 3), constant for two seconds at a time."""
    rng = np.random.default_rng([5, KINDS.index(kind)])
    pushes = (40.0 if kind == "held" else 10.0) * rng.choice([-1.0, 1.0], (16, 3))
    return pushes[(np.floor(TIMES / 2.0 + 1e-9)).astype(int)]


@cache
def flown(kind: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Control (N, 3) and channels without noise, quaternions x y z w, computed at 1 ms."""
    fine = 10
    model = mujoco.MjModel.from_xml_string(xml(kind, TRUTH, STEP / fine))
    data, state = mujoco.MjData(model), mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.empty((1, mujoco.mj_stateSize(model, state)))
    mujoco.mj_getState(model, data, start[0], state)
    control = drive(kind)
    _, sensors = rollout.rollout(model, data, start, np.repeat(control, fine, axis=0)[None])
    seen = np.asarray(sensors)[0, ::fine]  # a reading belongs to the beginning of its step
    channels = {name: seen[:, part].copy() for name, part in CHANNELS.items()}
    channels["pose.attitude"] = channels["pose.attitude"][:, [1, 2, 3, 0]]
    return control, channels


def to_inertial(mass: float, centre: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Inertial parameters (10,) in the order of `THETA`, about the bus origin."""
    xx, yy, zz, xy, xz, yz = inertia
    full = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    full = full + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return ordered(mass, mass * centre, full)


def ordered(mass: float, moment: np.ndarray, full: np.ndarray) -> np.ndarray:
    return np.r_[mass, moment, full[0, 0], full[0, 1], full[1, 1], full[0, 2], full[1, 2], full[2, 2]]


def pseudo_inertia_fit(
    start: tuple[float, np.ndarray, np.ndarray],
    recordings: Mapping[str, Recording],
    sigma: Mapping[str, float],
) -> tuple[np.ndarray, dict[str, Any]]:
    """Fit by `mujoco.sysid`: parameters (10,) in the order of `THETA`, iterations and CPU s of rollouts."""
    from mujoco import sysid

    specs = {kind: mujoco.MjSpec.from_string(xml(kind, start)) for kind in KINDS}
    parameters = sysid.ParameterDict()
    inertia = sysid.body_inertia_param(
        specs["free"],
        specs["free"].compile(),
        "bus",
        inertia_type=sysid.InertiaType.Pseudo,
        modifier=_apply_inertia,
    )
    parameters.add(inertia)
    turn, spent = {}, [0.0]
    for kind in KINDS:
        first = recordings[kind]
        turn[kind] = Rotation.from_quat(first["pose.attitude"][0])
        at = first["pose.position"][0] - turn[kind].apply(POINT)
        for name, value, width in (
            ("position", at, 1.0),
            ("attitude", np.zeros(3), 0.1),
            ("imu.acceleration", np.zeros(3), 0.01),
            ("imu.angular_rate", np.zeros(3), 0.001),
        ):
            parameters.add(sysid.Parameter(f"{kind} {name}", value, value - width, value + width))

    def build(own: Any, spec: mujoco.MjSpec) -> mujoco.MjModel:
        model = sysid.apply_param_modifiers(own, spec)
        if model.nq == 3:  # held: where and how it stands is the body's place
            body = model.body("bus")
            body.pos[:] = own["held position"].value
            body.quat[:] = _quat(turn["held"], own["held attitude"].value)
        return model

    def roll(*, models: Sequence[Any], initial_states: Any, param_dicts: Sequence[Any], **rest: Any) -> Any:
        states = np.array(initial_states, dtype=float)
        if models[0].nq == 7:  # time, then qpos
            for state, own in zip(states, param_dicts, strict=True):
                state[1:4] = own["free position"].value
                state[4:8] = _quat(turn["free"], own["free attitude"].value)
        begin = time.process_time()
        found = sysid.sysid_rollout(models=models, initial_states=states, **rest)
        spent[0] += time.process_time() - begin
        return found

    def whitened(own: Any, predicted: Any, measured: Any, model: Any, *_: Any, **__: Any) -> Any:
        kind = "held" if model.nq == 3 else "free"
        seen, data = predicted.data, measured.data[: len(predicted.data)]  # readings one step earlier
        parts = []
        for name, part in CHANNELS.items():
            if name == "pose.attitude":
                p, m = (Rotation.from_quat(x[:, part][:, [1, 2, 3, 0]]) for x in (seen, data))
                off = (p.inv() * m).as_rotvec()
            else:
                key = f"{kind} {name}"
                off = data[:, part] - seen[:, part] - (own[key].value if key in own else 0.0)
            parts.append(off / sigma[name])
        return np.hstack(parts), predicted, predicted

    groups = []
    for kind in KINDS:
        model, r = specs[kind].compile(), recordings[kind]
        data = np.hstack([r[name] for name in CHANNELS])
        data[:, CHANNELS["pose.attitude"]] = r["pose.attitude"][:, [3, 0, 1, 2]]
        control = r["command.force" if kind == "held" else "command.torque"]
        mapping = sysid.TimeSeries.compute_all_sensor_mapping(model)
        groups.append(
            sysid.ModelSequences(
                kind,
                specs[kind],
                kind,
                sysid.create_initial_state(model, np.zeros(model.nq), np.zeros(model.nv)),
                sysid.TimeSeries(TIMES, np.array(control)),
                sysid.TimeSeries(TIMES, data, mapping),
            )
        )
    residual = sysid.build_residual_fn(
        models_sequences=groups,
        build_model=build,
        modify_residual=whitened,
        custom_rollout=roll,
        n_threads=1,
        resample_true=False,
    )
    calls = 0

    def counted(x: np.ndarray, own: Any, **rest: Any) -> Any:
        nonlocal calls
        calls += x.ndim == 2 and x.shape[1] > 1
        return residual(x, own, **rest)

    found, _ = sysid.optimize(parameters, counted, optimizer="mujoco", verbose=False)
    pi = sysid.model_modifier.pi_from_theta(found["bus_inertia"].value)
    theta = ordered(pi[0], pi[1:4], pi[4:].reshape(3, 3))
    return theta, {"iterations": float(calls), "rollouts": spent[0]}


def _apply_inertia(spec: Any, parameter: Any) -> None:
    """What sysid's own modifier does; the quaternion it leaves as NaN is one MuJoCo 4.0 refuses."""
    from mujoco import sysid

    sysid.apply_body_inertia(spec, "bus", parameter)
    spec.body("bus").iquat = [1.0, 0.0, 0.0, 0.0]


def _quat(turn: Rotation, more: np.ndarray) -> np.ndarray:
    return (turn * Rotation.from_rotvec(more)).as_quat()[[3, 0, 1, 2]]
