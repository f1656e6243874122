"""Filters against the analytic Butterworth response, and what they refuse."""

import numpy as np
import pytest
from scipy.signal import butter, correlate, sosfiltfilt

from smsid.errors import RecordingError
from smsid.sensing import differentiate, zero_phase, zero_phase_transposed
from smsid.sensing.filters import settling_time

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


@pytest.mark.parametrize("cutoff", [0.5, 2.0, 99.0])
@pytest.mark.parametrize("columns", [(), (3,), (2, 2)])
def test_zero_phase_is_the_butterworth_of_scipy_there_and_back(cutoff, columns):
    rate, x = 200.0, np.random.default_rng(1).standard_normal((30_000, *columns)).cumsum(axis=0) + 1e3
    pad = max(int(np.ceil(settling_time(cutoff) * rate - 1e-6)), 15)
    wanted = sosfiltfilt(butter(4, cutoff, fs=rate, output="sos"), x, axis=0, padlen=pad)
    np.testing.assert_allclose(
        zero_phase(x, rate, cutoff), wanted, rtol=1e-11, atol=1e-9
    )  # rounding, most of it scipy's


def test_zero_phase_is_6_db_down_at_the_cutoff():
    t, x = tone(10.0)
    assert abs(phasor(t, zero_phase(x, RATE, 10.0), 10.0)) == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("frequency", [1.0, 5.0, 10.0, 20.0])
def test_zero_phase_has_the_squared_gain_and_no_phase(frequency):
    t, x = tone(frequency)
    gain = phasor(t, zero_phase(x, RATE, 10.0), frequency) / phasor(t, x, frequency)
    assert gain == pytest.approx(abs(butterworth(frequency, 10.0, 4)) ** 2, abs=1e-6)


def test_zero_phase_does_not_shift_broadband_data():
    x = np.random.default_rng(0).normal(size=4000)
    lags = np.arange(-3999, 4000)
    assert lags[np.argmax(correlate(zero_phase(x, RATE, 10.0), x))] == 0


def test_a_constant_stays():
    x = np.full((400, 2, 3), 7.0)
    assert np.allclose(zero_phase(x, RATE, 5.0), 7.0)


@pytest.mark.parametrize("run", [zero_phase, differentiate])
def test_columns_are_filtered_apart(run):
    x = np.random.default_rng(2).normal(size=(300, 2, 3))
    whole = run(x, RATE, 10.0)
    assert whole.shape == x.shape
    assert np.allclose(whole[:, 1, 2], run(x[:, 1, 2], RATE, 10.0))


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


@pytest.mark.parametrize("run", [zero_phase, differentiate])
@pytest.mark.parametrize("cutoff", [0.0, -1.0, 100.0, 150.0, np.nan])
def test_cutoff_must_be_below_nyquist(run, cutoff):
    with pytest.raises(RecordingError, match="Nyquist") as caught:
        run(np.zeros(500), RATE, cutoff)
    assert caught.value.evidence["nyquist"] == 100.0


@pytest.mark.parametrize("run", [zero_phase, differentiate])
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


def test_the_transposed_zero_phase_filter_is_the_transposed_matrix_at_the_ends_too():
    """Taken as its own transpose it would be off by 0.8: the samples at the ends count much."""
    matrix = zero_phase(np.eye(300), 100.0, 5.0)
    assert np.abs(zero_phase_transposed(np.eye(300), 100.0, 5.0) - matrix.T).max() < 2e-4
    assert np.abs(matrix - matrix.T).max() > 0.5
