"""The motion of an arm in a recording, smoothed, at the instants its torques were measured."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid.arm._smoothing import LEAST, JointSamples, SmoothJoint, smooth_joint
from smsid.arm.readings import JointReadings, joint_readings
from smsid.errors import NotIdentifiableError, RecordingError
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

CELLS = 8.0
"""Instants per period of the lowest cutoff; torques between them are averaged."""

FEWEST = 2400
"""Instants that are kept at least, if there are as many samples."""

STILL_SIGMAS = 10.0
"""Standard deviations of an encoder's noise that a joint must move by to have moved."""


@short_repr
@dataclass(frozen=True)
class SmoothMotion:
    """Joint motion and torque at N instants, in the model's order of joints.

    Where torques are sampled far more often than the motion asks for, an instant has what its neighbours say
    of its torque, without the curvature that their mean has.

    ``time`` (N,) [s], ``q`` (N, nq) configuration, ``v``, ``a`` (N, nv) rates and accelerations [rad/s | m/s,
    per s], ``torque`` (N, nv) [N m | N], ``stretch`` (N,) number of the stretch without gaps. ``joints``
    say how well the motion is known. ``temperature`` (N, nv) [degC] where it was measured.
    """

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    torque: np.ndarray
    stretch: np.ndarray
    joints: tuple[SmoothJoint, ...]
    readings: JointReadings
    temperature: np.ndarray | None = None

    @property
    def rate_sigma(self) -> np.ndarray:
        """Standard deviations (nv,) of the rates."""
        return np.array([j.sigma[1] for j in self.joints])

    @property
    def step(self) -> float:
        """Time between two samples [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def bounds(self) -> list[tuple[int, int]]:
        """The first sample of every stretch without gaps, and the one after its last."""
        edges = np.flatnonzero(np.diff(self.stretch)) + 1
        return list(itertools.pairwise([0, *edges.tolist(), len(self.time)]))

    def blocks(self, length: int) -> np.ndarray:
        """Return where blocks of ``length`` samples begin (B,).

        None holds a gap, and short ones are the last of their stretch.
        """
        return np.concatenate([np.arange(a, max(b - length // 2, a + 1), length) for a, b in self.bounds])


def smooth_motion(model: SpacecraftModel, recording: Recording) -> SmoothMotion:
    """Smooth the angles of a recording, with its measured rates; return motion where torque was measured.

    Cutoffs and noise are found for each joint by itself, see `smooth_joint`. The ends of every stretch, where
    the motion is known less well, are left out.

    Args:
        model: a welded arm.
        recording: see `joint_readings`; any clock, with jitter and gaps.

    Raises:
        RecordingError: as `joint_readings`, or stretches are too short.
        NotIdentifiableError: no joint moves.
        DescriptionError: the gears do not fit.
    """
    readings = joint_readings(model, recording)
    pieces = [s for s in readings.stretches if s.stop - s.start >= LEAST]
    if not pieces:
        raise RecordingError("All stretches without gaps are too short.", advice="Record without gaps.")
    joints = tuple(
        smooth_joint([_samples(readings, s, k) for s in pieces]) for k in range(readings.position.shape[1])
    )
    _require_motion(model, readings, joints)
    edge = max(j.edge for j in joints)
    step = float(np.median(np.diff(readings.torque_time)))
    cell = int(1.0 / (CELLS * min(j.cutoff for j in joints) * step))
    cell = max(1, min(cell, readings.torque_time.size // FEWEST))
    chosen: list[tuple[np.ndarray, int]] = []
    for number, s in enumerate(pieces):
        start, end = readings.position_time[s][[0, -1]]
        inner = min(edge, 0.1 * (end - start))
        inside = (readings.torque_time >= start + inner) & (readings.torque_time <= end - inner)
        index = np.flatnonzero(inside)
        chosen.append((index[: index.size // cell * cell].reshape(-1, cell), number))
    count = sum(i.size for i, _ in chosen)
    if count < 50:
        raise RecordingError(
            f"{count} torque samples lie within the motion.", advice="Do both clocks start together?"
        )
    times = [readings.torque_time[i].mean(axis=1) for i, _ in chosen]
    numbers = [n for _, n in chosen]
    values = [
        np.column_stack([
            np.concatenate([j.splines[n](t, nu=d) for t, n in zip(times, numbers, strict=True)])
            for j in joints
        ])
        for d in range(3)
    ]  # fmt: skip
    time = np.concatenate(times)
    return SmoothMotion(
        time,
        model.set_joint_angles(model.home, values[0]),
        values[1],
        values[2],
        np.concatenate([_at_centres(readings.torque[i]) for i, _ in chosen]),
        np.repeat(numbers, [t.size for t in times]),
        joints,
        readings,
        readings.temperature_at(time),
    )


def _at_centres(samples: np.ndarray) -> np.ndarray:
    """Return values (N, joints) at the centres of cells of samples (N, cell, joints): their means, less what
    a parabola through three neighbouring means has its own mean above its centre.
    """
    means = samples.mean(axis=1)
    share = (1.0 - 1.0 / samples.shape[1] ** 2) / 24.0
    means[1:-1] -= share * np.diff(means, 2, axis=0)
    return means


def joined_motion(motions: Sequence[SmoothMotion]) -> SmoothMotion:
    """Return several recordings' motion as one of more stretches; each joint as uncertain as in the worst."""
    first = motions[0]
    if len(motions) == 1:
        return first
    offsets = np.cumsum([0, *(int(m.stretch[-1]) + 1 for m in motions[:-1])]).tolist()
    warm = [] if any(m.temperature is None for m in motions) else ["temperature"]
    names = ("time", "q", "v", "a", "torque", *warm)
    stacked = {n: np.concatenate([getattr(m, n) for m in motions]) for n in names}
    stretch = np.concatenate([m.stretch + k for m, k in zip(motions, offsets, strict=True)])
    pairs = zip(*(m.joints for m in motions), strict=True)
    worst = tuple(max(js, key=lambda j: j.sigma[1]) for js in pairs)
    return replace(first, **{"temperature": None, **stacked}, stretch=stretch, joints=worst)


def _samples(readings: JointReadings, stretch: slice, joint: int) -> JointSamples:
    times = readings.position_time[stretch]
    within = (readings.velocity_time >= times[0]) & (readings.velocity_time <= times[-1])
    return JointSamples(
        times,
        readings.position[stretch, joint],
        readings.velocity_time[within],
        readings.velocity[within, joint],
    )


def _require_motion(model: SpacecraftModel, readings: JointReadings, joints: Sequence[SmoothJoint]) -> None:
    moved = np.ptp(readings.position, axis=0)
    still = [
        n
        for n, m, j in zip(model.arm_joints.names, moved, joints, strict=True)
        if not m > STILL_SIGMAS * j.noise
    ]
    if len(still) == len(joints):
        raise NotIdentifiableError(
            f"No joint moves: {', '.join(still)} stay within their encoders' noise.",
            advice="Record a motion.",
            still=tuple(still),
        )
