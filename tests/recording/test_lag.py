"""Lags between signals with clocks of their own."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.errors import RecordingError
from smsid.recording.lag import estimate_lag


def motion(t):
    return np.sin(2.1 * t) + 0.5 * np.sin(5.3 * t + 1.0) + 0.2 * np.sin(17.0 * t + 2.0)


@pytest.mark.parametrize("lag", [-0.0314, 0.0, 0.0012, 0.0267])
@pytest.mark.parametrize("gain", [3.0, -0.2])
def test_lags_finer_than_a_sample_of_jittered_clocks_of_two_rates(lag, gain):
    rng = np.random.default_rng(3)
    t1 = np.arange(0.0, 20.0, 0.002) + 1e-4 * rng.normal(size=10000)
    t2 = np.arange(0.0, 20.0, 0.005) + 2e-4 * rng.normal(size=4000)
    x1 = motion(t1) + 0.01 * rng.normal(size=t1.size)
    x2 = gain * (motion(t2 - lag) + 0.01 * rng.normal(size=t2.size)) + 7.0
    found = estimate_lag((t1, x1), (t2, x2), largest=0.1)
    assert abs(found.value - lag) < max(4.0 * found.sigma, 1e-5)
    assert found.sigma < 5e-4
    assert found.gain == pytest.approx(gain, rel=0.02)


def test_intervals_hold_the_truth():
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 20.0, 0.01)
    hits = 0
    for _ in range(60):
        x = motion(t) + 0.2 * rng.normal(size=t.size)
        y = motion(t - 0.02) + 0.2 * rng.normal(size=t.size)
        low, high = estimate_lag((t, x), (t, y), largest=0.1).interval
        hits += low <= 0.02 <= high
    assert hits >= 48


@pytest.mark.parametrize(
    ("second", "text"),
    [
        (lambda t: np.random.default_rng(1).normal(size=t.size), "not alike"),
        (lambda t: motion(t - 0.3), "end of the search|not alike"),
        (lambda t: np.zeros_like(t), "constant"),
        (lambda t: np.where(t > 5.0, np.nan, 1.0), "not finite"),
    ],
)
def test_what_has_no_lag_is_refused(second, text):
    t = np.arange(0.0, 20.0, 0.01)
    with pytest.raises(RecordingError, match=text):
        estimate_lag((t, motion(t)), (t, second(t)), largest=0.1)


def test_too_short_a_record_is_refused():
    t = np.arange(0.0, 1.0, 0.01)
    with pytest.raises(RecordingError, match="need more"):
        estimate_lag((t, motion(t)), (t, motion(t)), largest=0.4)
