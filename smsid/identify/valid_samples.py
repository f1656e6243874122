"""Which samples of a channel can be used: finite, not at a sensor's limit, not far outside of their noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from smsid.errors import RecordingError
from smsid.sensing import Sensor

OUTLIER = 5.0  # standard deviations: one good sample in two million
MOST = 0.05  # share of samples that may be outliers; more of them is another noise, or a wrong model
STUCK = 5  # samples at one and the same extreme value that show a limit
NORM = 1e-3  # by which a quaternion may be longer or shorter than one


def usable_samples(values: np.ndarray, quantity: str, limit: float | None) -> np.ndarray:
    """Return which samples (N,) of (N, k) are finite and inside the sensor's limits.

    ``limit`` is the described one; without it, an extreme value that many samples share exactly is one,
    unless the channel is quantised.
    """
    flat = values.reshape(len(values), -1)
    good: Any = np.isfinite(flat).all(axis=1)
    if quantity == "attitude":
        return good & (np.abs(np.linalg.norm(flat, axis=1) - 1.0) < NORM)
    if limit is not None:
        return good & (np.abs(flat) < limit * (1.0 - 1e-12)).all(axis=1)
    for column in flat.T:
        inside = column[good]
        if len(inside) < STUCK or len(np.unique(inside)) < 0.5 * len(inside):
            continue
        for extreme in (inside.min(), inside.max()):
            at = column == extreme
            if np.count_nonzero(at) >= STUCK:
                good = good & ~at
    return good


def enough_usable(
    values: np.ndarray, sensor: Sensor, quantity: str, *, count: int = 0, share: float = 0.0
) -> np.ndarray:
    """Return which samples (N,) of a sensor's (N, k) are `usable_samples` by its described limits.

    Raises `RecordingError` when fewer than ``count`` are, or less than a ``share`` of them.
    """
    good = usable_samples(values, quantity, sensor.error(quantity).saturation)
    found, name = int(np.count_nonzero(good)), f"{sensor.name}.{quantity}"
    if found < count or found < share * len(good):
        part = 100.0 * found / max(len(good), 1)
        raise RecordingError(
            f"{found} of {len(good)} samples of '{name}' ({part:.2g} %) are finite and within the sensor's "
            "limits: too few.",
            advice="Leave the sensor out of the description, or record again, for longer.",
            channel=name,
        )
    return good


def outliers(residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which rows (N,) of a residual (N, k) are outliers, and the noise (k,) of the others.

    Judged against the median of what is left, so that outliers do not hide each other. Where more than `MOST`
    would be, none is: their distribution is another one.
    """
    sigma = np.median(np.abs(residual), axis=0) / 0.6744897501960817
    bad: Any = (np.abs(residual) > OUTLIER * np.maximum(sigma, 1e-300)).any(axis=1)
    if np.mean(bad) > MOST:
        bad = np.zeros(len(residual), dtype=bool)
    return bad, np.sqrt(np.mean(residual[~bad] ** 2, axis=0))


def spikes(values: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return which samples (N,) of a smooth motion stick out of the cubic through their neighbours.

    ``values`` (N, k), ``sigma`` (k,) of their noise. Of neighbours only the one that sticks out most is
    called a spike; of two alike it may be the good one beside them.
    """
    size = isolated_outliers(values, sigma)
    return np.asarray(((size > OUTLIER + 1.0) & (size >= largest_neighbour(size))).any(axis=1))


def isolated_outliers(values: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return how far ``values`` (N, k) are off the cubic through their neighbours, in ``sigma`` (N, k)."""
    off = np.zeros(values.shape)
    if len(values) >= 5:
        x = values
        off[2:-2] = x[2:-2] - (4.0 * (x[1:-3] + x[3:-1]) - x[:-4] - x[4:]) / 6.0
    return np.abs(off) / (np.sqrt(70.0) / 6.0 * sigma)


def largest_neighbour(size: np.ndarray) -> np.ndarray:
    """Return the largest of the two neighbours on each side, (N, k)."""
    return np.stack([np.roll(size, shift, axis=0) for shift in (-2, -1, 1, 2)]).max(axis=0)
