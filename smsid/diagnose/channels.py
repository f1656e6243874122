"""What the sensors measured, stacked for a filter: values, noise, and prediction with its derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.errors import RecordingError
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.sensing import Sensor
from smsid.simulate.trajectory import States
from smsid.simulate.truth import find_appendage, sensed, station_indices

WIDTH = {"position": 3, "attitude": 3, "velocity": 3, "acceleration": 3, "angular_rate": 3}
FLOOR = 1e-9  # relative to the channel's spread: noise below it is rounding


@dataclass(frozen=True)
class Block:
    """One channel: its rows in the stacked measurement, and how the sensor's errors act on it.

    The reading is ``gain @ x + bias`` of the ideal x, late by ``delay`` [s] (attitudes: bias and gain do not
    act; a misalignment is part of `bias` as rotation vector). ``later`` are biases that begin at a time [s].
    ``stations`` are those of an appendage.
    """

    sensor: Sensor
    quantity: str
    rows: slice
    stations: int
    names: tuple[str, ...]
    gain: np.ndarray
    bias: np.ndarray
    delay: float
    plain: bool  # it reads what is there, but for `later`
    later: tuple[tuple[float, np.ndarray], ...] = ()

    def begun(self, times: np.ndarray) -> np.ndarray:
        """Return what `later` adds to the reading at times (N,): (N, rows of the block)."""
        out = np.zeros((len(times), self.rows.stop - self.rows.start))
        for start, bias in self.later:
            out[times >= start] += np.resize(bias, out.shape[1])
        return out

    @property
    def channel(self) -> str:
        """Name of the channel."""
        return f"{self.sensor.name}.{self.quantity}"


@dataclass(frozen=True)
class Measured:
    """All measured channels on one clock: times (N,), values (N, rows), NaN where there is none.

    An attitude's rows are zero in ``values``; its quaternions are in ``attitude`` by channel. ``sigma``
    (rows,) is one standard deviation of the white noise of a sample.
    """

    times: np.ndarray
    values: np.ndarray
    attitude: dict[str, np.ndarray]
    blocks: tuple[Block, ...]
    sigma: np.ndarray

    @property
    def rows(self) -> int:
        """Number of components."""
        return self.values.shape[1]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the rows, ``<channel>[<component>]``."""
        return tuple(name for block in self.blocks for name in block.names)

    def residual(self, k: int, predicted: np.ndarray, rotation: np.ndarray | None) -> np.ndarray:
        """Return measured minus predicted (rows,) at sample k; an attitude's as rotation vector, body axes.

        ``rotation`` is the predicted attitude (3, 3).
        """
        out = self.values[k] - predicted
        for block in self.blocks:
            if block.quantity == "attitude" and rotation is not None:
                turn = rotation.T @ _matrix(self.attitude[block.channel][k])
                out[block.rows] = pin.log3(turn) - predicted[block.rows]
            for start, bias in block.later:
                if self.times[k] >= start:
                    out[block.rows] -= np.resize(bias, block.rows.stop - block.rows.start)
        return out

    def with_blocks(self, sensors: Sequence[Sensor]) -> Measured:
        """Return the same samples read through other error models of the sensors."""
        by_name = {s.name: s for s in sensors}
        blocks = tuple(
            _block(by_name[b.sensor.name], b.quantity, b.rows, b.stations, b.names) for b in self.blocks
        )
        return Measured(self.times, self.values, self.attitude, blocks, self.sigma)

    def scaled(self, factor: np.ndarray) -> Measured:
        """Return the samples with noise levels (rows,) times a factor."""
        return Measured(self.times, self.values, self.attitude, self.blocks, self.sigma * factor)

    def thinned(self, rate: float) -> Measured:
        """Return every n-th sample, so that no more than ``rate`` a second remain (within a tenth)."""
        every = int(np.ceil(1.0 / (1.1 * rate * float(np.median(np.diff(self.times))))))
        if every <= 1:
            return self
        k = slice(None, None, every)
        attitude = {name: q[k] for name, q in self.attitude.items()}
        return Measured(self.times[k], self.values[k], attitude, self.blocks, self.sigma)

    def without(self, faulty: np.ndarray) -> Measured:
        """Return the samples with those marked (N, rows) left out."""
        values = self.values.copy()
        values[faulty] = np.nan
        return Measured(self.times, values, self.attitude, self.blocks, self.sigma)


def measured(model: SpacecraftModel, recording: Recording, sensors: Sequence[Sensor]) -> Measured:
    """Return what a recording holds of the sensors' channels, on the clock of the fastest of them.

    Channels on slower clocks are NaN between their samples. Noise levels are those the sensors state, or
    where none is stated, those of the channel's third differences.

    Raises `RecordingError` when no sensor of the description is in the recording.
    """
    found = [(s, q) for s in sensors for q in s.quantities if f"{s.name}.{q}" in recording]
    found = [(s, q) for s, q in found if q != "joint_position" or len(model.arm_joints)]
    if not found:
        raise RecordingError(
            f"The recording '{recording.name}' holds nothing the sensors of the description measure.",
            advice=f"It has {', '.join(recording.channels)}; name the sensors after their sources.",
            sensors=[s.name for s in sensors],
        )
    clocks = [np.asarray(recording.time(f"{s.name}.{q}")) for s, q in found]
    times = max(clocks, key=len)
    blocks, columns, sigmas, attitudes, start = [], [], [], {}, 0
    for (sensor, quantity), clock in zip(found, clocks, strict=True):
        channel = f"{sensor.name}.{quantity}"
        samples = np.asarray(recording[channel], dtype=float)
        stations = samples.shape[1] if samples.ndim == 3 else 1
        flat = samples.reshape(len(clock), -1)
        placed = _placed(times, clock, flat, channel)
        if quantity == "attitude":
            attitudes[channel] = placed
            placed = np.where(np.isnan(placed[:, :3]), np.nan, 0.0)
        rows = slice(start, start + placed.shape[1])
        start = rows.stop
        names = tuple(f"{channel}[{label}]" for label in _labels(model, sensor, quantity, placed.shape[1]))
        blocks.append(_block(sensor, quantity, rows, stations, names))
        columns.append(placed)
        rate = 1.0 / float(np.median(np.diff(clock)))
        sigmas.append(_noise(sensor, quantity, rate, flat, placed.shape[1]))
    return Measured(times, np.hstack(columns), attitudes, tuple(blocks), np.concatenate(sigmas))


def _placed(times: np.ndarray, clock: np.ndarray, values: np.ndarray, channel: str) -> np.ndarray:
    if len(clock) == len(times) and np.abs(clock - times).max() < 1e-9:
        return values
    step = float(np.median(np.diff(times)))
    index = np.clip(np.round((clock - times[0]) / step).astype(int), 0, len(times) - 1)
    late = np.abs(times[index] - clock).max()
    if late > 0.02 * step:
        raise RecordingError(
            f"The clock of '{channel}' does not meet that of the fastest sensor (up to {late:.3g} s off).",
            advice="Resample the recording to one clock first (Recording.resampled).",
            channel=channel,
        )
    out = np.full((len(times), values.shape[1]), np.nan)
    out[index] = values
    return out


def _labels(model: SpacecraftModel, sensor: Sensor, quantity: str, width: int) -> list[str]:
    if quantity in ("joint_position", "joint_velocity"):
        return list(model.arm_joints.names)
    if quantity == "wheel_rate":
        return list(model.wheels.names)
    if sensor.kind == "accelerometers":
        return [f"{i}.{axis}" for i in range(width // 3) for axis in "xyz"]
    return list("xyz")


def _noise(sensor: Sensor, quantity: str, rate: float, samples: np.ndarray, width: int) -> np.ndarray:
    stated = sensor.error(quantity).white_sigma(rate)
    sigma = np.broadcast_to(stated, (width,)) if stated.size in (1, width) else np.resize(stated, width)
    step = sensor.error(quantity).quantisation / np.sqrt(12.0)
    sigma = np.hypot(sigma, step)
    if (sigma > 0.0).all():
        return np.array(sigma)
    third = np.diff(samples, 3, axis=0) / np.sqrt(20.0)
    seen = 1.4826 * np.median(np.abs(third), axis=0)
    seen = np.full(width, 2.0 * seen.max()) if quantity == "attitude" else seen
    floor = FLOOR * np.maximum(np.ptp(samples, axis=0).max(), 1e-6)
    return np.where(sigma > 0.0, sigma, np.maximum(seen, floor))


def _block(sensor: Sensor, quantity: str, rows: slice, stations: int, names: tuple[str, ...]) -> Block:
    errors = sensor.error(quantity)
    width = 3 if quantity in WIDTH else rows.stop - rows.start
    delay = float(errors.delay) + float(errors.time_offset)
    still = errors
    gain, bias = np.eye(width), np.zeros(width)
    if quantity == "attitude":
        whole, part = _begins(np.broadcast_to(np.asarray(errors.bias, dtype=float), 3), errors.bias_from)
        bias = whole + np.asarray(errors.misalignment, dtype=float)
        return Block(sensor, quantity, rows, stations, names, gain, bias, delay, not bias.any(), part)
    turn = sensor.rotation if any(sensor.orientation) and width == 3 else np.eye(width)
    if still.misaligned:
        turn_by = pin.exp3(np.asarray(still.misalignment, dtype=float))
        gain = turn_by.T
    scale = np.broadcast_to(np.asarray(still.scale_error, dtype=float), (width,))
    gain = (1.0 + scale)[:, None] * gain
    bias, later = _begins(np.broadcast_to(np.asarray(still.bias, dtype=float), (width,)), still.bias_from)
    for key, own in errors.components.items():
        if key.isdigit():  # of one axis, joint or wheel
            gain[int(key)] *= 1.0 + own.scale_error
            whole, part = _begins(own.bias * np.eye(width)[int(key)], own.bias_from)
            bias, later = bias + whole, (*later, *part)
    gain, bias = turn @ gain @ turn.T, turn @ bias
    later = tuple((start, turn @ x) for start, x in later)
    plain = not bias.any() and np.allclose(gain, np.eye(width), rtol=0.0, atol=1e-15)
    return Block(sensor, quantity, rows, stations, names, gain, bias, delay, plain, later)


def _begins(bias: np.ndarray, start: float | None) -> tuple[np.ndarray, tuple[tuple[float, np.ndarray], ...]]:
    """Return the part of a bias that is there all the time, and the part that begins midway."""
    if start is None or not bias.any():
        return bias.copy(), ()
    return np.zeros_like(bias), ((start, bias.copy()),)


class Outputs:
    """Predicted measurements of one model, sample by sample with derivatives, or all samples at once."""

    def __init__(self, model: SpacecraftModel, data: Measured) -> None:
        self.model, self.data = model, data
        self.gravity = np.asarray(model.pin.gravity.linear)
        self._parts = [(block, self._linear(block)) for block in data.blocks]

    def predict(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return h (rows,) and its derivatives by the tangent of q, by v and by a, each (rows, nv)."""
        rows, nv = self.data.rows, self.model.nv
        h = np.zeros(rows)
        cq, cv, ca = np.zeros((3, rows, nv))
        base = _Base(q, v, a, self.gravity) if self.model.free else None
        for block, part in self._parts:
            part(base, q, v, a, h, cq, cv, ca)
            if not block.plain and block.quantity != "attitude":
                _distort(block, h, (cq, cv, ca))
            elif block.quantity == "attitude":
                h[block.rows] = block.bias
        return h, cq, cv, ca

    def twisted(self, h: np.ndarray, tau: np.ndarray, a: np.ndarray) -> None:
        """Add to predictions h (rows,) what encoders see of gears that give at once, under forces tau (nv,).

        How that depends on the state is left out: the compliance of such a gear times a rotor's inertia.
        """
        if self.model.twists:
            for block in self.data.blocks:
                if block.quantity == "joint_position":
                    h[block.rows] += block.gain @ self.model.encoder_twist(tau, a)

    def all(self, s: States) -> np.ndarray:
        """Return h (N, rows) at many states; an attitude's rows hold the sensor's own error alone."""
        out = np.empty((len(s.time), self.data.rows))
        for sensor in {b.sensor.name: b.sensor for b in self.data.blocks}.values():
            ideal = sensed(self.model, s, sensor)
            for block in (b for b in self.data.blocks if b.sensor.name == sensor.name):
                if block.quantity == "attitude":
                    out[:, block.rows] = block.bias
                else:
                    x = ideal[block.channel].reshape(len(s.time), -1, len(block.gain))
                    out[:, block.rows] = (x @ block.gain.T + block.bias).reshape(len(s.time), -1)
                out[:, block.rows] += block.begun(s.time)
        return out

    def _linear(self, block: Block) -> Callable[..., None]:
        sensor, rows, model = block.sensor, block.rows, self.model
        r = np.asarray(sensor.position, dtype=float)
        match block.quantity:
            case "joint_position":
                group, index = model.arm_joints, range(rows.start, rows.stop)
                revolute = [model.pin.joints[int(j)].nq == 1 for j in group.joints]

                def part(base, q, v, a, h, cq, cv, ca):
                    for i, kq, kv, plain in zip(index, group.q, group.v, revolute, strict=True):
                        h[i] = q[kq] if plain else np.arctan2(q[kq + 1], q[kq])
                        cq[i, kv] = 1.0
                    for i, kq, kv in model.motors:
                        h[rows.start + i] += q[kq]
                        cq[rows.start + i, kv] = 1.0

                return part
            case "joint_velocity" | "wheel_rate":
                arm = block.quantity == "joint_velocity"
                group, motors = (model.arm_joints, model.motors) if arm else (model.wheels, ())
                index = np.arange(rows.start, rows.stop)

                def part(base, q, v, a, h, cq, cv, ca):
                    h[rows] = v[group.v]
                    cv[index, group.v] = 1.0
                    for i, _, kv in motors:
                        h[rows.start + i] += v[kv]
                        cv[rows.start + i, kv] = 1.0

                return part
            case "position":
                return lambda base, q, v, a, h, cq, cv, ca: base and base.position(rows, r, h, cq)
            case "attitude":
                return lambda base, q, v, a, h, cq, cv, ca: base and base.attitude(rows, cq)
            case "velocity":
                return lambda base, q, v, a, h, cq, cv, ca: base and base.velocity(rows, r, h, cq, cv)
            case "angular_rate":
                return lambda base, q, v, a, h, cq, cv, ca: base and base.rate(rows, h, cv)
        if sensor.kind == "accelerometers":
            return self._panel(block)
        return lambda base, q, v, a, h, cq, cv, ca: base and base.force(rows, r, h, cq, cv, ca)

    def _panel(self, block: Block) -> Callable[..., None]:
        panel = find_appendage(self.model, str(block.sensor.appendage))
        modes = panel.appendage.modal_data()
        kq = np.array([self.model.pin.joints[j].idx_q for j in panel.joints])
        kv = np.array([self.model.pin.joints[j].idx_v for j in panel.joints])
        stations = [int(i) for i in station_indices(panel, block.sensor)]
        positions = panel.appendage.station_positions()
        rest = [panel.placement.act(positions[i]) for i in stations]
        shapes = [
            panel.placement.rotation @ (np.array([m.shape[i] for m in modes]).T * panel.scale)
            for i in stations
        ]

        axis, drawn = panel.placement.rotation[:, 0], None
        if panel.drawn is not None:  # by joint coordinates, which are modal ones over the scale
            drawn = np.outer(panel.scale, panel.scale) * panel.drawn[stations]

        def part(base, q, v, a, h, cq, cv, ca):
            bent, rate, acceleration = q[kq], v[kv], a[kv]
            for k, (r0, shape) in enumerate(zip(rest, shapes, strict=True)):
                rows = slice(block.rows.start + 3 * k, block.rows.start + 3 * k + 3)
                place, leads = r0 + shape @ bent, shape
                if drawn is not None:
                    pull = drawn[k] @ bent
                    place = place - 0.5 * (pull @ bent) * axis
                    leads = shape - np.outer(axis, pull)
                moving = leads @ rate
                base.force(rows, place, h, cq, cv, ca)
                h[rows] += leads @ acceleration + 2.0 * _cross(base.omega, moving)
                cq[rows, kv] += base.turning() @ leads
                cv[rows, kv] += 2.0 * pin.skew(base.omega) @ leads
                cv[rows, 3:6] -= 2.0 * pin.skew(moving)
                ca[rows, kv] += leads
                if drawn is not None:
                    swing = np.outer(axis, drawn[k] @ rate)
                    h[rows] -= swing @ rate
                    cq[rows, kv] -= np.outer(axis, drawn[k] @ acceleration)
                    cq[rows, kv] -= 2.0 * pin.skew(base.omega) @ swing
                    cv[rows, kv] -= 2.0 * swing

        return part


class _Base:
    """The bus at one instant, and what its sensors read."""

    def __init__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, gravity: np.ndarray) -> None:
        self.origin, self.rotation = q[:3], _matrix(q[3:7])
        self.linear, self.omega = v[:3], v[3:6]
        self.a, self.alpha = a[:3], a[3:6]
        self.weight = self.rotation.T @ gravity if gravity.any() else None

    def position(self, rows: slice, r: np.ndarray, h: np.ndarray, cq: np.ndarray) -> None:
        h[rows] = self.origin + self.rotation @ r
        cq[rows, 0:3] = self.rotation
        cq[rows, 3:6] = -self.rotation @ pin.skew(r)

    def attitude(self, rows: slice, cq: np.ndarray) -> None:
        cq[rows, 3:6] = np.eye(3)

    def velocity(self, rows: slice, r: np.ndarray, h: np.ndarray, cq: np.ndarray, cv: np.ndarray) -> None:
        u = self.linear + _cross(self.omega, r)
        h[rows] = self.rotation @ u
        cq[rows, 3:6] = -self.rotation @ pin.skew(u)
        cv[rows, 0:3] = self.rotation
        cv[rows, 3:6] = -self.rotation @ pin.skew(r)

    def rate(self, rows: slice, h: np.ndarray, cv: np.ndarray) -> None:
        h[rows] = self.omega
        cv[rows, 3:6] = np.eye(3)

    def turning(self) -> np.ndarray:
        """Acceleration of a point per its place: alpha x + omega x omega x."""
        w = pin.skew(self.omega)
        return pin.skew(self.alpha) + w @ w

    def force(
        self, rows: slice, r: np.ndarray, h: np.ndarray, cq: np.ndarray, cv: np.ndarray, ca: np.ndarray
    ) -> None:
        """Specific force of a point fixed in the bus."""
        swing = _cross(self.omega, r)
        h[rows] = self.a + _cross(self.omega, self.linear + swing) + _cross(self.alpha, r)
        w = pin.skew(self.omega)
        cv[rows, 0:3] = w
        cv[rows, 3:6] = -pin.skew(self.linear + swing) - w @ pin.skew(r)
        ca[rows, 0:3] = np.eye(3)
        ca[rows, 3:6] = -pin.skew(r)
        if self.weight is not None:
            h[rows] -= self.weight
            cq[rows, 3:6] = -pin.skew(self.weight)


def _distort(block: Block, h: np.ndarray, derivatives: tuple[np.ndarray, ...]) -> None:
    width = len(block.gain)
    for start in range(block.rows.start, block.rows.stop, width):
        rows = slice(start, start + width)
        h[rows] = block.gain @ h[rows] + block.bias
        for c in derivatives:
            c[rows] = block.gain @ c[rows]


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of two 3-vectors; NumPy's own takes ten times as long."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
