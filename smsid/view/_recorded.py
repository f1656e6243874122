"""The motion that a recording tells of, and what it leaves out."""

from __future__ import annotations

import logging

import numpy as np
import pinocchio as pin
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

from smsid.errors import RecordingError
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel, set_group_angles
from smsid.recording import Recording
from smsid.view._motion import DrawnMotion, grid, interpolate

logger = logging.getLogger(__name__)


def recorded_motion(
    model: SpacecraftModel, rec: Recording, step: float, max_frames: int, times: np.ndarray | None = None
) -> DrawnMotion:
    """Return the motion of a recording, every ``step`` [s] or at ``times`` (N,) [s].

    What it does not tell stays at rest and is named in the notes. Before its start and after its end it
    stands still.

    Raises `RecordingError` when it tells nothing of the motion, or its clocks do not overlap.
    """
    rec = order_columns(rec, model)
    found: dict[str, Samples] = {}
    lever, notes = np.zeros(3), []

    def look(role: str, what: str, kind: str, quantity: str) -> np.ndarray | None:
        place = measured_samples(model, rec, kind, quantity)
        if place is None:
            notes.append(f"{what} not recorded: drawn at rest")
            return None
        found[role] = place[0]
        return place[1]

    if model.free:
        place = look("position", "position", "pose", "position")
        lever = lever if place is None else place
        look("attitude", "attitude", "pose", "attitude")
    if len(model.arm_joints):
        look("joints", "joint angles", "encoder", "joint_position")
    if len(model.wheels):
        look("wheels", "wheel rates", "tachometer", "wheel_rate")
    for role, what, quantity, size in (
        ("slosh", "slosh", "slosh_position", model.slosh),
        ("modes", "deflection of appendages", "modal_position", model.modes),
    ):
        samples = hidden_coordinates(rec, quantity, together=role == "slosh")
        if len(size) and samples is None:
            notes.append(f"{what} not recorded: drawn at rest")
        elif len(size) and samples is not None:
            found[role] = samples
    if not found:
        raise RecordingError(
            "The recording tells nothing about the motion.",
            advice="It needs one of position, attitude, joint_position, wheel_rate, slosh_position, "
            "modal_position, from the sources that the description names.",
            channels=rec.channels,
        )
    start, stop = max(t[0] for t, _ in found.values()), min(t[-1] for t, _ in found.values())
    if start > stop:
        raise RecordingError("The clocks of the recording do not overlap.", advice="Check its times.")
    wanted = grid(float(start), float(stop), step, max_frames) if times is None else times
    at = np.clip(wanted, start, stop)
    q = _configurations(model, found, lever, at, notes)
    for note in notes:
        logger.warning("replay: %s", note)

    def applied(quantity: str, size: int) -> np.ndarray | None:
        samples = commanded_samples(rec, quantity)
        fits = samples is not None and samples[1].shape[1:] == (size,)
        return interpolate(*samples, at) if samples is not None and fits else None

    force = applied("force", 3)
    return DrawnMotion(
        wanted,
        q,
        np.zeros((len(at), 3)) if force is None else force,
        tuple(notes),
        v=recorded_velocity(model, rec, at, q),
        torque=applied("torque", 3),
        joint_torque=applied("joint_torque", len(model.arm_joints)),
        wheel_torque=applied("wheel_torque", len(model.wheels)),
        smoothed=SMOOTHED,
    )


def _configurations(
    model: SpacecraftModel, found: dict[str, Samples], lever: np.ndarray, times: np.ndarray, notes: list[str]
) -> np.ndarray:
    q = np.tile(model.home, (len(times), 1))

    def columns(role: str, count: int, what: str) -> np.ndarray | None:
        if role not in found:
            return None
        t, values = found[role]
        if values.shape[1] < count or (role == "joints" and values.shape[1] != count):
            notes.append(
                f"{what}: {values.shape[1]} columns recorded, the spacecraft has {count}: drawn at rest"
            )
            return None
        if role == "wheels":
            turned = np.cumsum(np.diff(t)[:, None] * (values[1:] + values[:-1]) / 2, axis=0)
            values = np.vstack([np.zeros(values.shape[1]), turned])
        return interpolate(t, values, times)[:, :count]

    if model.free:
        turn = Rotation.identity()
        if "attitude" in found:
            t, attitude = found["attitude"]
            turns = Rotation.from_quat(attitude)
            turn = Slerp(t, turns)(times) if len(t) > 1 else turns[0]
            q[:, 3:7] = turn.as_quat()
        if "position" in found:
            q[:, :3] = interpolate(*found["position"], times) - turn.apply(lever)
    groups = (("joints", model.arm_joints, "joint angles"), ("wheels", model.wheels, "wheel rates"))
    for role, group, what in groups:
        angles = columns(role, len(group), what)
        if angles is not None:
            q = set_group_angles(group, q, angles)
    slosh = columns("slosh", 3 * len(model.slosh), "slosh")
    if slosh is not None:
        for k, joint in enumerate(model.slosh):
            q[:, joint.q] = slosh[:, 3 * k : 3 * k + 3]
    modes = columns("modes", len(model.modes), "deflection of appendages")
    if modes is not None:
        q[:, model.modes.q] = modes / model.mode_scale
    return q


Samples = tuple[np.ndarray, np.ndarray]
"""Times (N,) [s] and values (N, ...)."""


def channel(recording: Recording, name: str) -> Samples:
    """Return time and values of a channel, samples that are not finite left out.

    Raises `RecordingError` when there is no finite sample.
    """
    t, values = recording.time(name), recording[name]
    good = np.isfinite(values.reshape(len(t), -1)).all(axis=1) & np.isfinite(t)
    if not good.any():
        raise RecordingError(
            f"'{name}' has no finite sample.", advice="Leave it out or mend it.", channel=name
        )
    return np.asarray(t[good]), np.asarray(values[good])


def measured_samples(
    model: SpacecraftModel, recording: Recording, kind: str, quantity: str
) -> tuple[Samples, np.ndarray] | None:
    """Return the samples of a quantity and where (3,) [m] its source, the first of a kind that has it, sits.

    A source of the kind's name that is no sensor of the description sits at the bus's origin.
    """
    places = {s.name: np.asarray(s.position) for s in model.description.sensor if s.kind == kind}
    if all(s.name != kind for s in model.description.sensor):
        places[kind] = np.zeros(3)
    for name, position in places.items():
        if f"{name}.{quantity}" in recording:
            return channel(recording, f"{name}.{quantity}"), position
    return None


def commanded_samples(recording: Recording, quantity: str) -> Samples | None:
    """Return the samples of a force or torque: what was commanded, else what any source has of it."""
    names = [f"command.{quantity}", *(c for c in recording.channels if c.endswith(f".{quantity}"))]
    return next((channel(recording, n) for n in names if n in recording), None)


def hidden_coordinates(recording: Recording, quantity: str, *, together: bool) -> Samples | None:
    """Return slosh or modal coordinates (N, columns), of the truth first; None if not recorded.

    Several tanks may have a channel each (``together``); several sources of modes tell the same.
    """
    names = [c for c in recording.channels if c.endswith(f".{quantity}")]
    if not names:
        return None
    names.sort(key=lambda c: not c.startswith("truth."))
    t, values = channel(recording, names[0])
    same = names if together else [n for n in names if n.split(".")[0] == names[0].split(".")[0]]
    columns = [values.reshape(len(t), -1)]
    columns += [interpolate(*channel(recording, n), t).reshape(len(t), -1) for n in same[1:]]
    return t, np.concatenate(columns, axis=1)


SMOOTHED = 0.5  # [s] over which slopes are averaged: a rate differentiated from noisy samples is noise


def slopes(model: SpacecraftModel, times: np.ndarray, q: np.ndarray, smoothed: float = 0.0) -> np.ndarray:
    """Return velocities (N, nv) of configurations q (N, nq) at times (N,) [s], by central differences."""
    if len(times) < 2 or times[-1] <= times[0]:
        return np.zeros((len(times), model.nv))
    before, after = np.maximum(np.arange(len(q)) - 1, 0), np.minimum(np.arange(len(q)) + 1, len(q) - 1)
    step = times[after] - times[before]
    pairs = zip(q[before], q[after], strict=True)
    v = (
        np.array([pin.difference(model.pin, a, b) for a, b in pairs])
        / np.where(step > 0.0, step, np.inf)[:, None]
    )
    width = round(smoothed / float(np.median(np.diff(times))))
    return uniform_filter1d(v, width, axis=0, mode="nearest") if width > 1 else v


def recorded_velocity(
    model: SpacecraftModel, recording: Recording, times: np.ndarray, q: np.ndarray
) -> np.ndarray:
    """Return velocities (N, nv) at times (N,) [s] of configurations q (N, nq), body axes first.

    Rates of the bus, joints, wheels, slosh and modes are taken from their channels; the rest is the slope of
    q, smoothed.
    """
    v = slopes(model, times, q, SMOOTHED)

    def put(found: Samples | None, index: np.ndarray | slice, factor: np.ndarray | float = 1.0) -> None:
        if found is not None and found[1].shape[1:] == v[0, index].shape:
            v[:, index] = interpolate(*found, times) * factor

    def measured(kind: str, quantity: str) -> Samples | None:
        found = measured_samples(model, recording, kind, quantity)
        return None if found is None else found[0]

    if model.free:
        put(measured("imu", "angular_rate"), slice(3, 6))
        velocity = measured_samples(model, recording, "pose", "velocity")
        if velocity is not None:
            samples, lever = velocity
            turn = Rotation.from_quat(q[:, 3:7])
            v[:, :3] = turn.inv().apply(interpolate(*samples, times)) - np.cross(v[:, 3:6], lever)
    put(measured("encoder", "joint_velocity"), model.arm_joints.v)
    put(measured("tachometer", "wheel_rate"), model.wheels.v)
    put(
        hidden_coordinates(recording, "modal_velocity", together=False), model.modes.v, 1.0 / model.mode_scale
    )
    columns = np.concatenate([np.arange(s.v.start, s.v.stop) for s in model.slosh] or [np.zeros(0)])
    put(hidden_coordinates(recording, "slosh_velocity", together=True), columns.astype(int))
    return v
