"""Quick Cramer-Rao bounds of experiments that are only thought of: thinned samples, motion as commanded.

What `smsid.likelihood.fisher_information` says of an experiment that was simulated, this says within some per
cent in a fraction of the time, so that a search can ask it hundreds of times. Samples are thinned to
``FORECAST_RATE`` and their noise with them, steps are longer, and joints move as commanded: their encoders'
noise is added to that of the other sensors (`smsid.likelihood._input_noise`) instead of being estimated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from scipy.interpolate import make_interp_spline

from smsid.description.schema import Description
from smsid.errors import ExperimentError
from smsid.experiments import Experiment, fly
from smsid.experiments.scaling import spin_inertias
from smsid.inputs.signals import Fourier, sample
from smsid.likelihood.channels import QUANTITIES, Channel, described_sigma, measured_channels
from smsid.likelihood.inputs import DrivenMotion
from smsid.likelihood.normal import Normal, normal_at
from smsid.likelihood.nuisance_parameters import Nuisance, NuisanceValues, initial, slots_of
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import Evaluation, SearchPoint
from smsid.likelihood.prediction import Prediction
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm, longest_step, piece_of
from smsid.likelihood.spline import DEGREE, FittedMotion
from smsid.likelihood.time_grid import Timeline
from smsid.model import build_model
from smsid.model.spacecraft import SpacecraftModel, set_group_angles
from smsid.recording import Recording

FORECAST_RATE = 8.0  # [Hz] of the thinned samples, or more for fast modes
PER_MODE = 10.0  # samples a period of the fastest mode
STEP = 3.0  # times as long as the steps of the refinement
KNOTS = 0.25  # [s] between the knots of a commanded motion


@dataclass(frozen=True)
class Forecast:
    """Predicts information for one spacecraft and one duration [s], from samples thinned to ``rate`` [Hz]."""

    model: SpacecraftModel
    duration: float
    rate: float

    @classmethod
    def of(cls, model: SpacecraftModel, duration: float) -> Forecast:
        """Return the forecast with a rate that is enough for the fastest mode."""
        return cls(model, duration, max(FORECAST_RATE, PER_MODE * fastest_mode(model)))

    @cached_property
    def parameters(self) -> Parameters:
        """The description's values."""
        return Parameters.of(self.model)

    @cached_property
    def timeline(self) -> Timeline:
        """The grid of a motion without jumps."""
        return Timeline.of(0.0, self.duration, [], STEP * longest_step(self.model))

    def channels(self, timeline: Timeline) -> tuple[Channel, ...]:
        """Return the description's sensors as channels with thinned samples, all reading zero.

        Raises `ExperimentError` for sensors without noise.
        """
        sensors = [
            s for s in self.model.description.effective_sensors() if set(s.quantities) & set(QUANTITIES)
        ]
        times = np.linspace(0.0, self.duration, round(self.duration * self.rate) + 1)
        values, sigma = {}, {}
        for sensor in sensors:
            for quantity in sensor.quantities:
                shape: tuple[int, ...] = (4,) if quantity == "attitude" else (3,)
                if sensor.kind == "accelerometers":
                    part = next(a for a in self.model.appendages if a.appendage.name == sensor.appendage)
                    every = range(len(part.appendage.station_positions()))
                    shape = (len(sensor.stations if sensor.stations is not None else every), 3)
                name = f"{sensor.name}.{quantity}"
                values[name] = np.zeros((len(times), *shape))
                if quantity == "attitude":
                    values[name][:, 3] = 1.0
                width = 3 if quantity == "attitude" else int(np.prod(shape))
                own = np.asarray(described_sigma(sensor, quantity, width), dtype=float)
                if not np.all(own > 0.0):
                    raise ExperimentError(
                        f"'{name}' is described without noise: nothing can be predicted.",
                        advice="Give it `errors`, or a preset.",
                    )
                sigma[name] = own * np.sqrt(self.rate / sensor.rate)
        if not values:
            raise ExperimentError(
                f"'{self.model.description.name}' has no sensor of its motion.",
                advice="Add [[sensor]] tables of kind pose or imu to the description.",
            )
        recording = Recording.from_arrays(times, values, name="design")
        return measured_channels(self.model, recording, timeline, sigma)

    def piece(
        self, drive: DrivenMotion, timeline: Timeline, channels: tuple[Channel, ...]
    ) -> tuple[RecordingTerm, NuisanceValues]:
        """Return a term of the likelihood without data."""
        slots = slots_of(channels, Nuisance())
        return RecordingTerm("design", drive, timeline, channels, slots), initial(slots, drive, channels)

    @cached_property
    def _moving(self) -> tuple[Channel, ...]:
        return self.channels(self.timeline)

    def motion(self, experiment: Experiment) -> tuple[Normal, Prediction]:
        """Return information by (parameters, local ones) and the motion of a free-floating experiment.

        Wheels turn as their torques make them turn on a bus that stands still, which is right to some 1e-4.
        """
        piece, local = self.piece(self._drive(experiment), self.timeline, self._moving)
        prediction = piece.predict(self.parameters, local)
        piece = piece.with_input_noise(self.parameters, prediction)
        point = SearchPoint(self.parameters, (local,))
        seen = Evaluation(point, (prediction,), ([],))
        return normal_at([piece], seen, Prior(self.parameters), with_data=False), prediction

    def _drive(self, experiment: Experiment) -> DrivenMotion:
        model = self.model
        locked = {int(i) for i in (*model.arm_joints.v, *model.wheels.v)}
        free = np.array([i for i in range(model.nv) if i not in locked])
        knots = np.linspace(0.0, self.duration, int(np.ceil(self.duration / KNOTS)) + 1)
        joints = wheels = None
        home = experiment.start(model)
        if experiment.joint_motion is not None:
            motion = experiment.joint_motion.signal()
            noise = self._noise("encoder", "joint_velocity", len(model.arm_joints))
            joints = _spline(knots, sample(motion, knots), noise)
            home = set_group_angles(model.arm_joints, home, motion(0.0))
        if len(model.wheels):
            torque = experiment.wheel_torque.signal() if experiment.wheel_torque is not None else None
            angle = np.zeros((len(knots), len(model.wheels)))
            if isinstance(torque, Fourier):
                angle = double_integral(torque, knots) / spin_inertias(model)
            noise = self._noise("tachometer", "wheel_rate", len(model.wheels))
            wheels = _spline(knots, angle, noise)
        return DrivenMotion(free, home, False, None, joints, wheels)

    def _noise(self, kind: str, quantity: str, count: int) -> np.ndarray:
        """Noise of a rate (count,), thinned; of joints without encoder none."""
        for sensor in self.model.description.effective_sensors():
            if sensor.kind == kind and quantity in sensor.quantities:
                sigma = described_sigma(sensor, quantity, count)
                return np.asarray(sigma) * np.sqrt(self.rate / sensor.rate)
        return np.zeros(count)


def exact_information(description: Description, experiment: Experiment) -> Normal:
    """Return the information (n, n) of an experiment that is simulated first, parameters leading.

    The bound of `smsid.likelihood.fisher_information`, by parameters instead of what is reported of them.
    """
    perfect = [s.model_copy(update={"errors": {}, "preset": None}) for s in description.sensor]
    blank = build_model(description.with_sensors(*perfect))
    recording = fly(blank, experiment, np.random.default_rng(0)).recording
    model = build_model(description)
    at = Parameters.of(model)
    piece, local = piece_of(model, recording, Nuisance(), described_noise=True)
    piece = piece.following()
    piece = piece.with_input_noise(at, piece.predict(at, local))
    seen = Evaluation.at([piece], SearchPoint(at, (local,)))
    return normal_at([piece], seen, Prior(at), with_data=False)


def double_integral(series: Fourier, times: np.ndarray) -> np.ndarray:
    """Return the double integral (N, k) of a Fourier series from rest at time zero."""
    order = 2.0 * np.pi * series.frequency * np.arange(1, series.cos.shape[1] + 1)
    phase = np.outer(times, order)
    a, b = series.cos / order**2, series.sin / order**2
    wave = (1.0 - np.cos(phase)) @ a.T - np.sin(phase) @ b.T
    return wave + np.outer(times, (b * order).sum(axis=1)) + 0.5 * np.outer(times**2, series.offset)


def single_integral(series: Fourier, times: np.ndarray) -> np.ndarray:
    """Return the integral (N, k) of a Fourier series from time zero."""
    order = 2.0 * np.pi * series.frequency * np.arange(1, series.cos.shape[1] + 1)
    phase = np.outer(times, order)
    a, b = series.cos / order, series.sin / order
    return np.sin(phase) @ a.T + (1.0 - np.cos(phase)) @ b.T + np.outer(times, series.offset)


def _spline(knots: np.ndarray, values: np.ndarray, rate_noise: np.ndarray) -> FittedMotion:
    spline = make_interp_spline(knots, values, k=DEGREE)
    width = values.shape[1]
    # what positions add in the band of the motion is left out: rates alone
    return FittedMotion(spline, len(knots) - 1, np.zeros(width), rate_noise, np.zeros((width, 1, 1)))


def fastest_mode(model: SpacecraftModel) -> float:
    """Return the highest frequency [Hz] of slosh and modes, clamped."""
    if not len(model.spring_v):
        return 0.0
    mass = pin.crba(model.pin, model.pin.createData(), model.home).diagonal()[model.spring_v]
    return float(np.sqrt(np.max(model.stiffness / mass)) / (2.0 * np.pi))
