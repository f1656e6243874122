"""One recording as a term of the likelihood: drive, grid, channels, and its own pose, biases and gains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from smsid.likelihood.channels import Channel, described_sigma, measured_channels, present, spanned
from smsid.likelihood.drive import Drive, measured_drive
from smsid.likelihood.input_noise import with_input_noise
from smsid.likelihood.outputs import Kinematics
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction, applied_forces, predict
from smsid.likelihood.sensitivity import sensitivity
from smsid.likelihood.timeline import Timeline
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

PHASE = 0.5  # [rad] of the fastest mode per step: amplitude and phase errors of order six, below 1e-6
LONGEST = 0.1  # [s]
START = {"position": 100.0, "attitude": 1.0}  # priors of the initial pose [m, rad]
BIAS = {"acceleration": 0.1, "angular_rate": 0.01}  # priors of biases [m/s^2, rad/s]


@dataclass(frozen=True)
class Nuisance:
    """Which nuisance parameters are estimated beside biases and initial pose, by their prior's sigma.

    ``thrust_gain``: relative error of the thrust per axis [1]; ``scale``: relative scale error of a channel
    by name [1]. What is not given is taken as zero: masses are known only as well as the thrust is.
    """

    biases: bool = True
    thrust_gain: float | None = None
    scale: Mapping[str, float] | None = None


@dataclass(frozen=True)
class Local:
    """What belongs to one recording alone.

    ``position`` (3,) [m] and ``quaternion`` (4,) of the bus at the start; ``gain`` (3,) relative thrust
    error; ``bias`` (k,) and ``scale`` by channel; ``motion`` (m, joints) spline coefficients of the joints.
    """

    position: np.ndarray
    quaternion: np.ndarray
    gain: np.ndarray
    bias: dict[str, np.ndarray]
    scale: dict[str, float]
    motion: np.ndarray


@dataclass(frozen=True)
class Slot:
    """Where one group of local parameters stands in the step of a piece, with the prior's sigma and unit."""

    kind: str
    channel: str
    start: int
    size: int
    sigma: float
    unit: str


@dataclass(frozen=True)
class Piece:
    """One recording, ready to be compared with predictions."""

    name: str
    drive: Drive
    timeline: Timeline
    channels: tuple[Channel, ...]
    slots: tuple[Slot, ...]

    @property
    def size(self) -> int:
        """Number of local parameters."""
        return sum(s.size for s in self.slots)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the local parameters."""
        out = []
        for s in self.slots:
            if s.kind == "joint_motion":
                out += [f"{self.name}: joint_motion.{k}" for k in range(s.size)]
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

    def predict(self, parameters: Parameters, local: Local) -> Prediction:
        """Predict the motion of the recording."""
        drive = self._driven(local)
        if drive.thrust is not None and local.gain.any():
            factor = np.concatenate([1.0 + local.gain, np.ones(3)])
            drive = replace(drive, thrust=replace(drive.thrust, values=drive.thrust.values * factor))
        return predict(parameters, drive, self.timeline, local.position, local.quaternion)

    def _driven(self, local: Local) -> Drive:
        if self.drive.joints is None:
            return self.drive
        return replace(self.drive, joints=self.drive.joints.with_coefficients(local.motion))

    @property
    def follows(self) -> bool:
        """Whether the measured joint motion is estimated with everything else."""
        return any(s.kind == "joint_motion" for s in self.slots)

    def following(self) -> Piece:
        """Return the piece with the coefficients of the measured joint motion among its parameters."""
        if self.follows or self.drive.joints is None:
            return self
        size = self.drive.joints.coefficients.size
        return replace(self, slots=(*self.slots, Slot("joint_motion", "", self.size, size, np.inf, "rad")))

    def residuals(self, parameters: Parameters, local: Local, prediction: Prediction) -> list[np.ndarray]:
        """Return measured minus predicted, (N, k) by channel."""
        kinematics = Kinematics.of(parameters.layout.model, prediction)
        out = []
        for c in self.channels:
            nodes = kinematics.output(c.sensor, c.quantity) * (1.0 + local.scale.get(c.name, 0.0))
            out.append(c.residual(nodes, local.bias.get(c.name)))
        return out

    def cost(self, residuals: list[np.ndarray]) -> float:
        """Return the sum of squares of whitened residuals."""
        return sum(
            float(np.sum((r @ c.whitening.T) ** 2)) for r, c in zip(residuals, self.channels, strict=True)
        )

    def normal(
        self, parameters: Parameters, local: Local, prediction: Prediction, residuals: list[np.ndarray] | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return information (n, n) and gradient (n,) by (parameters, local ones), the latter with data."""
        n = parameters.size + self.size
        information, gradient = np.zeros((n, n)), np.zeros(n)
        derivatives = self.columns(parameters, local, prediction)
        for i, (c, own) in enumerate(zip(self.channels, derivatives, strict=True)):
            white = c.whitening
            weighted = np.einsum("ab,nbp->nap", white, own)
            for k in range(c.width):
                block = weighted[:, k]
                information += block.T @ (c.gram @ block)
            if residuals is not None:
                back = c.weights.T @ (residuals[i] @ white.T)
                gradient += np.einsum("nap,na->p", weighted, back)
        return information, gradient

    def columns(self, parameters: Parameters, local: Local, prediction: Prediction) -> Iterator[np.ndarray]:
        """Yield, channel by channel, derivatives at the nodes (nodes, k, n) by (parameters, local ones)."""
        thrust = _unit_thrust(parameters, self.drive, self.timeline)
        by = sensitivity(parameters, self._driven(local), prediction, thrust, motion=self.follows)
        kinematics = Kinematics.of(parameters.layout.model, prediction)
        for c in self.channels:
            yield self._columns(kinematics, by, c, parameters.size, local)

    def _columns(self, kinematics: Kinematics, by, c: Channel, size: int, local: Local) -> np.ndarray:
        """Derivative (nodes, k, n) of a channel by (parameters, local ones)."""
        found = kinematics.jacobian(c.sensor, c.quantity, by)
        factor = 1.0 + local.scale.get(c.name, 0.0)
        out = np.zeros((*found.shape[:2], size + self.size))
        out[..., :size] = factor * found[..., :size]
        for s in self.slots:
            columns = slice(size + s.start, size + s.start + s.size)
            if s.kind == "initial_position":
                out[..., columns] = found[..., size : size + 3]
            elif s.kind == "initial_attitude":
                out[..., columns] = found[..., size + 3 : size + 6]
            elif s.kind == "thrust_gain":
                out[..., columns] = factor * found[..., size + 6 : size + 9]
            elif s.kind == "joint_motion":
                out[..., columns] = factor * found[..., size + 9 :]
            elif s.channel == c.name and s.kind == "bias":
                out[..., columns] = np.eye(c.width)
            elif s.channel == c.name and s.kind == "scale":
                out[..., columns] = kinematics.output(c.sensor, c.quantity)[..., None]
        return out

    def moved(self, local: Local, step: np.ndarray) -> Local:
        """Return the local values a step (size,) away; the pose moves in the bus frame."""
        position, quaternion, gain = local.position, local.quaternion, local.gain
        motion = local.motion
        bias, scale = dict(local.bias), dict(local.scale)
        turn = Rotation.from_quat(local.quaternion)
        for s in self.slots:
            part = step[s.start : s.start + s.size]
            if s.kind == "initial_position":
                position = position + turn.apply(part)
            elif s.kind == "initial_attitude":
                quaternion = (turn * Rotation.from_rotvec(part)).as_quat()
            elif s.kind == "thrust_gain":
                gain = gain + part
            elif s.kind == "joint_motion":
                motion = motion + part.reshape(motion.shape[::-1]).T
            elif s.kind == "bias":
                bias[s.channel] = bias[s.channel] + part
            else:
                scale[s.channel] = scale[s.channel] + float(part[0])
        return Local(position, quaternion, gain, bias, scale, motion)

    def prior(self, local: Local) -> tuple[np.ndarray, np.ndarray, float]:
        """Return information (size, size), gradient (size,) and cost of what is known beforehand.

        The initial pose has a prior about where it is: its weight keeps what no sensor sees from running off.
        The joint motion's is what encoders say.
        """
        information, gradient, cost = np.zeros((self.size, self.size)), np.zeros(self.size), 0.0
        for s in self.slots:
            place = np.arange(s.start, s.start + s.size)
            if s.kind == "joint_motion":
                joints = self.drive.joints
                assert joints is not None
                m = len(joints.coefficients)
                for k, known in enumerate(joints.information):
                    own = place[k * m : (k + 1) * m]
                    off = local.motion[:, k] - joints.coefficients[:, k]
                    pull = known @ off
                    information[np.ix_(own, own)] = known
                    gradient[own] = -pull
                    cost += float(off @ pull)
                continue
            off = np.zeros(s.size)
            if s.kind == "thrust_gain":
                off = local.gain
            elif s.kind == "bias":
                off = local.bias[s.channel]
            elif s.kind == "scale":
                off = np.array([local.scale[s.channel]])
            information[place, place] = 1.0 / s.sigma**2
            gradient[place] = -off / s.sigma**2
            cost += float(off @ off) / s.sigma**2
        return information, gradient, cost

    def split(self, information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what `prior` gave (size, size) as prior proper, and as data: that of the encoders."""
        encoders = np.zeros_like(information)
        for s in self.slots:
            if s.kind == "joint_motion":
                place = slice(s.start, s.start + s.size)
                encoders[place, place] = information[place, place]
        return information - encoders, encoders

    def values(self, local: Local) -> np.ndarray:
        """Return the local values (size,); the initial attitude as rotation vector."""
        out = np.zeros(self.size)
        for s in self.slots:
            value = {
                "initial_position": local.position,
                "initial_attitude": Rotation.from_quat(local.quaternion).as_rotvec(),
                "thrust_gain": local.gain,
                "bias": local.bias.get(s.channel),
                "scale": local.scale.get(s.channel),
                "joint_motion": local.motion.T.ravel(),
            }[s.kind]
            out[s.start : s.start + s.size] = value
        return out

    def with_noise(
        self, residuals: list[np.ndarray], parameters: Parameters, prediction: Prediction
    ) -> Piece:
        """Return the piece with the noise its residuals show, and that of the measured inputs added."""
        channels = tuple(
            c.with_covariance(np.diag(np.maximum(np.mean(r**2, axis=0), np.diag(c.covariance) * 1e-4)))
            for c, r in zip(self.channels, residuals, strict=True)
        )
        return replace(self, channels=channels).with_input_noise(parameters, prediction)

    def with_input_noise(self, parameters: Parameters, prediction: Prediction) -> Piece:
        """Return the piece with the noise of measured inputs added to that of its channels."""
        channels = with_input_noise(self.channels, parameters, self.drive, prediction, self.follows)
        return replace(self, channels=channels)


def piece_of(
    model: SpacecraftModel,
    recording: Recording,
    nuisance: Nuisance,
    *,
    described_noise: bool = False,
) -> tuple[Piece, Local]:
    """Return a recording as a term of the likelihood, and where its local parameters start.

    Noise comes from the samples, or with ``described_noise`` from the description's error models. Raises what
    `measured_drive`, `spanned` and `measured_channels` raise.
    """
    start, stop = spanned(model, recording)
    drive = measured_drive(model, recording, start, stop, described_noise=described_noise)
    jumps = drive.thrust.jumps if drive.thrust is not None else np.zeros(0)
    timeline = Timeline.of(start, stop, list(jumps), longest_step(model))
    timeline = _knots_on_grid(drive, timeline)
    sigma = None
    if described_noise:
        sigma = {}
        for sensor, quantity in present(model, recording):
            values = recording[f"{sensor.name}.{quantity}"]
            width = 3 if quantity == "attitude" else values[0].size
            sigma[f"{sensor.name}.{quantity}"] = described_sigma(sensor, quantity, width)
    channels = measured_channels(model, recording, timeline, sigma)
    slots = _slots(channels, nuisance)
    name = recording.name or ("exp1" if drive.held else "exp2")
    piece = Piece(name, drive, timeline, channels, slots)
    return piece, _initial(piece)


def longest_step(model: SpacecraftModel) -> float:
    """Return the step [s] that resolves the fastest mode as described, coupling allowed for."""
    fastest = 0.0
    if len(model.spring_v):
        mass = pin.crba(model.pin, model.pin.createData(), model.home)
        own = mass.diagonal()[model.spring_v]
        fastest = float(np.sqrt(np.max(model.stiffness / own)))
    return min(LONGEST, PHASE / max(1.2 * fastest, 1e-9))


def _knots_on_grid(drive: Drive, timeline: Timeline) -> Timeline:
    """Return the grid refined so that steps end at the knots of measured joint motion, where that jerks."""
    if drive.joints is None or len(timeline.counts) > 1:
        return timeline
    intervals = drive.joints.intervals
    return Timeline(timeline.edges, intervals * np.ceil(timeline.counts / intervals).astype(int))


def _slots(channels: tuple[Channel, ...], nuisance: Nuisance) -> tuple[Slot, ...]:
    found: list[Slot] = []

    def add(kind: str, channel: str, size: int, sigma: float, unit: str) -> None:
        found.append(Slot(kind, channel, sum(s.size for s in found), size, sigma, unit))

    add("initial_position", "", 3, START["position"], "m")
    add("initial_attitude", "", 3, START["attitude"], "rad")
    if nuisance.thrust_gain is not None:
        add("thrust_gain", "", 3, nuisance.thrust_gain, "1")
    for c in channels:
        if nuisance.biases and c.biased:
            unit = "rad/s" if c.quantity == "angular_rate" else "m/s^2"
            add("bias", c.name, c.width, BIAS[c.quantity], unit)
    for c in channels:
        if nuisance.scale and c.name in nuisance.scale:
            add("scale", c.name, 1, nuisance.scale[c.name], "1")
    return tuple(found)


def _initial(piece: Piece) -> Local:
    """Start of the local parameters: pose from the mean of the first samples, all else zero."""
    attitude, position = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)
    for c in piece.channels:
        if c.quantity == "attitude":
            # a held attitude is constant; a free one starts at rest
            first = c.values if piece.drive.held else c.values[:10]
            attitude = Rotation.from_quat(first).mean().as_quat()
    for c in piece.channels:
        if c.quantity == "position":
            offset = Rotation.from_quat(attitude).apply(np.asarray(c.sensor.position))
            position = c.values[:10].mean(axis=0) - offset
    bias = {s.channel: np.zeros(s.size) for s in piece.slots if s.kind == "bias"}
    scale = {s.channel: 0.0 for s in piece.slots if s.kind == "scale"}
    motion = piece.drive.joints.coefficients.copy() if piece.drive.joints is not None else np.zeros((0, 0))
    return Local(position, attitude, np.zeros(3), bias, scale, motion)


def _unit_thrust(parameters: Parameters, drive: Drive, timeline: Timeline) -> np.ndarray | None:
    """Generalised force (E, nv, 3) per unit of relative thrust error along each axis."""
    if drive.thrust is None:
        return None
    out = []
    for axis in range(3):
        values = np.zeros_like(drive.thrust.values)
        values[:, axis] = drive.thrust.values[:, axis]
        one = replace(drive, thrust=replace(drive.thrust, values=values))
        out.append(applied_forces(parameters, one, timeline))
    return np.stack(out, axis=-1)
