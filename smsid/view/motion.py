"""What a replay plays: configurations at evenly spaced times, from a simulation or a recording."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation, Slerp

from smsid.errors import RecordingError, SmsidError
from smsid.model.spacecraft import SpacecraftModel, set_group_angles
from smsid.recording import Recording
from smsid.sensing.sensor import Sensor
from smsid.simulate.trajectory import States, Trajectory

logger = logging.getLogger(__name__)

Source = Trajectory | States | Recording


@dataclass(frozen=True)
class Motion:
    """Configurations q (N, nq) at evenly spaced times (N,) [s], and the thrust (N, 3) in body axes [N].

    ``notes`` says what the source did not tell and what therefore stays at rest.
    """

    time: np.ndarray
    q: np.ndarray
    force: np.ndarray
    notes: tuple[str, ...] = ()


def motion_of(model: SpacecraftModel, source: Source, step: float, max_frames: int) -> Motion:
    """Return the motion sampled every ``step`` [s], or coarser when that makes more than ``max_frames``.

    Raises `RecordingError` when a recording tells nothing of the motion, or its clocks do not overlap, and
    `SmsidError` for states that do not fit the model.
    """
    if not step > 0.0 or max_frames < 2:
        raise SmsidError("Frame rate and speed must be positive, and a replay has two frames or more.")
    if isinstance(source, Recording):
        return _from_recording(model, source, step, max_frames)
    if isinstance(source, Trajectory):
        times = _grid(source.start, source.stop, step, max_frames)
        source = source.states(times)
    if source.q.ndim != 2 or source.q.shape[1] != model.nq or not len(source.time):
        raise SmsidError(
            f"States of shape {source.q.shape} do not fit the spacecraft, whose q has {model.nq} entries.",
            advice="Replay with the model that was simulated.",
        )
    times = _grid(float(source.time[0]), float(source.time[-1]), step, max_frames)
    force = source.tau[:, :3] if model.free else np.zeros((len(source.time), 3))
    return Motion(times, _between(model, source, times), _interpolated(source.time, force, times))


def _grid(start: float, stop: float, step: float, max_frames: int) -> np.ndarray:
    count = max(2, int(np.floor((stop - start) / step + 1e-9)) + 1)
    if count > max_frames:
        logger.info("%d frames would be too many: one every %.3g s", count, (stop - start) / (max_frames - 1))
        return np.linspace(start, stop, max_frames)
    return start + step * np.arange(count) if stop > start else np.array([start])


def _between(model: SpacecraftModel, states: States, times: np.ndarray) -> np.ndarray:
    t = states.time
    if len(t) == len(times) and np.array_equal(t, times):
        return states.q
    if len(t) < 2:
        return np.repeat(states.q, len(times), axis=0)
    k = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
    part = np.clip((times - t[k]) / (t[k + 1] - t[k]), 0.0, 1.0)
    pairs = zip(states.q[k], states.q[k + 1], part, strict=True)
    return np.array([pin.interpolate(model.pin, a, b, float(u)) for a, b, u in pairs])


def _interpolated(t: np.ndarray, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    columns = values.reshape(len(t), -1).T
    return np.stack([np.interp(times, t, c) for c in columns], axis=-1).reshape(len(times), *values.shape[1:])


def _channel(recording: Recording, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return time and values of a channel, samples that are not finite left out."""
    t, values = recording.time(name), recording[name]
    good = np.isfinite(values.reshape(len(t), -1)).all(axis=1) & np.isfinite(t)
    if not good.any():
        raise RecordingError(
            f"'{name}' has no finite sample.", advice="Leave it out or mend it.", channel=name
        )
    return np.asarray(t[good]), np.asarray(values[good])


def _sources(model: SpacecraftModel, kind: str, default: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield names and positions (3,) of the sensors that may have recorded a quantity."""
    sensors: tuple[Sensor, ...] = model.description.sensor
    for sensor in sensors:
        if sensor.kind == kind:
            yield sensor.name, np.asarray(sensor.position)
    if all(sensor.name != default for sensor in sensors):
        yield default, np.zeros(3)


def _from_recording(model: SpacecraftModel, rec: Recording, step: float, max_frames: int) -> Motion:
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    lever, notes = np.zeros(3), []

    def look(role: str, kind: str, default: str, quantity: str) -> np.ndarray | None:
        for name, position in _sources(model, kind, default):
            if f"{name}.{quantity}" in rec:
                found[role] = _channel(rec, f"{name}.{quantity}")
                return position
        return None

    def missing(what: str) -> None:
        notes.append(f"{what} not recorded: drawn at rest")

    if model.free:
        place = look("position", "pose", "pose", "position")
        lever = lever if place is None else place
        if place is None:
            missing("position")
        if look("attitude", "pose", "pose", "attitude") is None:
            missing("attitude")
    if len(model.arm_joints) and look("joints", "encoder", "encoder", "joint_position") is None:
        missing("joint angles")
    if len(model.wheels) and look("wheels", "tachometer", "tachometer", "wheel_rate") is None:
        missing("wheel rates")
    for role, quantity, size in (
        ("slosh", "slosh_position", model.slosh),
        ("modes", "modal_position", model.modes),
    ):
        names = [c for c in rec.channels if c.endswith(f".{quantity}")]
        if len(size) and not names:
            missing("slosh" if role == "slosh" else "deflection of appendages")
        elif len(size):
            found[role] = _hidden(rec, sorted(names, key=lambda c: not c.startswith("truth.")), role)
    if not found:
        raise RecordingError(
            "The recording tells nothing about the motion.",
            advice="It needs one of position, attitude, joint_position, wheel_rate, slosh_position, "
            "modal_position, from the sources that the description names.",
            channels=rec.channels,
        )
    forces = [c for c in ("command.force", *rec.channels) if c.endswith(".force") and c in rec]
    if forces:
        found["force"] = _channel(rec, forces[0])
    motion = [t for role, (t, _) in found.items() if role != "force"]
    start, stop = max(t[0] for t in motion), min(t[-1] for t in motion)
    if start > stop:
        raise RecordingError("The clocks of the recording do not overlap.", advice="Check its times.")
    times = _grid(float(start), float(stop), step, max_frames)
    q = _configurations(model, found, lever, times, notes)
    force = _interpolated(*found["force"], times) if "force" in found else np.zeros((len(times), 3))
    for note in notes:
        logger.warning("replay: %s", note)
    return Motion(times, q, force, tuple(notes))


def _hidden(rec: Recording, names: list[str], role: str) -> tuple[np.ndarray, np.ndarray]:
    """Return time and values (N, columns) of slosh or modes; several tanks may have a channel each."""
    t, values = _channel(rec, names[0])
    same = [n for n in names if n.split(".")[0] == names[0].split(".")[0]] if role == "modes" else names
    columns = [values.reshape(len(t), -1)]
    columns += [_interpolated(*_channel(rec, n), t).reshape(len(t), -1) for n in same[1:]]
    return t, np.concatenate(columns, axis=1)


def _configurations(
    model: SpacecraftModel,
    found: dict[str, tuple[np.ndarray, np.ndarray]],
    lever: np.ndarray,
    times: np.ndarray,
    notes: list[str],
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
        return _interpolated(t, values, times)[:, :count]

    if model.free:
        turn = Rotation.identity()
        if "attitude" in found:
            t, attitude = found["attitude"]
            turn = (
                Slerp(t, Rotation.from_quat(attitude))(times)
                if len(t) > 1
                else Rotation.from_quat(attitude[0])
            )
            q[:, 3:7] = turn.as_quat()
        if "position" in found:
            q[:, :3] = _interpolated(*found["position"], times) - turn.apply(lever)
    joints = columns("joints", len(model.arm_joints), "joint angles")
    if joints is not None:
        q = np.array(
            [set_group_angles(model.pin, model.arm_joints, a, b) for a, b in zip(q, joints, strict=True)]
        )
    wheels = columns("wheels", len(model.wheels), "wheel rates")
    if wheels is not None:
        q = np.array(
            [set_group_angles(model.pin, model.wheels, a, b) for a, b in zip(q, wheels, strict=True)]
        )
    slosh = columns("slosh", 3 * len(model.slosh), "slosh")
    if slosh is not None:
        for k, joint in enumerate(model.slosh):
            q[:, joint.q] = slosh[:, 3 * k : 3 * k + 3]
    modes = columns("modes", len(model.modes), "deflection of appendages")
    if modes is not None:
        q[:, model.modes.q] = modes / model.mode_scale
    return q
