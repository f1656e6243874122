"""Decimation: zero phase, no aliasing, exact relations between channels."""

import numpy as np
import pytest
from scipy import signal

from smsid.errors import NotIdentifiableError
from smsid.identify.ssi_decimate import decimate, filter_length


@pytest.mark.parametrize("factor", [2, 8, 32])
def test_passes_slow_waves_in_phase_and_stops_what_would_alias(factor):
    rate, samples = 100.0, 8000
    t = np.arange(samples) / rate
    nyquist = rate / factor / 2
    slow, fast = np.sin(2 * np.pi * 0.45 * nyquist * t), np.sin(2 * np.pi * 1.05 * nyquist * t)
    y, new = decimate(np.column_stack([slow, fast]), rate, factor)
    assert new == rate / factor
    middle = filter_length(factor) // 2
    np.testing.assert_allclose(y[:, 0], slow[middle : samples - middle : factor], atol=2e-4)
    assert np.abs(y[:, 1]).max() < 2e-4


@pytest.mark.parametrize("factor", [2, 3, 16])
def test_it_is_the_filter_of_scipy(factor):
    x = np.random.default_rng(0).standard_normal((3001, 2))
    taps = signal.kaiserord(80.0, 0.5 / factor)[0] | 1
    assert filter_length(factor) == taps
    window = signal.firwin(taps, 0.75 / factor, window=("kaiser", signal.kaiser_beta(80.0)))
    wanted = signal.oaconvolve(x, window[:, None], mode="valid", axes=0)[::factor]
    np.testing.assert_allclose(decimate(x, 10.0, factor)[0], wanted, rtol=0.0, atol=1e-12)


def test_constant_and_untouched():
    x = np.full((500, 2), 3.0)
    np.testing.assert_allclose(decimate(x, 10.0, 4)[0], 3.0, rtol=1e-12)
    assert decimate(x, 10.0, 1)[0] is x
    assert filter_length(1) == 1 and filter_length(4) % 2 == 1


def test_too_short():
    with pytest.raises(NotIdentifiableError, match="decimate"):
        decimate(np.ones((50, 1)), 10.0, 8)
