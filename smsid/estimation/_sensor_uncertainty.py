"""By how much readings may be off, beside their noise, where errors of sensors are unknown."""

from __future__ import annotations

import numpy as np

from smsid.effects.base import Effect
from smsid.errors import DescriptionError
from smsid.estimation.measurements import ChannelSlice, Measurements
from smsid.estimation.parameter_vector import Point
from smsid.estimation.unknowns import effect_unknown
from smsid.parameter import Parameter

RATE_SPAN = 1.0  # [s] over which the rate of a reading is taken, for clocks that are off


def reading_uncertainty(point: Point, data: Measurements) -> np.ndarray:
    """Return standard deviations (rows,) of the first readings by the priors of the errors of sensors.

    Each parameter of an effect is moved by its standard deviation, or as far as it goes; what this does to
    gain, bias, delay and place of the sensors is added up in squares, in the units of the readings.
    """
    variance = np.zeros(data.rows)
    before = data.with_blocks(point.sensors()).blocks
    for effect in point.description.effect:
        for p in effect.unknowns():
            other = _with_deviation(effect, p)
            if other is None:
                continue
            sensors = point.with_effect(other).sensors()
            for old, new in zip(before, data.with_blocks(sensors).blocks, strict=True):
                if old is not new:
                    variance[old.rows] += _change(data, old, new) ** 2
    for block in before:
        variance[block.rows] += _stated_variance(data, block)
    return np.sqrt(variance)


def _stated_variance(data: Measurements, block: ChannelSlice) -> np.ndarray:
    """Return the variance of the first reading of a channel (rows of the block,) by what a sensor states of
    its bias, scale and misalignment, which every recording has its own of.
    """
    errors, x = block.sensor.error(block.quantity), data.values[:, block.rows]
    bias = np.hypot(np.asarray(errors.bias_sigma, dtype=float), errors.gauss_markov_sigma)
    turn, scale = (np.asarray(s, dtype=float) for s in (errors.misalignment_sigma, errors.scale_sigma))
    if block.quantity == "attitude":
        return np.resize(bias**2 + turn**2, x.shape[1])
    there = np.flatnonzero(np.isfinite(x).all(axis=1))
    first = x[there[0]] if len(there) else np.zeros(x.shape[1])
    own = np.resize(bias, x.shape[1]) ** 2 + (np.resize(scale, x.shape[1]) * first) ** 2
    if turn.any():
        own = own + np.repeat(turn.max() * np.linalg.norm(first.reshape(-1, 3), axis=1), 3) ** 2
    return own


def _with_deviation(effect: Effect, p: Parameter) -> Effect | None:
    """Return the effect with a parameter a standard deviation up, or down; ``None`` where it has no room."""
    sigma = effect_unknown(p).sigma
    for value in (p.value + sigma, p.value - sigma, p.upper, p.lower):
        if p.lower <= value <= p.upper and np.isfinite(value):
            try:
                return effect.with_values({p.name: float(value)})
            except DescriptionError:
                continue
    return None


def _change(data: Measurements, old: ChannelSlice, new: ChannelSlice) -> np.ndarray:
    """Return by how much the first reading of a channel changes (rows of the block,)."""
    x = data.values[:, old.rows]
    there = np.flatnonzero(np.isfinite(x).all(axis=1))
    out = np.abs(np.resize(new.bias, x.shape[1]) - np.resize(old.bias, x.shape[1]))
    if not len(there):
        return out
    if old.quantity != "attitude":
        first = x[there[0]]
        read = [(first.reshape(-1, len(b.gain)) @ b.gain.T).ravel() for b in (old, new)]  # by station
        out = out + np.abs(read[1] - read[0])
    if new.delay != old.delay:
        later = there[data.times[there] <= data.times[there[0]] + RATE_SPAN]
        span = float(data.times[later[-1]] - data.times[later[0]])
        if span > 0.0:
            out = out + abs(new.delay - old.delay) * np.abs(x[later[-1]] - x[later[0]]) / span
    if old.quantity == "position":
        out = out + float(np.linalg.norm(np.subtract(new.sensor.position, old.sensor.position)))
    return out
