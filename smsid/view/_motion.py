"""What a replay plays: configurations at evenly spaced times, from a simulation or a recording."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid._short_repr import short_repr
from smsid.errors import SmsidError
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.simulate.trajectory import States, Trajectory

logger = logging.getLogger(__name__)

Source = Trajectory | States | Recording


@short_repr
@dataclass(frozen=True)
class DrawnMotion:
    """Configurations q (N, nq) at evenly spaced times (N,) [s], and the thrust (N, 3) in body axes [N].

    ``notes`` says what the source did not tell and what therefore stays at rest. ``v`` (N, nv) are velocities
    (body axes first), ``torque`` (N, 3) acts on the bus in body axes, ``joint_torque`` (N, joints) and
    ``wheel_torque`` (N, wheels) at the joints [N m]; ``None`` where nothing is known of them. ``smoothed``:
    time [s] over which momenta of it are averaged, as its velocities are measured.
    """

    time: np.ndarray
    q: np.ndarray
    force: np.ndarray
    notes: tuple[str, ...] = ()
    v: np.ndarray | None = None
    torque: np.ndarray | None = None
    joint_torque: np.ndarray | None = None
    wheel_torque: np.ndarray | None = None
    smoothed: float = 0.0


def motion_of(
    model: SpacecraftModel, source: Source, step: float, max_frames: int, *, times: np.ndarray | None = None
) -> DrawnMotion:
    """Return the motion sampled every ``step`` [s], or coarser when that makes more than ``max_frames``.

    With ``times`` (N,) [s] it is sampled then; before its start and after its end it stands still.

    Raises `RecordingError` when a recording tells nothing of the motion, or its clocks do not overlap, and
    `SmsidError` for states that do not fit the model.
    """
    if not step > 0.0 or max_frames < 2:
        raise SmsidError("Frame rate and speed must be positive, and a replay has two frames or more.")
    if isinstance(source, Recording):
        from smsid.view._recorded import recorded_motion

        return recorded_motion(model, source, step, max_frames, times)
    if isinstance(source, Trajectory):
        wanted = grid(source.start, source.stop, step, max_frames) if times is None else times
        found = source.states(np.clip(wanted, source.start, source.stop))
    else:
        found = source
    if found.q.ndim != 2 or found.q.shape[1] != model.nq or not len(found.time):
        raise SmsidError(
            f"States of shape {found.q.shape} do not fit the spacecraft, whose q has {model.nq} entries.",
            advice="Replay with the model that was simulated.",
        )
    if times is None:
        times = grid(float(found.time[0]), float(found.time[-1]), step, max_frames)
    tau = found.tau + found.reaction

    def at(values: np.ndarray) -> np.ndarray:
        return interpolate(found.time, values, times)

    force = found.tau[:, :3] if model.free else np.zeros((len(found.time), 3))
    torque = tau[:, 3:6] - np.cross(model.thrust_point, force) if model.free else np.zeros_like(force)
    return DrawnMotion(
        times,
        _configurations_at(model, found, times),
        at(force),
        v=at(found.v),
        torque=at(torque),
        joint_torque=at(tau[:, model.arm_joints.v]),
        wheel_torque=at(tau[:, model.wheels.v]),
    )


def grid(start: float, stop: float, step: float, max_frames: int) -> np.ndarray:
    """Return the times (N,) [s] of the frames."""
    count = max(2, int(np.floor((stop - start) / step + 1e-9)) + 1)
    if count > max_frames:
        logger.info("%d frames would be too many: one every %.3g s", count, (stop - start) / (max_frames - 1))
        return np.linspace(start, stop, max_frames)
    return start + step * np.arange(count) if stop > start else np.array([start])


def _configurations_at(model: SpacecraftModel, states: States, times: np.ndarray) -> np.ndarray:
    t = states.time
    if len(t) == len(times) and np.array_equal(t, np.clip(times, t[0], t[-1])):
        return states.q
    if len(t) < 2:
        return np.repeat(states.q, len(times), axis=0)
    k = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
    part = np.clip((times - t[k]) / (t[k + 1] - t[k]), 0.0, 1.0)
    pairs = zip(states.q[k], states.q[k + 1], part, strict=True)
    return np.array([pin.interpolate(model.pin, a, b, float(u)) for a, b, u in pairs])


def interpolate(t: np.ndarray, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return values (N, ...) known at t (N,) at other times, linearly; held past the ends."""
    columns = values.reshape(len(t), -1).T
    shape = (len(times), *values.shape[1:])
    if not len(columns):
        return np.zeros(shape)
    return np.stack([np.interp(times, t, c) for c in columns], axis=-1).reshape(shape)
