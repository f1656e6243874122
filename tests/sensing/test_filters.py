"""Filters against the analytic Butterworth response, and what they refuse."""

import numpy as np
import pytest
from scipy.signal import correlate

from smsid.errors import RecordingError
from smsid.sensing import decimate, differentiate, lowpass, zero_phase, zero_phase_transposed

RATE = 200.0


def tone(frequency, seconds=40.0):
    t = np.arange(int(seconds * RATE)) / RATE
    return t, np.sin(2 * np.pi * frequency * t)


def phasor(t, y, frequency):
    """Complex amplitude of a steady tone from the middle of the record, whole periods."""
    middle = (t > 10.0) & (t <= 30.0)
    return 2.0 * np.mean(y[middle] * np.exp(-2j * np.pi * frequency * t[middle]))


def butterworth(frequency, cutoff, order):
    """Digital Butterworth response by the bilinear transform from its analogue poles."""

    def warp(f):
        return 2.0 * RATE * np.tan(np.pi * f / RATE)

    s = 1j * warp(frequency) / warp(cutoff)
    poles = np.exp(1j * np.pi * (2 * np.arange(1, order + 1) + order - 1) / (2 * order))
    return np.prod(-poles) / np.prod(s - poles)


@pytest.mark.parametrize("order", [2, 4, 5])
@pytest.mark.parametrize("frequency", [1.0, 5.0, 10.0, 20.0])
def test_lowpass_has_the_butterworth_response(frequency, order):
    t, x = tone(frequency)
    gain = phasor(t, lowpass(x, RATE, 10.0, order), frequency) / phasor(t, x, frequency)
    assert gain == pytest.approx(butterworth(frequency, 10.0, order), abs=1e-6)


def test_lowpass_is_3_db_and_zero_phase_6_db_down_at_the_cutoff():
    t, x = tone(10.0)
    assert abs(phasor(t, lowpass(x, RATE, 10.0), 10.0)) == pytest.approx(np.sqrt(0.5), abs=1e-6)
    assert abs(phasor(t, zero_phase(x, RATE, 10.0), 10.0)) == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("frequency", [1.0, 5.0, 10.0, 20.0])
def test_zero_phase_has_the_squared_gain_and_no_phase(frequency):
    t, x = tone(frequency)
    gain = phasor(t, zero_phase(x, RATE, 10.0, 4), frequency) / phasor(t, x, frequency)
    assert gain == pytest.approx(abs(butterworth(frequency, 10.0, 4)) ** 2, abs=1e-6)


def test_zero_phase_does_not_shift_broadband_data_and_lowpass_does():
    x = np.random.default_rng(0).normal(size=4000)
    lags = np.arange(-3999, 4000)
    still, late = zero_phase(x, RATE, 10.0), lowpass(x, RATE, 10.0)
    assert lags[np.argmax(correlate(still, x))] == 0
    assert lags[np.argmax(correlate(late, x))] > 5


def test_causal_means_the_past_does_not_see_the_future():
    x = np.random.default_rng(1).normal(size=300)
    changed = x.copy()
    changed[200:] += 5.0
    assert np.array_equal(lowpass(x, RATE, 10.0)[:200], lowpass(changed, RATE, 10.0)[:200])


def test_steady_start_holds_a_constant_and_the_other_starts_from_rest():
    x = np.full((400, 2, 3), 7.0)
    assert np.allclose(lowpass(x, RATE, 5.0), 7.0)
    assert abs(lowpass(x, RATE, 5.0, steady_start=False)[0, 0, 0]) < 0.01
    assert np.allclose(zero_phase(x, RATE, 5.0), 7.0)


@pytest.mark.parametrize("run", [lowpass, zero_phase, differentiate])
def test_columns_are_filtered_apart(run):
    x = np.random.default_rng(2).normal(size=(300, 2, 3))
    whole = run(x, RATE, 10.0)
    assert whole.shape == x.shape
    assert np.allclose(whole[:, 1, 2], run(x[:, 1, 2], RATE, 10.0))


def test_decimation_keeps_the_band_and_removes_what_would_alias():
    t, slow = tone(2.0)
    _, fast = tone(49.0)
    y = decimate(slow + fast, RATE, 5)
    middle = slice(100, -100)
    assert y.shape == (len(t) // 5,)
    assert np.allclose(y[middle], slow[::5][middle], atol=1e-3)
    assert np.array_equal(decimate(slow, RATE, 1), slow)


def test_decimation_does_not_shift():
    t, x = tone(3.0)
    gain = phasor(t[::4], decimate(x, RATE, 4), 3.0) / phasor(t, x, 3.0)
    assert abs(np.angle(gain)) < 1e-6


@pytest.mark.parametrize("frequency", [0.5, 2.0])
def test_derivative_of_a_sine(frequency):
    t, x = tone(frequency)
    y = differentiate(x, RATE, 20.0)
    omega = 2 * np.pi * frequency
    middle = (t > 1.0) & (t < 39.0)
    assert np.allclose(y[middle], omega * np.cos(omega * t[middle]), atol=1e-5 * omega)


def test_derivative_of_a_line_is_its_slope_to_the_ends():
    t = np.arange(200) / RATE
    assert np.allclose(differentiate(3.0 - 2.0 * t, RATE, 20.0), -2.0, atol=1e-3)


def test_a_rate_read_off_a_clock_changes_nothing():
    x = np.random.default_rng(4).normal(size=500)
    assert np.allclose(zero_phase(x, RATE * (1 + 1e-10), 5.0), zero_phase(x, RATE, 5.0), atol=1e-7)


def test_derivative_amplifies_white_noise_as_documented():
    density, cutoff = 1e-3, 5.0
    x = density * np.sqrt(RATE) * np.random.default_rng(3).normal(size=(20_000, 8))
    sigma = differentiate(x, RATE, cutoff)[500:-500].std()
    assert sigma == pytest.approx(4.58 * density * cutoff**1.5, rel=0.03)


@pytest.mark.parametrize("run", [lowpass, zero_phase, differentiate])
@pytest.mark.parametrize("cutoff", [0.0, -1.0, 100.0, 150.0, np.nan])
def test_cutoff_must_be_below_nyquist(run, cutoff):
    with pytest.raises(RecordingError, match="Nyquist") as caught:
        run(np.zeros(500), RATE, cutoff)
    assert caught.value.evidence["nyquist"] == 100.0


@pytest.mark.parametrize("run", [lowpass, zero_phase, differentiate])
def test_samples_must_be_finite(run):
    x = np.zeros((500, 2))
    x[17, 1] = np.nan
    with pytest.raises(RecordingError, match="number 17"):
        run(x, RATE, 10.0)


@pytest.mark.parametrize("run", [zero_phase, differentiate])
def test_short_records_are_refused_with_the_length_needed(run):
    with pytest.raises(RecordingError, match="too short") as caught:
        run(np.zeros(20), RATE, 1.0)
    needed = caught.value.evidence["needed"]
    assert run(np.zeros(needed), RATE, 1.0).shape == (needed,)


def test_nothing_is_refused_by_lowpass():
    with pytest.raises(RecordingError, match="too short"):
        lowpass(np.zeros(0), RATE, 1.0)


@pytest.mark.parametrize("factor", [0, -2, 2.5])
def test_decimation_factor_is_a_positive_whole_number(factor):
    with pytest.raises(RecordingError, match="decimated"):
        decimate(np.zeros(500), RATE, factor)


def test_order_is_positive():
    with pytest.raises(RecordingError, match="order"):
        lowpass(np.zeros(500), RATE, 1.0, order=0)


def test_the_transposed_zero_phase_filter_is_the_transposed_matrix_at_the_ends_too():
    """Taken as its own transpose it would be off by 0.8: the samples at the ends count much."""
    matrix = zero_phase(np.eye(300), 100.0, 5.0)
    assert np.abs(zero_phase_transposed(np.eye(300), 100.0, 5.0) - matrix.T).max() < 2e-4
    assert np.abs(matrix - matrix.T).max() > 0.5
