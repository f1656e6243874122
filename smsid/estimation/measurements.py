"""What the sensors measured, stacked for a filter: values, noise, and how the sensors' errors act."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.linalg import block_diag
from scipy.special import erf

from smsid._time_text import time_text
from smsid.errors import RecordingError
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel
from smsid.model.stations import find_appendage, station_indices
from smsid.recording import Recording
from smsid.recording.attitude import continuous
from smsid.sensing import Sensor

COMPONENTS = {"position": 3, "attitude": 3, "velocity": 3, "acceleration": 3, "angular_rate": 3}
SAME_MOMENT = 0.02  # of a sample interval: readings no further apart are of one moment
STAMP_SHARE = 1e-4  # of a step by which it may be longer: stamps are rounded
MOST_STEPS = 10_000_000  # between samples in all: beyond, a clock has jumped
OUTLIER_SIGMAS = 8.0  # standard deviations of its stated noise that an outlier is off by at least
NOISE_FLOOR = 1e-9  # relative to the channel's spread: noise below it is rounding


@dataclass(frozen=True)
class Bend:
    """A scale that depends on the rate: ``out @ (size * |s| * s)`` is added, s = ``into @ x`` in the sensor's
    own axes.
    """

    into: np.ndarray
    out: np.ndarray
    size: np.ndarray

    def added(self, x: np.ndarray) -> np.ndarray:
        """Return what is added to the reading of ideal values x (..., width)."""
        own = x @ self.into.T
        return (self.size * np.abs(own) * own) @ self.out.T

    def slope(self, x: np.ndarray) -> np.ndarray:
        """Return the derivative (width, width) at an ideal value x (width,)."""
        return self.out @ (2.0 * self.size * np.abs(self.into @ x))[:, None] * self.into


@dataclass(frozen=True)
class ChannelSlice:
    """One channel: its rows in the stacked measurement, and how the sensor's errors act on it.

    The reading is ``gain @ x + bias`` of the ideal x, late by ``delay`` [s] (attitudes: bias and gain do not
    act; a misalignment is part of `bias` as rotation vector). ``later`` are biases that begin at a time [s].
    ``stations`` are those of an appendage, ``bend`` is a scale that depends on the rate.
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
    bend: Bend | None = None

    def read(self, x: np.ndarray) -> np.ndarray:
        """Return the reading of ideal values x (..., width)."""
        straight = x @ self.gain.T + self.bias
        return straight if self.bend is None else straight + self.bend.added(x)

    def slope(self, x: np.ndarray) -> np.ndarray:
        """Return the derivative (width, width) of the reading by the ideal value x (width,)."""
        return self.gain if self.bend is None else self.gain + self.bend.slope(x)

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
class Measurements:
    """All measured channels on one clock: times (N,), values (N, rows), NaN where there is none.

    An attitude's rows are zero in ``values``; its quaternions are in ``attitude`` by channel. ``sigma``
    (rows,) is one standard deviation of the white noise of a sample. ``coarse`` (rows,) marks components that
    are read in steps: their errors are no noise that could be found from what a fit leaves.
    """

    times: np.ndarray
    values: np.ndarray
    attitude: dict[str, np.ndarray]
    blocks: tuple[ChannelSlice, ...]
    sigma: np.ndarray
    coarse: np.ndarray | None = None

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
        seen = [self.attitude[b.channel][k] for b in self.blocks if b.quantity == "attitude"]
        return reading_errors(self.blocks, self.times[k], self.values[k], seen, predicted, rotation)

    def with_blocks(self, sensors: Sequence[Sensor]) -> Measurements:
        """Return the same samples read through other error models of the sensors."""
        by_name = {s.name: s for s in sensors}
        same = {b.sensor.name: b.sensor == by_name[b.sensor.name] for b in self.blocks}
        blocks = tuple(
            b
            if same[b.sensor.name]
            else _block(by_name[b.sensor.name], b.quantity, b.rows, b.stations, b.names)
            for b in self.blocks
        )
        return replace(self, blocks=blocks)

    def scaled(self, factor: np.ndarray) -> Measurements:
        """Return the samples with noise levels (rows,) times a factor."""
        return replace(self, sigma=self.sigma * factor)

    def thinned(self, rate: float) -> Measurements:
        """Return every n-th sample, so that no more than ``rate`` a second remain (within a tenth)."""
        every = int(np.ceil(1.0 / (1.1 * rate * float(np.median(np.diff(self.times))))))
        if every <= 1:
            return self
        return self._only(slice(None, None, every))

    def first(self, count: int) -> Measurements:
        """Return the first samples, so many."""
        return self._only(slice(count))

    def _only(self, k: slice) -> Measurements:
        attitude = {name: q[k] for name, q in self.attitude.items()}
        return replace(self, times=self.times[k], values=self.values[k], attitude=attitude)

    def without(self, faulty: np.ndarray) -> Measurements:
        """Return the samples with those marked (N, rows) left out."""
        values = self.values.copy()
        values[faulty] = np.nan
        return replace(self, values=values)


def reading_errors(
    blocks: Sequence[ChannelSlice],
    time: float,
    values: np.ndarray,
    attitudes: Sequence[np.ndarray] | np.ndarray,
    predicted: np.ndarray,
    rotation: np.ndarray | None,
) -> np.ndarray:
    """Return measured ``values`` minus ``predicted`` (rows,) at a time [s].

    An attitude's is a rotation vector, body axes. ``attitudes`` (a, 4) are the measured quaternions in the
    order of their blocks, zero where there is none; ``rotation`` is the predicted attitude (3, 3).
    """
    out, place = values - predicted, 0
    for block in blocks:
        if block.quantity == "attitude":
            seen, place = attitudes[place], place + 1
            if rotation is not None and seen.any():
                out[block.rows] = pin.log3(rotation.T @ matrix(seen)) - predicted[block.rows]
        for start, bias in block.later:
            if time >= start:
                out[block.rows] -= np.resize(bias, block.rows.stop - block.rows.start)
    return out


def measurements_of(
    model: SpacecraftModel, recording: Recording, sensors: Sequence[Sensor], longest: float = np.inf
) -> Measurements:
    """Return what a recording holds of the sensors' channels, at all times at which one of them has a sample.

    A channel is NaN where it has none. Times within `SAME_MOMENT` of a sample interval of the fastest channel
    count as one; where nothing is read for longer than ``longest`` [s], times without readings stand between.
    Noise levels are those the sensors state, or where none is stated, those of the channel's third
    differences.

    Raises `RecordingError` when no sensor of the description is in the recording.
    """
    recording = order_columns(recording, model)
    found = [(s, q) for s in sensors for q in s.quantities if f"{s.name}.{q}" in recording]
    found = [(s, q) for s, q in found if q != "joint_position" or len(model.arm_joints)]
    if not found:
        raise RecordingError(
            f"The recording '{recording.name}' holds nothing the sensors of the description measure.",
            advice=f"It has {', '.join(recording.channels)}; name the sensors after their sources.",
            sensors=[s.name for s in sensors],
        )
    clocks = [np.asarray(recording.time(f"{s.name}.{q}")) for s, q in found]
    times = _fill_gaps(_all_times(clocks), longest)
    blocks, columns, sigmas, attitudes, start = [], [], [], {}, 0
    for (sensor, quantity), clock in zip(found, clocks, strict=True):
        channel = f"{sensor.name}.{quantity}"
        samples = np.array(recording[channel], dtype=float)
        stations = samples.shape[1] if samples.ndim == 3 else 1
        samples[sensor.error(quantity).meaningless(clock, samples)] = np.nan
        samples = continuous(samples) if quantity == "attitude" else samples
        flat = samples.reshape(len(clock), -1)
        placed = _place_on_clock(times, clock, flat)
        if quantity == "attitude":
            attitudes[channel] = placed
            placed = np.where(np.isnan(placed[:, :3]), np.nan, 0.0)
        rows = slice(start, start + placed.shape[1])
        start = rows.stop
        names = tuple(f"{channel}[{label}]" for label in component_labels(model, sensor, quantity))
        if len(names) != placed.shape[1]:
            raise RecordingError(
                f"'{channel}' has {placed.shape[1]} columns where the description's has {len(names)}.",
                advice="Do joints, wheels and stations of the description belong to this recording?",
                channel=channel,
            )
        blocks.append(_block(sensor, quantity, rows, stations, names))
        columns.append(placed)
        rate = 1.0 / float(np.median(np.diff(clock)))
        sigmas.append(_noise(sensor, quantity, rate, samples, placed.shape[1]))
    return Measurements(times, np.hstack(columns), attitudes, tuple(blocks), np.concatenate(sigmas))


def _all_times(clocks: Sequence[np.ndarray]) -> np.ndarray:
    """Return the times (N,) at which any of the clocks ticks, those of the fastest as they are."""
    fastest = max(clocks, key=len)
    near = SAME_MOMENT * float(np.median(np.diff(fastest)))
    found = fastest
    for clock in clocks:
        own = clock[_distance(found, clock) > near]
        if len(own):
            found = np.sort(np.concatenate([found, own]))
    return found


def _distance(times: np.ndarray, clock: np.ndarray) -> np.ndarray:
    """Return how far every tick of a clock (n,) is from the nearest of the times."""
    return np.abs(times[_nearest(times, clock)] - clock)


def _nearest(times: np.ndarray, clock: np.ndarray) -> np.ndarray:
    """Return the index of the nearest of the times for every tick of a clock (n,)."""
    after = np.clip(np.searchsorted(times, clock), 1, len(times) - 1)
    return after - (clock - times[after - 1] < times[after] - clock)


def _fill_gaps(times: np.ndarray, longest: float) -> np.ndarray:
    """Return times (N,) with more between those that are further apart than ``longest`` [s].

    Raises `RecordingError` where that would be too many: a clock jumped.
    """
    steps = np.diff(times)
    parts = np.ceil(steps / longest - STAMP_SHARE) if np.isfinite(longest) else np.ones(len(steps))
    if parts.max(initial=1.0) <= 1.0:
        return times
    if parts.sum() > MOST_STEPS:
        k = int(np.argmax(parts))
        raise RecordingError(
            f"After {time_text(times[k], times[0])} nothing is recorded for {times[k + 1] - times[k]:.3g} s.",
            advice="Did a clock jump? Cut the recording there: smsid cut RECORDING --pieces.",
        )
    parts = np.maximum(parts, 1.0).astype(int)
    starts, widths = np.repeat(times[:-1], parts), np.repeat(np.diff(times) / parts, parts)
    count = np.concatenate([np.arange(n) for n in parts])
    return np.append(starts + count * widths, times[-1])


def _place_on_clock(times: np.ndarray, clock: np.ndarray, values: np.ndarray) -> np.ndarray:
    if len(clock) == len(times) and np.abs(clock - times).max() < 1e-9:
        return values
    out = np.full((len(times), values.shape[1]), np.nan)
    out[_nearest(times, clock)] = values
    return out


def component_labels(model: SpacecraftModel, sensor: Sensor, quantity: str) -> tuple[str, ...]:
    """Return what the rows of a channel are called: joints, wheels, axes, or ``<station>.<axis>``."""
    if quantity in ("joint_position", "joint_velocity"):
        return model.arm_joints.names
    if quantity == "wheel_rate":
        return model.wheels.names
    if sensor.kind == "accelerometers":
        count = len(station_indices(find_appendage(model, str(sensor.appendage)), sensor))
        return tuple(f"{i}.{axis}" for i in range(count) for axis in "xyz")
    return tuple("xyz")


def stated_noise(sensor: Sensor, quantity: str, rate: float, shape: tuple[int, ...]) -> np.ndarray:
    """Return one sigma of readings (N, ...) of a ``shape`` by what is stated, rounding included, one a row.

    Sampled at ``rate`` [Hz]; an attitude's, of shape (N, 4), are those of a rotation vector (3,).
    """
    errors = sensor.error(quantity)
    attitude = quantity == "attitude"
    whole = (1, 3) if attitude else (1, *shape[1:])
    step, wild = np.zeros((2, *whole))
    sigma = np.array(np.broadcast_to(errors.white_sigma(rate), whole))
    for place, part in errors.parts(whole):
        step[place] = np.maximum(step[place], part.quantisation)
        if part.outlier_rate and part.outlier_size:
            wild[place] += (
                part.outlier_rate * part.outlier_size**2 * _kept_variance(sigma[place] / part.outlier_size)
            )
    step *= 2.0 if attitude else 1.0
    return np.sqrt(sigma**2 + step**2 / 12.0 + wild).ravel()


def _kept_variance(sigma: np.ndarray) -> np.ndarray:
    """Return which part of the variance of outliers is that of those within `OUTLIER_SIGMAS` of ``sigma``.

    ``sigma`` is in the outliers' own standard deviation; those beyond are left out (`outliers`).
    """
    end = OUTLIER_SIGMAS * sigma
    return erf(end / np.sqrt(2.0)) - np.sqrt(2.0 / np.pi) * end * np.exp(-0.5 * end**2)


def _noise(sensor: Sensor, quantity: str, rate: float, samples: np.ndarray, width: int) -> np.ndarray:
    sigma = stated_noise(sensor, quantity, rate, samples.shape)
    if (sigma > 0.0).all():
        return sigma
    samples = samples.reshape(len(samples), -1)
    third = np.diff(samples[np.isfinite(samples).all(axis=1)], 3, axis=0) / np.sqrt(20.0)
    seen = 1.4826 * np.median(np.abs(third), axis=0)
    seen = np.full(width, 2.0 * seen.max()) if quantity == "attitude" else seen
    floor = NOISE_FLOOR * np.maximum(float(np.nanmax(samples) - np.nanmin(samples)), 1e-6)
    return np.where(sigma > 0.0, sigma, np.maximum(seen, floor))


def _block(sensor: Sensor, quantity: str, rows: slice, stations: int, names: tuple[str, ...]) -> ChannelSlice:
    errors = sensor.error(quantity)
    own, axes = rows.stop - rows.start, 3 if quantity in COMPONENTS else rows.stop - rows.start
    apart = any("," in key for key in errors.components)  # stations differ
    shape = (1, stations, axes) if apart else (1, axes)
    width = own if apart else axes
    turn = np.kron(np.eye(width // axes), mounting_matrix(sensor, quantity, axes))
    scale, bent, constant = np.zeros((3, *shape))
    later = []
    for place, part in errors.parts(shape):
        bias = np.zeros(shape)
        bias[place] = part.bias
        if part.bias_from is None:
            constant += bias
        elif bias.any():
            later.append((part.bias_from, turn @ bias.ravel()))
        scale[place] += part.scale_error
        bent[place] += part.scale_slope
    bias, gain, into = turn @ constant.ravel(), np.eye(width), np.eye(width)
    if quantity == "attitude":
        bias = bias + turn @ np.asarray(errors.misalignment, dtype=float)
    else:
        if errors.misaligned:
            into = np.array(block_diag(*(pin.exp3(t).T for t in errors.turns(shape).reshape(-1, 3))))
        gain = turn @ ((1.0 + scale).reshape(-1, 1) * into) @ turn.T
    bend = Bend(into @ turn.T, turn, bent.ravel()) if bent.any() else None
    plain = bend is None and not bias.any() and np.allclose(gain, np.eye(width), rtol=0.0, atol=1e-15)
    return ChannelSlice(
        sensor, quantity, rows, stations, names, gain, bias, errors.lag, plain, tuple(later), bend
    )


def mounting_matrix(sensor: Sensor, quantity: str, width: int) -> np.ndarray:
    """Return the matrix (width, width) that takes errors of a reading from the sensor's axes to the bus's.

    Places and velocities are read in inertial axes, whichever way the sensor is turned.
    """
    turned = any(sensor.orientation) and quantity in ("acceleration", "angular_rate", "attitude")
    return sensor.rotation if turned else np.eye(width)


def matrix(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrix (3, 3) of a quaternion (x, y, z, w)."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
