"""Zero-phase decimation that keeps every linear relation between channels exact."""

from __future__ import annotations

import numpy as np
import scipy  # loads a part of it when that is used

from smsid.errors import NotIdentifiableError

PASS_SHARE = 0.5
ATTENUATION = 80.0


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
    kaiser = "kaiser", scipy.signal.kaiser_beta(ATTENUATION)
    window = scipy.signal.firwin(taps, (1 + PASS_SHARE) / 2 / factor, window=kaiser)
    slow = scipy.signal.oaconvolve(x, window[:, None], mode="valid", axes=0)
    return np.asarray(slow)[::factor], rate / factor


def filter_length(factor: int) -> int:
    """Number of taps of the filter of `decimate`; odd."""
    if factor == 1:
        return 1
    taps, _ = scipy.signal.kaiserord(ATTENUATION, (1 - PASS_SHARE) / factor)
    return int(taps) | 1
