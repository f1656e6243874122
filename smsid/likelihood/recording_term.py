"""One recording as a term of the likelihood: drive, grid, channels, and where its local parameters stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.sparse import csr_array

from smsid.identify.sensor_correction import correct_readings
from smsid.identify.valid_samples import outliers
from smsid.likelihood._input_noise import with_input_noise
from smsid.likelihood._outputs import Kinematics
from smsid.likelihood._readings import Agreement, agreement, agreement_cost, refit_coefficients
from smsid.likelihood.channels import (
    Channel,
    common_span,
    described_sigma,
    measured_channels,
    on_timeline,
    usable_channels,
)
from smsid.likelihood.inputs import DrivenMotion, measured_drive
from smsid.likelihood.nuisance_parameters import (
    CLOCK_KINDS,
    SWITCH,
    Nuisance,
    NuisanceIndex,
    NuisanceValues,
    clock_slots,
    deviation,
    initial,
    moved,
    slots_of,
    values,
)
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction, applied_forces, predict
from smsid.likelihood.spline import FittedMotion
from smsid.likelihood.time_grid import Timeline
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

PHASE = 0.3  # [rad] of the fastest mode per step: its frequency comes out right to 2e-7, damping to 1e-7
LONGEST = 0.1  # [s]


@dataclass(frozen=True)
class RecordingTerm:
    """One recording, ready to be compared with predictions.

    ``follows``: the measured joint motion is estimated with everything else. Its coefficients are not among
    the local parameters: they are eliminated from the normal equations.
    """

    name: str
    drive: DrivenMotion
    timeline: Timeline
    channels: tuple[Channel, ...]
    slots: tuple[NuisanceIndex, ...]
    follows: bool = False

    @property
    def size(self) -> int:
        """Number of local parameters."""
        return sum(s.size for s in self.slots)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the local parameters."""
        out = []
        for s in self.slots:
            if s.kind == SWITCH:
                out += [f"{self.name}: {s.channel}.{s.kind}[{k}]" for k in range(s.size)]
                continue
            for k in range(s.size):
                axis = "xyz"[k % 3] if s.size > 1 else ""
                station = f"[{k // 3}]" if s.size > 3 else ""
                label = f"{s.channel}.{s.kind}{station}" if s.channel else s.kind
                out.append(f"{self.name}: {label}{'.' if axis else ''}{axis}")
        return tuple(out)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the local parameters."""
        return tuple(s.unit for s in self.slots for _ in range(s.size))

    def predict(self, parameters: Parameters, local: NuisanceValues) -> Prediction:
        """Predict the motion of the recording."""
        drive = self.driven(local)
        if drive.thrust is not None and local.gain.any():
            factor = np.concatenate([1.0 + local.gain, np.ones(3)])
            drive = replace(drive, thrust=replace(drive.thrust, values=drive.thrust.values * factor))
        later = local.switch - self.timeline.edges[1:-1] if len(local.switch) else None
        return predict(parameters, drive, self.timeline, local.position, local.quaternion, later)

    def driven(self, local: NuisanceValues) -> DrivenMotion:
        """Return the drive with the joints' motion and the clocks of what is measured, as in ``local``.

        Joint motion that is estimated with everything else is in true time.
        """
        joints, wheels = self.drive.joints, self.drive.wheels
        if joints is not None:
            joints = joints.with_coefficients(local.motion)
            if not self.follows and joints.sensor in local.clock:
                joints = joints.with_clock(local.clock[joints.sensor])
        if wheels is not None and wheels.sensor in local.clock:
            wheels = wheels.with_clock(local.clock[wheels.sensor])
        return replace(self.drive, joints=joints, wheels=wheels)

    def as_measured(self, local: NuisanceValues) -> NuisanceValues:
        """Return the local values with the joints' motion as encoders have it, by their clock."""
        joints = self.drive.joints
        if joints is None or np.array_equal(local.motion, joints.coefficients):
            return local
        return replace(local, motion=joints.coefficients)

    def in_true_time(self, local: NuisanceValues) -> NuisanceValues:
        """Return the local values with the joints' motion as encoders have it, their clock set right."""
        joints = self.drive.joints
        if joints is None or not np.any(local.clock.get(joints.sensor, 0.0)):
            return self.as_measured(local)
        return replace(local, motion=refit_coefficients(joints, local.clock[joints.sensor]))

    def following(self) -> RecordingTerm:
        """Return the piece with the measured joint motion estimated with everything else."""
        return self if self.drive.joints is None else replace(self, follows=True)

    def with_joints(self, joints: FittedMotion) -> RecordingTerm:
        """Return the piece with another spline of the joints' motion, and steps that end at its knots."""
        drive = replace(self.drive, joints=joints)
        timeline = _knots_on_grid(drive, self.timeline)
        channels = self.channels
        if not np.array_equal(timeline.counts, self.timeline.counts):
            channels = on_timeline(channels, timeline)
        return replace(self, drive=drive, timeline=timeline, channels=channels)

    def with_clocks(self, names: Sequence[str]) -> RecordingTerm:
        """Return the piece with the clocks of sensors by ``names`` among its parameters too."""
        have = {s.channel for s in self.slots if s.kind in CLOCK_KINDS}
        slots = list(self.slots)
        for name in sorted(({c.sensor.name for c in self.channels} & set(names)) - have):
            slots += clock_slots(name, sum(s.size for s in slots))
        return replace(self, slots=tuple(slots))

    def residuals(
        self, parameters: Parameters, local: NuisanceValues, prediction: Prediction
    ) -> list[np.ndarray]:
        """Return measured minus predicted, (N, k) by channel."""
        kinematics = Kinematics.of(parameters.layout.model, prediction)
        out = []
        for c in self.channels:
            nodes = kinematics.output(c.sensor, c.quantity) * (1.0 + local.scale.get(c.name, 0.0))
            out.append(c.residual(nodes, local.bias.get(c.name), self._clock_interpolation(c, local)))
        return out

    def _clock_interpolation(self, c: Channel, local: NuisanceValues) -> csr_array | None:
        """Interpolation to when the samples really were taken, for a sensor whose clock is off."""
        clock = local.clock.get(c.sensor.name)
        if clock is None or not clock.any():
            return None
        late = clock[0] + clock[1] * (c.times - self.timeline.edges[0])
        return self.timeline.interpolation(c.times - late)

    def cleaned(self, residuals: list[np.ndarray]) -> tuple[RecordingTerm, list[np.ndarray]]:
        """Return the piece without samples far outside of their noise, and the others' residuals (N, k)."""
        channels, kept = [], []
        for c, r in zip(self.channels, residuals, strict=True):
            bad, _ = outliers(r)
            channels.append(c.only(~bad) if bad.any() else c)
            kept.append(r[~bad] if bad.any() else r)
        return replace(self, channels=tuple(channels)), kept

    def cost(self, residuals: list[np.ndarray]) -> float:
        """Return the sum of squares of the whitened ``residuals``, (N, k) by channel."""
        return sum(
            float(np.sum((r @ c.whitening.T) ** 2)) for r, c in zip(residuals, self.channels, strict=True)
        )

    def unit_thrust(self, parameters: Parameters) -> np.ndarray | None:
        """Return the generalised force (coarse nodes, nv, 3) per unit of thrust gain, if gains are sought."""
        if self.drive.thrust is None or not any(s.kind == "thrust_gain" for s in self.slots):
            return None
        out, timeline = [], self.timeline.coarse
        for axis in range(3):
            own = np.zeros_like(self.drive.thrust.values)
            own[:, axis] = self.drive.thrust.values[:, axis]
            one = replace(self.drive, thrust=replace(self.drive.thrust, values=own))
            out.append(applied_forces(parameters, one, timeline)[timeline.node_evaluation])
        return np.stack(out, axis=-1)

    def unit_clocks(self, parameters: Parameters, local: NuisanceValues) -> np.ndarray | None:
        """Return what the clocks sought that measured motion runs by do to it.

        Derivatives of angle, rate and acceleration (coarse nodes, nv, 3, columns) by offset and drift of one
        clock after the other (`running_clocks`); ``None`` without any.
        """
        timeline, model, drive = self.timeline.coarse, parameters.layout.model, self.driven(local)
        times = timeline.evaluations[timeline.node_evaluation]
        running, out = {s.channel for s in self.running_clocks}, []
        for group, motion in ((model.arm_joints, drive.joints), (model.wheels, drive.wheels)):
            if motion is not None and motion.sensor in running:
                own = np.zeros((len(times), model.nv, 3, 2))
                own[:, group.v] = np.moveaxis(motion.by_clock(times), 0, 2)
                out.append(own)
        return np.concatenate(out, axis=-1) if out else None

    @property
    def running_clocks(self) -> list[NuisanceIndex]:
        """The slots of clocks that measured motion runs by; joint motion in true time does not."""
        joints = None if self.follows else self.drive.joints
        running = [x.sensor for x in (joints, self.drive.wheels) if x is not None]
        return [s for x in running for s in self._clocks(x)]

    def _clocks(self, sensor: str) -> list[NuisanceIndex]:
        """The slots of a sensor's clock: offset, drift."""
        return [s for s in self.slots if s.kind in CLOCK_KINDS and s.channel == sensor]

    def moved(self, local: NuisanceValues, step: np.ndarray) -> NuisanceValues:
        """Return the local values a step (size,) away; the pose moves in the bus frame."""
        return moved(self.slots, local, step)

    def prior(self, local: NuisanceValues) -> tuple[np.ndarray, np.ndarray, float]:
        """Return information (size, size), gradient (size,) and cost of what is known beforehand."""
        information, gradient, cost = np.zeros((self.size, self.size)), np.zeros(self.size), 0.0
        for s in self.slots:
            place = np.arange(s.start, s.start + s.size)
            off, sigma = deviation(s, local), np.array(s.sigmas or s.sigma)
            information[place, place] = 1.0 / sigma**2
            gradient[place] = -off / sigma**2
            cost += float(np.sum((off / sigma) ** 2))
        return information, gradient, cost

    @property
    def encoder_clocks(self) -> list[NuisanceIndex]:
        """The slots of the clock of what measures the joints, where their motion is in true time."""
        joints = self.drive.joints
        return self._clocks(joints.sensor) if joints is not None and self.follows else []

    def encoders(self, local: NuisanceValues) -> Agreement:
        """Return what encoders say of the joints' motion."""
        joints = self.drive.joints
        assert joints is not None
        return agreement(joints, local.motion, local.clock.get(joints.sensor, np.zeros(2)))

    def known_cost(self, local: NuisanceValues) -> float:
        """Return the cost of what is known beforehand, and of what encoders say."""
        cost = self.prior(local)[2]
        joints = self.drive.joints
        if joints is not None and self.follows:
            cost += agreement_cost(joints, local.motion, local.clock.get(joints.sensor, np.zeros(2)))
        return cost

    def values(self, local: NuisanceValues) -> np.ndarray:
        """Return the local values (size,); the initial attitude as rotation vector."""
        return values(self.slots, local)

    def with_noise(
        self, residuals: list[np.ndarray], parameters: Parameters, prediction: Prediction
    ) -> RecordingTerm:
        """Return the piece with the noise its residuals show, and that of the measured inputs added.

        ``residuals`` (N, k) by channel.
        """
        channels = tuple(
            c.with_covariance(np.diag(np.maximum(np.mean(r**2, axis=0), np.diag(c.covariance) * 1e-4)))
            for c, r in zip(self.channels, residuals, strict=True)
        )
        return replace(self, channels=channels).with_input_noise(parameters, prediction)

    def with_input_noise(self, parameters: Parameters, prediction: Prediction) -> RecordingTerm:
        """Return the piece with the noise of measured inputs added to that of its channels."""
        channels = with_input_noise(self.channels, parameters, self.drive, prediction, self.follows)
        return replace(self, channels=channels)


def piece_of(
    model: SpacecraftModel,
    recording: Recording,
    nuisance: Nuisance,
    *,
    described_noise: bool = False,
) -> tuple[RecordingTerm, NuisanceValues]:
    """Return a recording as a term of the likelihood, and where its local parameters start.

    Noise comes from the samples, or with ``described_noise`` from the description's error models. Raises what
    `measured_drive`, `common_span` and `measured_channels` raise.
    """
    recording = correct_readings(order_columns(recording, model), model.description.effective_sensors())
    start, stop = common_span(model, recording)
    drive = measured_drive(model, recording, start, stop, described_noise=described_noise)
    jumps = drive.thrust.jumps if drive.thrust is not None else np.zeros(0)
    timeline = Timeline.of(start, stop, list(jumps), longest_step(model))
    timeline = _knots_on_grid(drive, timeline)
    sigma = None
    if described_noise:
        sigma = {}
        for sensor, quantity in usable_channels(model, recording):
            values = recording[f"{sensor.name}.{quantity}"]
            width = 3 if quantity == "attitude" else values[0].size
            sigma[f"{sensor.name}.{quantity}"] = described_sigma(sensor, quantity, width)
    channels = measured_channels(model, recording, timeline, sigma)
    slots = slots_of(channels, nuisance, drive.sensors)
    name = recording.name or ("exp1" if drive.held else "exp2")
    return RecordingTerm(name, drive, timeline, channels, slots), initial(slots, drive, channels)


def longest_step(model: SpacecraftModel) -> float:
    """Return the step [s] that resolves the fastest mode as described, coupling allowed for."""
    fastest = 0.0
    if len(model.spring_v):
        mass = pin.crba(model.pin, model.pin.createData(), model.home)
        own = mass.diagonal()[model.spring_v]
        fastest = float(np.sqrt(np.max(model.stiffness / own)))
    return min(LONGEST, PHASE / max(1.2 * fastest, 1e-9))


def _knots_on_grid(drive: DrivenMotion, timeline: Timeline) -> Timeline:
    """Return the grid refined so that steps end at the knots of measured joint motion, where that jerks.

    Those of the coarse grid too.
    """
    if drive.joints is None or len(timeline.counts) > 1:
        return timeline
    unit = 2 * drive.joints.intervals
    return Timeline(timeline.edges, unit * np.ceil(timeline.counts / unit).astype(int))
