"""What outputs show before any model: lines of machines, and how long correlations last."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.stats import kurtosis

from smsid.errors import NotIdentifiableError

LINE = 40.0
"""Height of a line over its neighbourhood; the largest of fifty bins of noise reaches about eight."""

LINE_KURTOSIS = 2.25
"""Half way between a sine's 1.5 and a Gaussian's 3."""


def spectral_lines(y: np.ndarray, rate: float, highest: float) -> tuple[float, ...]:
    """Return the sines in y (N, l) up to ``highest`` [Hz]: lines that stand out of the spectrum about them.

    A line holds `LINE` times the median of its neighbourhood in one bin of the whole record's periodogram,
    which the scatter of noise does not do, and its band has the kurtosis of a sine.
    """
    power = np.sum(np.abs(np.fft.rfft(y * np.hanning(len(y))[:, None], axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(len(y), 1.0 / rate)
    reach = 25
    found: list[float] = []
    for k in np.flatnonzero(power[reach:-reach] > LINE * np.median(power)) + reach:
        around = power[k - reach : k + reach + 1]
        sine = power[k] == around.max() and power[k] > LINE * np.median(around)
        width = 2.0 * reach * rate / len(y)
        if sine and frequency[k] <= highest and band_kurtosis(y, rate, frequency[k], width) < LINE_KURTOSIS:
            found.append(float(frequency[k]))
    return tuple(found)


def correlation_window(y: np.ndarray, rate: float) -> float:
    """Return how long autocorrelations of y (N, l) stand out of their scatter [s]; the strongest output
    counts.

    Raises:
        NotIdentifiableError: none does beyond a few samples.
    """
    strongest = y[:, int(np.argmax(np.var(y, axis=0)))]
    size = 2 ** int(np.ceil(np.log2(2 * strongest.size)))
    power = np.abs(np.fft.rfft(strongest - strongest.mean(), size)) ** 2
    correlation = np.fft.irfft(power)[: strongest.size // 4]
    correlation = correlation / correlation[0]
    scatter = np.sqrt((1.0 + 2.0 * np.cumsum(correlation**2)) / strongest.size)
    step = max(int(0.1 * rate), 4)
    envelope = np.array([np.abs(correlation[k : k + step]).max() for k in range(correlation.size - step)])
    loud = envelope >= 2.0 * scatter[: envelope.size]
    # Close modes beat: quiet is what stays quiet for as long again.
    quiet = (k for k in range(1, loud.size) if not loud[k] and not loud[k : 2 * k].any())
    last = next(quiet, loud.size - 1)
    if last < 4:
        raise NotIdentifiableError(
            "No correlation of the outputs stands out: they look white.",
            advice="Is the structure excited, and the sensor sensitive enough?",
        )
    return last / rate


def band_kurtosis(y: np.ndarray, rate: float, frequency: float, width: float) -> float:
    """Return the kurtosis of y (N, l) in a band [Hz] about a frequency, of the output strongest there.

    Three for a mode that noise excites, 1.5 for a sine (Jacobsen, Andersen and Brincker 2007; the kurtosis is
    that of `scipy.stats.kurtosis`).
    """
    low, high = max(frequency - width / 2, 1e-3 * rate), min(frequency + width / 2, 0.499 * rate)
    band = sosfiltfilt(butter(2, (low, high), "bandpass", fs=rate, output="sos"), y, axis=0)
    strongest = band[:, int(np.argmax(np.var(band, axis=0)))]
    return float(kurtosis(strongest, fisher=False))
