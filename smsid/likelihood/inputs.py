"""What drives a prediction: thrust as commanded, joint and wheel motion as measured, or everything held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from smsid._time_text import stamp_text, time_text
from smsid.errors import DescriptionError, RecordingError
from smsid.identify.clocks import event_times
from smsid.identify.commanded import actual_thrust, excited_axes
from smsid.identify.robust import white_sigma
from smsid.identify.sensor_roles import find_sensor, needed_sensor
from smsid.identify.stationary_joints import StationaryJoints, motion_sensors, resting_value
from smsid.likelihood.spline import DerivativeSamples, FittedMotion, fit_motion
from smsid.model.spacecraft import SpacecraftModel, set_group_angles
from smsid.recording import Recording
from smsid.sensing import Sensor

PROBES = 21
QUIET = 1e-6  # of its noise that is left of a joint or wheel that stands still
MAIN = (
    ("imu", "acceleration", "angular_rate"),
    ("imu", "angular_rate"),
    ("pose", "attitude"),
    ("pose", "position"),
    ("pose", "velocity"),
    ("imu", "acceleration"),
)
"""Kinds of sensors with their quantities: the first that a recording has counts its samples."""
SHORTEST = 0.1  # [s] between knots of a measured motion


@dataclass(frozen=True)
class ThrustHistory:
    """Force [N] and torque [N m] on the bus (N, 6) in body axes, sampled at ``times`` (N,) [s].

    ``steps``: the value holds until the next sample; otherwise a cubic spline goes through the samples.
    ``since`` (k,) [s] are, by its ``jumps``, the times before which it had not switched yet: a command may do
    so anywhere between two samples. ``None`` where it switches at them.
    """

    times: np.ndarray
    values: np.ndarray
    steps: bool
    since: np.ndarray | None = None

    @property
    def jumps(self) -> np.ndarray:
        """Times (k,) at which it jumps [s]."""
        if not self.steps:
            return np.zeros(0)
        return self.times[1:][np.any(np.diff(self.values, axis=0) != 0.0, axis=1)]

    def at(self, times: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """Return values (N, 6) at times (N,), each within a segment whose middle is given [s]."""
        if not self.steps:
            return np.asarray(CubicSpline(self.times, self.values, axis=0)(times))
        index = np.searchsorted(self.times, middle, side="right") - 1
        return self.values[np.clip(index, 0, len(self.values) - 1)]


@dataclass(frozen=True)
class DrivenMotion:
    """Which velocities of the model are free, and what the others do.

    ``free`` indexes v. ``held``: the attitude is held and joints and wheels stand still at ``home`` (nq,).
    """

    free: np.ndarray
    home: np.ndarray
    held: bool
    thrust: ThrustHistory | None
    joints: FittedMotion | None
    wheels: FittedMotion | None

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors that measure the motion."""
        return tuple(x.sensor for x in (self.joints, self.wheels) if x is not None and x.sensor)

    def prescribed(self, model: SpacecraftModel, times: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return q (N, nq), v (N, nv), a (N, nv) with prescribed parts filled in, all else home and zero."""
        q = np.tile(self.home, (len(times), 1))
        v, a = np.zeros((2, len(times), model.nv))
        for group, motion in ((model.arm_joints, self.joints), (model.wheels, self.wheels)):
            if motion is None:
                continue
            angle, v[:, group.v], a[:, group.v] = motion.values(times)
            q = set_group_angles(group, q, angle)
        return q, v, a


def measured_drive(
    model: SpacecraftModel, recording: Recording, start: float, stop: float, *, described_noise: bool = False
) -> DrivenMotion:
    """Return what drives a recording: Exp. 1 (thrust, attitude held) or Exp. 2 (free floating).

    Motion is fitted with the noise its samples show, or with ``described_noise`` that of the description.
    Raises `RecordingError` when encoders or tachometers are missing in free floating, `DescriptionError` when
    something moves freely that the refinement cannot predict.
    """
    held = bool(excited_axes(recording))
    locked = {int(i) for i in (*model.arm_joints.v, *model.wheels.v)} | ({3, 4, 5} if held else set())
    free = np.array([i for i in range(model.nv) if i not in locked])
    _check_free(model, free, start, stop)
    home = model.home.copy()
    encoder, tachometer = motion_sensors(model, recording)
    if held and encoder is not None:
        angles = np.nanmedian(recording[f"{encoder.name}.joint_position"], axis=0)
        home = set_group_angles(model.arm_joints, home, angles)
    thrust = _thrust(model, recording, held)
    if held:
        return DrivenMotion(free, home, True, thrust, None, None)
    joints, wheels = None, None
    still, rate = StationaryJoints.of(model, recording), _rate(model, recording)
    if len(model.arm_joints):
        encoder = needed_sensor(model, recording, "encoder", ("joint_position", "joint_velocity"))
        samples = [
            _quieten(_samples(recording, encoder, name, order, described_noise), name, still.joints)
            for order, name in enumerate(("joint_position", "joint_velocity"))
        ]
        joints = fit_motion(samples, start, stop, rate, SHORTEST, encoder.name)
    if len(model.wheels):
        tachometer = needed_sensor(model, recording, "tachometer", ("wheel_rate",))
        sample = _samples(recording, tachometer, "wheel_rate", 1, described_noise)
        sample = _quieten(sample, "wheel_rate", still.wheels)
        wheels = fit_motion([sample], start, stop, rate, SHORTEST, tachometer.name)
        _check_covered(sample, start, stop, wheels.spacing)
    return DrivenMotion(free, home, False, thrust, joints, wheels)


def _check_covered(sample: DerivativeSamples, start: float, stop: float, longest: float) -> None:
    """Refuse wheels whose motion is not known: nothing else tells what they did."""
    known = sample.times[np.isfinite(sample.values).all(axis=1)]
    edges = np.concatenate([[start], known, [stop]])
    at = int(np.argmax(np.diff(edges)))
    if edges[at + 1] - edges[at] > max(longest, 0.1):
        raise RecordingError(
            f"The wheels' rates are missing from {stamp_text(edges[at])} to "
            f"{time_text(edges[at + 1], start)}.",
            advice="Use the recording up to there: window(t0, t1); free floating must start at rest.",
            start=float(edges[at]),
            stop=float(edges[at + 1]),
        )


def _rate(model: SpacecraftModel, recording: Recording) -> float:
    """Return the sampling rate [Hz] of the motion's main sensor: the first of `MAIN` that is there."""
    for kind, *quantities in MAIN:
        sensor = find_sensor(model, recording, kind, tuple(quantities))
        if sensor is not None:
            return 1.0 / float(np.median(np.diff(recording.time(f"{sensor.name}.{quantities[-1]}"))))
    raise RecordingError(
        f"Recording '{recording.name}' has no sensor of the spacecraft's motion.",
        advice="It needs channels of a sensor of kind imu or pose.",
        present=list(recording.channels),
        other_flight=True,
    )


def _samples(
    recording: Recording, sensor: Sensor, quantity: str, order: int, described: bool
) -> DerivativeSamples:
    values = recording[f"{sensor.name}.{quantity}"]
    if described:
        sigma = np.broadcast_to(sensor.error(quantity).white_sigma(sensor.rate), values.shape[1:])
    else:
        sigma = np.asarray(white_sigma(values[np.isfinite(values).all(axis=1)]))
    # noise-free data, or a quantised channel that stands still: what is left of it is rounding
    floor = 1e-9 * np.maximum(np.nanmax(np.abs(values), axis=0), 1e-6)
    return DerivativeSamples(
        order, event_times(recording, sensor, quantity), values, np.maximum(sigma, floor)
    )


def _quieten(samples: DerivativeSamples, quantity: str, still: Sequence[int]) -> DerivativeSamples:
    """Return the samples with little left of the noise of what stands still: it is held, and known to be."""
    if not still:
        return samples
    values, sigma = np.array(samples.values), np.array(samples.sigma)
    for k in still:
        values[:, k] = (1.0 - QUIET) * resting_value(values[:, k], quantity) + QUIET * values[:, k]
        sigma[k] *= QUIET
    return replace(samples, values=values, sigma=sigma)


def _thrust(model: SpacecraftModel, recording: Recording, held: bool) -> ThrustHistory | None:
    """Force as it acts; torque too, unless it is that which holds the attitude."""
    if "command.force" not in recording:
        return None
    found = actual_thrust(model, recording, torque=not held)
    if not found.values.any():
        return None
    thrust = ThrustHistory(found.times, found.values, found.steps)
    if recording.provenance.get("inputs") == "held":
        return thrust
    clock, jumps = np.asarray(recording.time("command.force"), dtype=float), thrust.jumps
    before = np.maximum(np.searchsorted(clock, jumps) - 1, 0)
    delayed = jumps - float(np.median(np.diff(clock)))  # by an effect
    return replace(thrust, since=np.where(np.isin(jumps, clock), clock[before], delayed))


def _check_free(model: SpacecraftModel, free: np.ndarray, start: float, stop: float) -> None:
    for j in range(2, model.pin.njoints):
        joint = model.pin.joints[j]
        if joint.idx_v in free and joint.nq != joint.nv:
            raise DescriptionError(
                f"Joint '{model.pin.names[j]}' turns freely without limits; that cannot be predicted here.",
                advice="Put it into an arm, so that its measured motion is used.",
            )
    for t in _probes(model, start, stop):
        for q, v in _states(model):
            tau = np.zeros(model.nv)
            for term in (*model.loads, *model.forces):
                term(t, q, v, tau)
            if tau[free].any():
                raise DescriptionError(
                    "A nonlinear force acts on slosh, panels or the bus; its derivative is not known.",
                    advice="Use the method `paper`, or leave the effect out of the description; a diagnosis "
                    "fits the nominal parameters beside it.",
                    time=t,
                )


def _probes(model: SpacecraftModel, start: float, stop: float) -> np.ndarray:
    """Times [s] at which forces are looked at: between any two of their jumps, and `PROBES` in the record."""
    if not (model.forces or model.loads):
        return np.zeros(0)
    edges = np.array([start, *sorted(b for b in model.breakpoints if start < b < stop), stop])
    return np.unique(np.concatenate([0.5 * (edges[1:] + edges[:-1]), np.linspace(start, stop, PROBES)]))


def _states(model: SpacecraftModel) -> list[tuple[np.ndarray, np.ndarray]]:
    """Moving, at rest but deflected, and both: a force may need the one or the other to be there."""
    away = model.home.copy()
    away[model.spring_q] += 0.1
    still, moving = np.zeros(model.nv), np.full(model.nv, 0.1)
    return [(model.home.copy(), moving), (away, still), (away, moving)]
