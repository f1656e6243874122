"""Zero-phase decimation that keeps every linear relation between channels exact."""

from __future__ import annotations

import math

import numpy as np

from smsid.errors import NotIdentifiableError

PASS_SHARE = 0.5
ATTENUATION = 80.0  # [dB]
KAISER_BETA = 0.1102 * (ATTENUATION - 8.7)  # Kaiser's rule for more than 50 dB


def decimate(x: np.ndarray, rate: float, factor: int) -> tuple[np.ndarray, float]:
    """Low-pass and keep every ``factor``-th sample.

    A linear-phase FIR filter (Kaiser window, 80 dB), centred, so that it delays nothing; samples whose window
    reaches beyond the record are dropped rather than padded. Channels filtered together stay related by the
    same transfer functions, steps and all, which IIR filters run forwards and backwards with padding do not
    grant at the ends. Passes up to half the new Nyquist frequency.

    Args:
        x: (N, channels).
        rate: sampling rate [Hz].
        factor: integer decimation factor; 1 returns ``x`` as it is.

    Returns:
        ``((N', channels), rate / factor)``.

    Raises:
        NotIdentifiableError: the record is shorter than the filter.
    """
    if factor == 1:
        return x, rate
    taps = filter_length(factor)
    if len(x) < taps:
        raise NotIdentifiableError(
            f"{len(x)} samples are too few to decimate by {factor}: the filter takes {taps}.",
            advice="Use a longer recording or a higher rate.",
            samples=len(x),
            taps=taps,
        )
    cutoff = (1 + PASS_SHARE) / 2 / factor
    window = np.sinc(cutoff * (np.arange(taps) - taps // 2)) * np.kaiser(taps, KAISER_BETA)
    window /= window.sum()
    # Blocks of ``factor`` samples times those of the window: of the filtered samples those that are kept.
    width, count = -(-taps // factor), (len(x) - taps) // factor + 1
    blocks = np.zeros((count + width - 1, factor, x.shape[1]))
    known = x[: blocks.shape[0] * factor]
    blocks.reshape(-1, x.shape[1])[: len(known)] = known
    parts = np.tensordot(blocks, np.pad(window, (0, width * factor - taps)).reshape(width, factor), (1, 1))
    return np.sum([parts[j : j + count, :, j] for j in range(width)], axis=0), rate / factor


def filter_length(factor: int) -> int:
    """Number of taps of the filter of `decimate`; odd."""
    if factor == 1:
        return 1
    return math.ceil((ATTENUATION - 7.95) / (2.285 * math.pi * (1 - PASS_SHARE) / factor) + 1) | 1
