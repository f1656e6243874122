"""From a recording of an arm to joint angles, rates, accelerations and torques at the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from smsid._short_repr import short_repr
from smsid.arm.columns import JointStates
from smsid.arm.readings import JointReadings, joint_readings, measured_channel
from smsid.errors import RecordingError
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.sensing.filters import uniform_rate, zero_phase

SAMPLES_PER_PERIOD = 2.5
"""Samples kept per period of the cutoff."""

SPLINE_SAMPLES = 10.0
"""Samples per period of the cutoff that the spline goes through; nothing is left above half of that."""

SETTLING = 2.0
"""Periods of the cutoff left out at either end, where the filter does not know what lies beyond."""


@short_repr
@dataclass(frozen=True)
class ArmMotion:
    """Joint motion and torque at N instants; all joints of the model, in its order.

    ``time`` (N,) [s], ``q`` (N, nq) configuration, ``v``, ``a`` (N, nv) rates and accelerations [rad/s,
    rad/s^2], ``torque`` (N, nv) motor torque at the joints [N m], ``cutoff`` of the low-pass all went
    through [Hz].
    """

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    torque: np.ndarray
    cutoff: float

    @property
    def rate(self) -> float:
        """Samples per second."""
        return float((self.time.size - 1) / (self.time[-1] - self.time[0]))


def joint_motion(
    model: SpacecraftModel, recording: Recording, cutoff: float | None = None, *, late: float = 0.0
) -> ArmMotion:
    """Filter, differentiate and decimate a recording of an arm.

    Rates and accelerations are the slopes of the quintic spline through the filtered angles.

    Channels of the source ``motor`` are taken to the joints by the description's `Gear` effects;
    `JointOffset` effects are added to the angles. Angles and torques go through the same zero-phase
    low-pass, so that what it takes away is missing on both sides of the equations; two periods of the
    cutoff at either end are left out. A measured rate or acceleration is not used:
    differentiated angles agree with the angles.

    Args:
        model: a welded arm.
        recording: with ``<source>.joint_position`` and ``<source>.joint_torque`` at one constant rate.
        cutoff: -6 dB frequency of the low-pass [Hz]; default a fiftieth of the sampling rate.
        late: by how much the angles are older than their stamps say, against the torques [s].

    Raises:
        RecordingError: a channel is missing, joints are unlabelled or not the model's, the clock is
            uneven, or the record is shorter than the filter.
        DescriptionError: the gears do not fit.
    """
    samples, rate = even_readings(model, recording)
    angles = samples.position
    top = rate / 50.0 if cutoff is None else float(cutoff)
    edge = round(SETTLING * rate / top)
    if 2 * edge >= len(angles):
        raise RecordingError(
            f"{len(angles)} samples are all edge for a low-pass at {top:g} Hz, which takes {edge} at "
            "either end.",
            advice="Record longer, or raise the cutoff.",
            samples=len(angles),
            edge=edge,
        )
    coarse = max(1, int(rate / (SPLINE_SAMPLES * top)))
    both = zero_phase(np.hstack([angles, samples.torque]), rate, top)
    times = samples.position_time
    count = angles.shape[1]
    spline = make_interp_spline(times[::coarse], both[::coarse, :count], k=5, axis=0)
    kept = slice(edge, len(angles) - edge, max(1, int(rate / (SAMPLES_PER_PERIOD * top))))
    at = times[kept]
    seen = np.clip(at + late, times[0], times[-1])
    return ArmMotion(
        at,
        model.set_joint_angles(model.home, spline(seen)),
        spline.derivative(1)(seen),
        spline.derivative(2)(seen),
        both[kept, count:],
        top,
    )


def measured_states(motion: ArmMotion) -> JointStates:
    """Return what torques depend on in a motion, with the torques measured as the load."""
    return JointStates(motion.q, motion.v, motion.a, motion.torque)


def even_readings(model: SpacecraftModel, recording: Recording) -> tuple[JointReadings, float]:
    """Return the readings of a recording, as `joint_motion` says before any filter, and their rate [Hz].

    Raises:
        RecordingError: a channel is missing, joints are unlabelled or not the model's, or the clock is
            uneven.
        DescriptionError: the gears do not fit.
    """
    position, torque = (measured_channel(recording, q) for q in ("joint_position", "joint_torque"))
    if not np.array_equal(recording.time(position), recording.time(torque)):
        raise RecordingError(
            f"'{position}' and '{torque}' run on different clocks.",
            advice="Bring them to one rate: recording.resampled(rate).",
            channels=(position, torque),
        )
    rate = uniform_rate(recording.time(position), position)
    found = joint_readings(model, recording, velocity=False)
    whole = len(found.position_time) == len(found.torque_time) == len(recording.time(position))
    if not whole:
        bad = ~np.isfinite(np.hstack([recording[position], recording[torque]])).all(axis=1)
        raise RecordingError(
            f"{np.count_nonzero(bad)} of {bad.size} samples are not finite, the first is number "
            f"{np.flatnonzero(bad)[0]}.",
            advice="Filters spread them over the record; cut or fill them first.",
            channels=(position, torque),
        )
    return found, rate
