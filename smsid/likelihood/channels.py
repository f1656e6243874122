"""The measured channels a prediction is compared with: samples, clocks, noise, and biases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky_banded
from scipy.sparse import csr_array, diags_array

from smsid.errors import RecordingError
from smsid.identify.clocks import event_times
from smsid.identify.robust import white_sigma
from smsid.identify.valid_samples import enough_usable
from smsid.likelihood.time_grid import POINTS, Timeline
from smsid.model.spacecraft import SpacecraftModel
from smsid.model.stations import find_appendage
from smsid.recording import Recording
from smsid.recording.attitude import turn_between
from smsid.sensing import Sensor

QUANTITIES = ("position", "attitude", "velocity", "angular_rate", "acceleration")
BIASED = ("angular_rate", "acceleration")
"""Quantities with a constant bias per recording and axis. A pose sensor's is part of the initial pose."""
ROUNDING = 1e-10
FEWEST = 20  # samples of a channel


@dataclass(frozen=True)
class Channel:
    """One measured channel: samples (N, k) at times (N,) [s]; attitudes are quaternions (N, 4).

    ``covariance`` (k, k) of the noise of a sample, an attitude's as rotation vector (3, 3); panel
    accelerometers come station after station. ``weights`` (M, nodes) takes predictions from the nodes to all
    samples of the clock, which channels share, ``coarse_weights`` those at the nodes of the coarse grid;
    ``rows`` (N,) of them are the channel's, ``None`` for all. ``root`` R (coarse nodes, coarse nodes) is
    upper banded with R^T R = W^T W of its own coarse ones. ``dropped`` counts samples left out.
    """

    sensor: Sensor
    quantity: str
    times: np.ndarray
    values: np.ndarray
    covariance: np.ndarray
    weights: csr_array
    coarse_weights: csr_array
    root: csr_array
    rows: np.ndarray | None = None
    dropped: int = 0

    @property
    def name(self) -> str:
        """Name of the channel."""
        return f"{self.sensor.name}.{self.quantity}"

    @property
    def width(self) -> int:
        """Number of components of the residual."""
        return len(self.covariance)

    @property
    def biased(self) -> bool:
        """Whether it has a constant bias."""
        return self.quantity in BIASED

    @property
    def whitening(self) -> np.ndarray:
        """Matrix (k, k) that makes the noise of a sample white with unit variance."""
        return np.linalg.inv(np.linalg.cholesky(self.covariance))

    def only(self, kept: np.ndarray, *, counted: bool = True) -> Channel:
        """Return the channel with some of its samples (N,); ``counted``: the others as dropped."""
        rows = np.arange(len(self.times)) if self.rows is None else self.rows
        gone = self.coarse_weights[rows[~kept]]
        return replace(
            self,
            times=self.times[kept],
            values=self.values[kept],
            rows=rows[kept],
            root=gram_root(csr_array(self.root.T @ self.root - gone.T @ gone)),
            dropped=self.dropped + (int(np.count_nonzero(~kept)) if counted else 0),
        )

    def with_covariance(self, covariance: np.ndarray) -> Channel:
        """Return the channel with another noise ``covariance`` (k, k)."""
        return replace(self, covariance=covariance)

    def at_samples(self, nodes: np.ndarray) -> np.ndarray:
        """Return values at the samples (N, k) from those at the nodes."""
        found = self.weights @ nodes
        return found if self.rows is None else found[self.rows]

    def to_coarse(self, samples: np.ndarray) -> np.ndarray:
        """Return the coarse weights' transpose times what is at the samples (N, k): (coarse nodes, k)."""
        if self.rows is not None:
            whole = np.zeros((self.coarse_weights.shape[0], samples.shape[1]))  # type: ignore[index]
            whole[self.rows], samples = samples, whole
        return self.coarse_weights.T @ samples

    def residual(
        self, nodes: np.ndarray, bias: np.ndarray | None, weights: csr_array | None = None
    ) -> np.ndarray:
        """Return measured minus predicted (N, k) from predictions at the nodes, ``bias`` (k,) added to them.

        ``weights`` in place of W.
        """
        predicted = self.at_samples(nodes) if weights is None else weights @ nodes
        if self.quantity == "attitude":
            return turn_between(predicted, self.values)
        return self.values - predicted if bias is None else self.values - predicted - bias


def common_span(model: SpacecraftModel, recording: Recording) -> tuple[float, float]:
    """Return the first and last time [s] of all channels used; `RecordingError` when there are none."""
    times = [event_times(recording, s, q) for s, q in usable_channels(model, recording)]
    if not times:
        raise RecordingError(
            f"'{recording.name}' has no channel of a sensor of the description.",
            advice="Import it with the description's sensor names.",
            channels=recording.channels,
        )
    return min(float(t[0]) for t in times), max(float(t[-1]) for t in times)


def usable_channels(model: SpacecraftModel, recording: Recording) -> list[tuple[Sensor, str]]:
    """Return sensors and quantities the recording has and a prediction explains."""
    return [
        (s, q)
        for s in model.description.effective_sensors()
        for q in QUANTITIES
        if q in s.quantities and f"{s.name}.{q}" in recording
    ]


def measured_channels(
    model: SpacecraftModel, recording: Recording, timeline: Timeline, sigma: dict[str, np.ndarray] | None
) -> tuple[Channel, ...]:
    """Return the channels of a recording; noise from the samples, or given by channel name (k,).

    Raises `RecordingError` when a panel's columns do not fit, or a channel has too few usable samples.
    """
    found = []
    weights_at = _Weights(timeline)
    for sensor, quantity in usable_channels(model, recording):
        name = f"{sensor.name}.{quantity}"
        values = recording[name]
        if sensor.kind == "accelerometers":
            find_appendage(model, str(sensor.appendage))
            values = values.reshape(len(values), -1)
        times = event_times(recording, sensor, quantity)
        kept = enough_usable(values, sensor, quantity, count=FEWEST)
        if not kept.all():
            times, values = times[kept], values[kept]
        size = _noise(values, quantity) if sigma is None else np.asarray(sigma[name], dtype=float)
        found.append(
            Channel(
                sensor,
                quantity,
                times,
                values,
                np.diag(size**2),
                *weights_at(times),
                dropped=int(np.count_nonzero(~kept)),
            )
        )
    return tuple(found)


def on_timeline(channels: Sequence[Channel], timeline: Timeline) -> tuple[Channel, ...]:
    """Return the channels to be compared with predictions on another grid."""
    weights_at = _Weights(timeline)
    out = []
    for c in channels:
        weights, coarse, root = weights_at(c.times)
        out.append(replace(c, weights=weights, coarse_weights=coarse, root=root, rows=None))
    return tuple(out)


class _Weights:
    """Weights, coarse ones and their root by times of samples (N,) [s]; equal times share them."""

    def __init__(self, timeline: Timeline) -> None:
        self._timeline = timeline
        self._shared: dict[bytes, tuple[csr_array, csr_array, csr_array]] = {}

    def __call__(self, times: np.ndarray) -> tuple[csr_array, csr_array, csr_array]:
        key = times.tobytes()
        if key not in self._shared:
            coarse = self._timeline.coarse.interpolation(times)
            root = gram_root(csr_array(coarse.T @ coarse))
            self._shared[key] = self._timeline.interpolation(times), coarse, root
        return self._shared[key]


def gram_root(gram: csr_array) -> csr_array:
    """Return R (nodes, nodes), upper banded, with R^T R = W^T W, which is ``gram``.

    Where samples are missing W^T W is singular; what is added for its sake is `ROUNDING` of the largest
    entry.
    """
    n = int(gram.shape[1])  # type: ignore[index]
    bands = np.zeros((POINTS, n))
    for d in range(POINTS):
        bands[POINTS - 1 - d, d:] = gram.diagonal(d)
    bands[-1] += ROUNDING * bands[-1].max()
    found = cholesky_banded(bands)
    parts = [found[POINTS - 1 - d, d:] for d in range(POINTS)]
    return csr_array(diags_array(parts, offsets=list(range(POINTS)), shape=(n, n)))  # type: ignore[arg-type]


def described_sigma(sensor: Sensor, quantity: str, width: int) -> np.ndarray:
    """Return one sigma (width,) of a sample's white noise as the description states it."""
    sigma = sensor.error(quantity).white_sigma(sensor.rate)
    return np.broadcast_to(
        np.tile(sigma, width // max(np.size(sigma), 1)) if np.size(sigma) > 1 else sigma, width
    )


def _noise(values: np.ndarray, quantity: str) -> np.ndarray:
    if quantity == "attitude":
        # increments of the rotation vector: their second differences are third ones of the angle
        d = np.diff(turn_between(values[:-1], values[1:]), n=2, axis=0)
        sigma = np.median(np.abs(d), axis=0) / 0.6744897501960817 / np.sqrt(20.0)
    else:
        sigma = np.asarray(white_sigma(values))
    floor = 1e-9 * max(float(np.abs(values).max()), 1e-9)
    return np.maximum(sigma, floor)
