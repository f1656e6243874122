"""What a filter expects of times to come: state and readings, with how surely."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from smsid._short_repr import short_repr
from smsid.simulate import Inputs
from smsid.tracking._parameter_filter import ParameterFilter
from smsid.tracking._setting import Setting


@short_repr
@dataclass(frozen=True, eq=False)
class StatePrediction:
    """The state at a time [s] to come: q (nq,), v (nv,), ``covariance`` (x, x) as `Tracker.covariance`.

    ``readings`` and ``sigmas`` by channel are what the sensors will read, and how surely, noise included;
    an attitude as quaternion (x, y, z, w) and rotation vector [rad].
    """

    time: float
    q: np.ndarray
    v: np.ndarray
    covariance: np.ndarray
    readings: Mapping[str, np.ndarray]
    sigmas: Mapping[str, np.ndarray]


def predict(now: ParameterFilter, inputs: Inputs, setting: Setting, horizon: float) -> StatePrediction:
    """Return state and readings ``horizon`` [s] ahead under ``inputs``; the filter is not changed."""
    ahead = now.snapshot()
    edges = fill_times(ahead.time, ahead.time + horizon, setting.longest)
    count = sum(b.quantity == "attitude" for b in ahead.layout.blocks)
    nothing = np.full((len(edges), ahead.layout.rows), np.nan), np.zeros((len(edges), count, 4))
    found = ahead.go_on(edges, ahead.drive(inputs, setting.substep, edges), *nothing)
    readings, sigmas = _readings(ahead, found.predicted[-1], found.sensitivity[-1])
    return StatePrediction(ahead.time, ahead.q, ahead.v, covariance_in_units(ahead), readings, sigmas)


def fill_times(start: float, end: float, longest: float) -> np.ndarray:
    """Return times (n,) from start to end [s], ``longest`` apart at most; one if they are the same."""
    if end <= start:
        return np.array([start])
    return np.linspace(start, end, max(1, int(np.ceil((end - start) / longest - 1e-9))) + 1)


def covariance_in_units(f: ParameterFilter) -> np.ndarray:
    """Return the covariance (x, x) of a filter's state, parameters in their units."""
    scale = np.ones(len(f.covariance))
    scale[f.parameters] = f.scales
    return f.covariance * np.outer(scale, scale)


def _readings(
    f: ParameterFilter, h: np.ndarray, sensitivity: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return what sensors read and with what standard deviations, by channel."""
    h = h + sensitivity @ f.reference_offset()
    variance = np.einsum("ij,jk,ik->i", sensitivity, f.covariance, sensitivity) + f.layout.sigma**2
    readings = {b.channel: h[b.rows] for b in f.layout.blocks}
    for b in f.layout.blocks:
        if b.quantity == "attitude":
            readings[b.channel] = f.q[3:7].copy()
    return readings, {b.channel: np.sqrt(variance[b.rows]) for b in f.layout.blocks}
