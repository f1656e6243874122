"""What modes explain of a structure's correlations, measured against fitted."""

from __future__ import annotations

import numpy as np

from smsid.identify.ssi_decimate import decimate
from smsid.lab.modal import AmbientModes
from smsid.report.traces import Trace

MOST = 12  # outputs shown


def correlation_traces(y: np.ndarray, rate: float, found: AmbientModes) -> tuple[Trace, ...]:
    """Return the autocorrelation of outputs over lag, measured and as modes and harmonics make it.

    ``y`` (N, l) at ``rate`` [Hz]. Frequencies and damping are those identified; the share and phase of each
    mode in each output are fitted here, by least squares. The noise is the scatter of a correlation of so
    long a record about zero (Bartlett 1946). The strongest output is first, `MOST` are returned.
    """
    slow, slow_rate = decimate(y - y.mean(axis=0), rate, max(1, round(rate / found.rate)))
    slow = slow - slow.mean(axis=0)
    count = min(max(int(found.window * slow_rate), 8), len(slow) // 4)
    lags = np.arange(1, count + 1) / slow_rate  # the first holds white noise too
    basis = _basis(found, lags)
    strongest = np.argsort(-np.var(slow, axis=0), kind="stable")[:MOST]
    out = []
    for k in strongest.tolist():
        measured = _autocorrelation(slow[:, k], count)
        fitted = basis @ np.linalg.lstsq(basis, measured, rcond=None)[0]
        scatter = float(np.sqrt((1.0 + 2.0 * np.sum(measured**2)) / len(slow)))
        out.append(Trace(f"output {k + 1}", "1", lags, measured, fitted, measured - fitted, scatter))
    return tuple(out)


def _autocorrelation(x: np.ndarray, count: int) -> np.ndarray:
    """Correlations (count,) at lags of one sample and more, relative to the variance."""
    size = 2 ** int(np.ceil(np.log2(2 * len(x))))
    full = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: count + 1]
    return full[1:] / full[0]


def _basis(found: AmbientModes, lags: np.ndarray) -> np.ndarray:
    """Decaying cosines and sines (lags, columns) of the modes, lasting ones of the harmonics."""
    columns = [np.zeros_like(lags)]
    for frequency, damping in [(m.frequency, m.damping) for m in found.modes] + [
        (f, 0.0) for f in found.harmonics
    ]:
        w = 2.0 * np.pi * frequency
        fade = np.exp(-damping * w * lags)
        turn = w * np.sqrt(1.0 - damping**2) * lags
        columns += [fade * np.cos(turn), fade * np.sin(turn)]
    return np.stack(columns, axis=1)
