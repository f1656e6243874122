"""Biases that wander as a description states it: states of the filter, beside motion and unknown inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from smsid.estimation.measurements import ChannelSlice, Measurements, mounting_matrix
from smsid.kernel.filter_arrays import StateParameters
from smsid.sensing.error_model import ErrorModel

if TYPE_CHECKING:
    from smsid.estimation.filter_pass import Moment

LONG_MEMORY = 1.0 / np.sqrt(3.0)  # of a recording: the correlation time from which a walk is the nearer bound


@dataclass(frozen=True)
class BiasWalk:
    """A random walk that is added to readings: ``column`` (rows,) of it, ``rate`` [unit/sqrt(s)], and its
    standard deviation ``sigma`` [unit] at the first sample.
    """

    column: np.ndarray
    rate: float
    sigma: float = 0.0

    def after(self, seconds: float) -> BiasWalk:
        """Return the walk as it is known when it has gone on for some time [s]."""
        return replace(self, sigma=float(np.hypot(self.sigma, self.rate * np.sqrt(seconds))))


def walk_rate(errors: ErrorModel, seconds: float = 0.0) -> np.ndarray:
    """Return by how much a bias wanders, () or (axes,) [unit/sqrt(s)].

    An in-run bias (Gauss-Markov, s and T) wanders at first by 2 s^2 / T a second. A walk of that rate and a
    constant of s bound it from above; over a recording of ``seconds`` that is long beside T, `walk_noise` is
    the nearer bound.
    """
    rate = np.asarray(errors.random_walk, dtype=float)
    if errors.bias_correlation_time is not None and errors.bias_correlation_time >= LONG_MEMORY * seconds:
        rate = np.hypot(rate, errors.gauss_markov_sigma * np.sqrt(2.0 / errors.bias_correlation_time))
    return rate


def walk_noise(errors: ErrorModel, rate: float, seconds: float) -> np.ndarray:
    """Return one sigma () or (axes,) [unit] of white noise at ``rate`` [Hz] in place of a fast in-run bias.

    Its density is that of the in-run bias at low frequencies, 2 s^2 T, where it is largest.
    """
    if errors.bias_correlation_time is None or errors.bias_correlation_time >= LONG_MEMORY * seconds:
        return np.zeros(())
    return errors.gauss_markov_sigma * np.sqrt(2.0 * errors.bias_correlation_time * rate)


def with_walk_noise(data: Measurements) -> Measurements:
    """Return readings with more noise in place of in-run biases that are fast beside the recording."""
    seconds, sigma = float(data.times[-1] - data.times[0]), data.sigma.copy()
    for block in data.blocks:
        read = np.isfinite(data.values[:, block.rows]).any(axis=1).sum()
        more = walk_noise(block.sensor.error(block.quantity), float(read) / seconds, seconds)
        sigma[block.rows] = np.hypot(sigma[block.rows], np.resize(more, len(sigma[block.rows])))
    return replace(data, sigma=sigma)


def bias_walks(data: Measurements) -> tuple[BiasWalk, ...]:
    """Return the walks of all channels, one for each of their components: each is drawn apart."""
    seconds = float(data.times[-1] - data.times[0])
    out = []
    for block in data.blocks:
        for i, rate in enumerate(rates_of(block, seconds)):
            if rate > 0.0:
                out.append(BiasWalk(unit_bias(block, i, data.rows), float(rate)))
    return tuple(out)


def rates_of(block: ChannelSlice, seconds: float = 0.0) -> np.ndarray:
    """Return by how much each component of a channel wanders (rows of the block,) [unit/sqrt(s)]."""
    rate, rows = walk_rate(block.sensor.error(block.quantity), seconds), block.rows.stop - block.rows.start
    return np.resize(rate, rows) if rate.ndim else np.full(rows, float(rate))


def unit_bias(block: ChannelSlice, component: int, rows: int) -> np.ndarray:
    """Return what a unit bias of a component of a channel adds to all readings (rows,)."""
    out, width = np.zeros(rows), len(block.bias)
    out[block.rows.start + component] = 1.0
    if any(block.sensor.orientation) and width % 3 == 0:  # along the sensor's own axes
        at = block.rows.start + component - component % 3
        out[at : at + 3] = mounting_matrix(block.sensor, block.quantity, 3)[:, component % 3]
    return out


class BiasWalks:
    """The walks of a problem as the filter takes parameters: values in units of their rate over a second.

    Readings are linear in them and motion does not know them: models stay about the motion as it is believed.
    """

    def __init__(self, walks: Sequence[BiasWalk], rows: int) -> None:
        self.scales = np.array([w.rate for w in walks])
        self.values, self.rates = np.zeros(len(walks)), np.ones(len(walks))
        self.close = np.full(len(walks), np.inf)
        self.trends = np.zeros((0, 2), dtype=np.int64), np.zeros(0)
        columns = np.array([w.rate * w.column for w in walks]).reshape(-1, rows)
        self.columns = np.ascontiguousarray(columns.T)
        self.begin = np.array([(w.sigma / w.rate) ** 2 for w in walks])

    def accelerations(self, moment: Moment, push: np.ndarray) -> np.ndarray:
        """Return that accelerations (nv, m) do not depend on them."""
        return np.zeros((len(moment.v), len(self.scales)))

    def readings(self, moment: Moment, forces: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Return how readings change with them (rows, m), per scale."""
        return self.columns

    def compiled_tables(self, nothing: StateParameters) -> StateParameters:
        """Return them as the compiled filter takes them, from those of a model without any."""
        return nothing._replace(
            scales=self.scales, at=self.values, rates=self.rates, columns=self.columns, close=self.close
        )
