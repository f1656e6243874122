"""Each error term against an independent computation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from smsid.errors import DescriptionError, RecordingError
from smsid.sensing import ErrorModel
from smsid.sensing.error_model import GAUSS_MARKOV_ALLAN_PEAK

from .statistics import allan_deviation, mean_band, sigma_band

RATE = 100.0


def rng(seed=0):
    return np.random.default_rng(seed)


def clock(n, rate=RATE):
    return np.arange(n) / rate


def signal(n, axes=3, seed=1):
    return np.random.default_rng(seed).normal(size=(n, axes))


arrays = st.integers(1, 40).flatmap(
    lambda n: st.lists(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3), min_size=n, max_size=n).map(
        np.array
    )
)


@given(arrays)
def test_zero_model_is_identity(x):
    assert np.array_equal(ErrorModel().apply(clock(len(x)), x, rng()), x)


def test_zero_model_is_identity_for_attitude_and_stations():
    q = Rotation.random(20, rng=rng(3)).as_quat()
    assert np.array_equal(ErrorModel().apply(clock(20), q, rng(), attitude=True), q)
    x = signal(20).reshape(10, 2, 3)
    assert np.array_equal(ErrorModel().apply(clock(10), x, rng()), x)


@given(arrays, st.floats(1e-6, 10.0))
def test_quantisation_is_idempotent_and_within_half_a_step(x, step):
    model = ErrorModel(quantisation=step)
    once = model.apply(clock(len(x)), x, rng())
    assert np.array_equal(model.apply(clock(len(x)), once, rng()), once)
    assert np.all(np.abs(once - x) <= 0.5 * step * (1 + 1e-9) + 1e-12)


@given(st.integers(0, 1000), st.floats(1e-5, 0.4))
def test_a_quantised_attitude_is_whole_steps_in_its_direction(seed, step):
    """It is turned by no more than half a step of each component does."""
    q = Rotation.random(20, rng=rng(seed)).as_quat()
    y = ErrorModel(quantisation=step).apply(clock(20), q, rng(), attitude=True)
    assert np.abs(np.linalg.norm(y, axis=1) - 1.0).max() < 1e-15
    whole = np.round(q / step)
    top = np.abs(whole).argmax(axis=1)[:, None]
    exact = np.take_along_axis(whole, top, 1) / np.take_along_axis(y, top, 1)
    assert np.abs(y * exact - whole).max() < 1e-9 / step
    turned = (Rotation.from_quat(q).inv() * Rotation.from_quat(y)).magnitude()
    assert turned.max() <= 2.0 * np.arcsin(min(1.0, step)) + 1e-9


@given(arrays, st.floats(1e-3, 1e3), st.floats(0.0, 10.0))
def test_saturation_bounds_the_output_and_leaves_the_rest(x, limit, sigma):
    y = ErrorModel(saturation=limit, noise_sigma=sigma).apply(clock(len(x)), x, rng())
    assert np.all(np.abs(y) <= limit)
    if sigma == 0.0:
        inside = np.abs(x) <= limit
        assert np.array_equal(y[inside], x[inside])


def test_rounding_follows_saturation():
    y = ErrorModel(saturation=1.3, quantisation=0.5).apply(clock(1), [[5.0, -5.0, 0.7]], rng())
    assert np.allclose(y, [[1.5, -1.5, 0.5]])


@given(st.floats(1e-6, 1e3), st.floats(0.1, 1e4))
def test_white_sigma_of_a_density_grows_with_the_root_of_the_rate(density, rate):
    model = ErrorModel(noise_density=density)
    assert model.white_sigma(4.0 * rate) == pytest.approx(2.0 * model.white_sigma(rate))
    assert model.white_sigma(1.0) == density


def test_white_sigma_per_sample_does_not_depend_on_the_rate():
    assert (
        ErrorModel(noise_sigma=0.3).white_sigma(10.0) == ErrorModel(noise_sigma=0.3).white_sigma(1e4) == 0.3
    )
    assert np.array_equal(ErrorModel(noise_sigma=(1.0, 2.0)).white_sigma(5.0), [1.0, 2.0])


@pytest.mark.parametrize("rate", [10.0, 400.0])
def test_white_noise_has_the_stated_sigma_and_no_memory(rate):
    n, density = 20_000, (1e-3, 2e-3, 5e-3)
    y = ErrorModel(noise_density=density).apply(clock(n, rate), np.zeros((n, 3)), rng(5))
    low, high = sigma_band(n, 3)
    ratio = y.std(axis=0, ddof=1) / (np.array(density) * np.sqrt(rate))
    assert np.all((ratio > low) & (ratio < high))
    assert np.all(np.abs(y.mean(axis=0)) < [mean_band(d * np.sqrt(rate), n, 3) for d in density])
    lag_one = np.mean(y[1:] * y[:-1], axis=0) / np.var(y, axis=0)
    assert np.all(np.abs(lag_one) < mean_band(1.0, n, 3))


def test_averaged_white_noise_is_the_same_at_every_rate():
    """The Allan deviation at 1 s is the density: what an angle random walk coefficient means."""
    for rate in (50.0, 500.0):
        n = int(2000 * rate)
        y = ErrorModel(noise_density=0.1).apply(clock(n, rate), np.zeros((n, 3)), rng(6))
        assert np.allclose(allan_deviation(y, rate, 1.0), 0.1, rtol=0.06)


def test_constant_bias_and_scale():
    x = signal(50)
    y = ErrorModel(bias=(1.0, 2.0, 3.0), scale_error=(0.1, 0.0, -0.1)).apply(clock(50), x, rng())
    assert np.allclose(y, x * [1.1, 1.0, 0.9] + [1.0, 2.0, 3.0])


@pytest.mark.parametrize("term", ["bias_sigma", "scale_sigma"])
def test_turn_on_errors_are_constant_in_a_recording_and_spread_over_recordings(term):
    model, runs = ErrorModel(**{term: 0.2}), 1000
    source = rng(7)
    found = []
    for _ in range(runs):
        error = model.apply(clock(3), np.ones((3, 2, 3)), source) - 1.0
        assert np.ptp(error, axis=0).max() < 1e-12
        found.append(error[0].ravel())
    low, high = sigma_band(runs, 6)
    ratio = np.std(found, axis=0, ddof=1) / 0.2
    assert np.all((ratio > low) & (ratio < high))
    correlation = np.corrcoef(np.array(found).T)[np.triu_indices(6, 1)]
    assert np.all(np.abs(correlation) < mean_band(1.0, runs, 15))


PEAK_TIME = 1.8926  # of a Gauss-Markov process, in correlation times


def test_allan_peak_of_a_gauss_markov_process_follows_from_its_formula():
    def deviation(x):
        return np.sqrt(2.0 / x * (1.0 - (3.0 - 4.0 * np.exp(-x) + np.exp(-2.0 * x)) / (2.0 * x)))

    peak = minimize_scalar(
        lambda x: -deviation(x), bounds=(0.5, 5.0), method="bounded", options={"xatol": 1e-10}
    )
    assert pytest.approx(GAUSS_MARKOV_ALLAN_PEAK, abs=1e-9) == -peak.fun
    assert pytest.approx(PEAK_TIME, abs=1e-4) == peak.x


def test_bias_instability_puts_the_allan_floor_where_the_data_sheet_has_it():
    correlation, n, columns = 10.0, 100_000, 24
    model = ErrorModel(bias_instability=0.05, bias_correlation_time=correlation)
    y = model.apply(clock(n, 10.0), np.zeros((n, columns)), rng(8))
    at_peak = allan_deviation(y, 10.0, PEAK_TIME * correlation)
    error = at_peak.std(ddof=1) / np.sqrt(columns)
    assert abs(at_peak.mean() - 0.05) < 4.0 * error < 0.05 * 0.05
    for tau in (2.0, 200.0):
        assert allan_deviation(y, 10.0, tau).mean() < 0.8 * 0.05


def test_bias_instability_is_stationary_with_exponential_correlation():
    correlation, recordings = 2.0, 40_000
    times = np.array([0.0, 0.7, 1.0, 4.0])  # uneven: the step by step path
    model = ErrorModel(bias_instability=1.0, bias_correlation_time=correlation)
    y = model.apply(times, np.zeros((4, recordings)), rng(9))
    sigma = 1.0 / GAUSS_MARKOV_ALLAN_PEAK
    low, high = sigma_band(recordings, 4)
    ratio = y.std(axis=1, ddof=1) / sigma
    assert np.all((ratio > low) & (ratio < high))
    expected = np.exp(-np.abs(times[:, None] - times) / correlation)
    assert np.allclose(np.corrcoef(y), expected, atol=mean_band(1.0, recordings, 6))


def test_even_and_uneven_paths_of_the_gauss_markov_process_agree():
    model = ErrorModel(bias_instability=1.0, bias_correlation_time=0.5)
    even = clock(200)
    nudged = even + 1e-9 * np.sin(np.arange(200))
    zeros = np.zeros((200, 3))
    assert np.allclose(model.apply(even, zeros, rng(1)), model.apply(nudged, zeros, rng(1)), atol=1e-6)


def test_random_walk_grows_with_time():
    columns, times = 20_000, np.array([0.0, 0.5, 2.0, 10.0])
    y = ErrorModel(random_walk=0.3).apply(times, np.zeros((4, columns)), rng(10))
    assert np.array_equal(y[0], np.zeros(columns))
    low, high = sigma_band(columns, 3)
    ratio = y[1:].std(axis=1, ddof=1) / (0.3 * np.sqrt(times[1:]))
    assert np.all((ratio > low) & (ratio < high))


def test_allan_deviation_of_a_random_walk_is_k_root_tau_over_three():
    n = 40_000
    y = ErrorModel(random_walk=0.3).apply(clock(n, 10.0), np.zeros((n, 30)), rng(11))
    assert np.allclose(allan_deviation(y, 10.0, 20.0).mean(), 0.3 * np.sqrt(20.0 / 3.0), rtol=0.03)


def test_misalignment_turns_the_sensor_axes():
    """The sensor yawed by +a sees a vector along x at -a in its own axes."""
    a = 0.1
    y = ErrorModel(misalignment=(0.0, 0.0, a)).apply(clock(1), [[1.0, 0.0, 0.0]], rng())
    assert np.allclose(y, [[np.cos(a), -np.sin(a), 0.0]])


def test_misalignment_of_an_attitude_is_that_of_its_vectors():
    turn = (0.02, -0.01, 0.03)
    body = Rotation.random(rng=rng(12))
    inertial = np.array([0.3, -0.5, 0.8])
    measured = ErrorModel(misalignment=turn).apply([0.0], [body.as_quat()], rng(), attitude=True)
    seen = ErrorModel(misalignment=turn).apply([0.0], [body.inv().apply(inertial)], rng())
    assert np.allclose(Rotation.from_quat(measured[0]).inv().apply(inertial), seen[0])


def test_drawn_misalignment_keeps_lengths_and_has_the_stated_sigma():
    model, stations = ErrorModel(misalignment_sigma=1e-3), 3000
    x = np.tile([1.0, 0.0, 0.0], (2, stations, 1))
    y = model.apply(clock(2), x, rng(13))
    assert np.allclose(np.linalg.norm(y, axis=-1), 1.0)
    low, high = sigma_band(stations, 2)
    ratio = y[0, :, 1:].std(axis=0, ddof=1) / 1e-3
    assert np.all((ratio > low) & (ratio < high))


def test_attitude_noise_is_a_rotation_vector_in_the_body_frame():
    n, sigma = 5000, (1e-4, 2e-4, 3e-3)
    q = np.tile(Rotation.random(rng=rng(14)).as_quat(), (n, 1))
    y = ErrorModel(noise_sigma=sigma, bias=(0.01, 0.0, 0.0)).apply(clock(n), q, rng(15), attitude=True)
    assert np.allclose(np.linalg.norm(y, axis=1), 1.0)
    error = (Rotation.from_quat(q).inv() * Rotation.from_quat(y)).as_rotvec()
    low, high = sigma_band(n, 3)
    ratio = error.std(axis=0, ddof=1) / sigma
    assert np.all((ratio > low) & (ratio < high))
    assert np.all(np.abs(error.mean(axis=0) - [0.01, 0, 0]) < [mean_band(s, n, 3) for s in sigma])


def test_attitude_keeps_the_sign_of_its_quaternion():
    q = np.array([[0.0, 0.0, 0.0, -1.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 0.0]])
    y = ErrorModel(noise_sigma=1e-3).apply(clock(3), q, rng(), attitude=True)
    assert np.all(np.sum(y * q, axis=1) > 0.9)


def test_delay_interpolates_and_holds_the_first_value():
    t = clock(400)
    x = np.sin(2 * np.pi * t)[:, None]
    y = ErrorModel(delay=0.013).apply(t, x, rng())
    assert np.allclose(y[:1], x[0])
    assert np.allclose(y[2:], np.sin(2 * np.pi * (t[2:, None] - 0.013)), atol=1e-6)
    assert np.array_equal(ErrorModel(delay=0.013).apply(t, x, rng(), delayed=True), x)


def test_delay_of_an_attitude_turns_back():
    t, spin = clock(200), np.array([0.1, -0.2, 0.5])
    q = Rotation.from_rotvec(t[:, None] * spin).as_quat()
    y = ErrorModel(delay=0.025).apply(t, q, rng(), attitude=True)
    expected = Rotation.from_rotvec(np.maximum(t - 0.025, 0.0)[:, None] * spin).as_quat()
    assert np.allclose(y, expected, atol=1e-12)


def test_order_is_misalignment_scale_bias_saturation():
    model = ErrorModel(
        misalignment=(0.0, 0.0, np.pi / 2), scale_error=(1.0, 0.0, 0.0), bias=0.5, saturation=2.2
    )
    y = model.apply(clock(1), [[0.0, 1.0, 0.0]], rng())
    assert np.allclose(y, [[2.2, 0.5, 0.5]])


@settings(max_examples=25)
@given(st.integers(2, 60), st.integers(0, 2**32 - 1))
def test_a_longer_recording_begins_with_the_same_samples(n, seed):
    model = ErrorModel(
        noise_density=1.0, bias_sigma=1.0, bias_instability=1.0, bias_correlation_time=3.0, random_walk=1.0
    )
    long = model.apply(clock(100), np.zeros((100, 3)), rng(seed))
    short = model.apply(clock(n), np.zeros((n, 3)), rng(seed))
    assert np.allclose(long[:n], short, atol=1e-9)


def test_terms_draw_apart():
    """Switching the bias on adds a constant and leaves the white noise as it was."""
    zeros = np.zeros((50, 3))
    quiet = ErrorModel(noise_sigma=1.0).apply(clock(50), zeros, rng(4))
    biased = ErrorModel(noise_sigma=1.0, bias_sigma=1.0).apply(clock(50), zeros, rng(4))
    assert np.allclose(np.ptp(biased - quiet, axis=0), 0.0, atol=1e-12)
    assert np.all(np.abs((biased - quiet)[0]) > 1e-6)


def test_the_input_is_left_alone():
    x = signal(10)
    before = x.copy()
    ErrorModel(noise_sigma=1.0, bias=1.0).apply(clock(10), x, rng())
    assert np.array_equal(x, before)


@pytest.mark.parametrize(
    "fields",
    [
        {"noise_density": 1.0, "noise_sigma": 1.0},
        {"bias_instability": 1.0},
        {"bias_correlation_time": 1.0},
        {"noise_sigma": -1.0},
        {"delay": -0.1},
        {"saturation": 0.0},
        {"bias": float("nan")},
        {"nois_sigma": 1.0},
    ],
)
def test_inconsistent_models_are_refused(fields):
    with pytest.raises(ValidationError):
        ErrorModel(**fields)


def test_models_are_frozen():
    with pytest.raises(ValidationError):
        ErrorModel().bias = 1.0  # type: ignore[misc]


@pytest.mark.parametrize(
    ("model", "shape", "attitude"),
    [
        (ErrorModel(bias=(1.0, 2.0)), (5, 3), False),
        (ErrorModel(bias=(1.0,)), (5,), False),
        (ErrorModel(misalignment_sigma=0.1), (5, 2), False),
        (ErrorModel(scale_error=0.1), (5, 4), True),
        (ErrorModel(quantisation=0.5), (5, 4), True),
        (ErrorModel(saturation=0.1), (5, 4), True),
    ],
)
def test_terms_that_do_not_fit_are_refused(model, shape, attitude):
    with pytest.raises(DescriptionError) as caught:
        model.apply(clock(5), np.ones(shape), rng(), attitude=attitude)
    assert caught.value.advice and caught.value.evidence


@pytest.mark.parametrize(
    ("times", "values", "attitude"),
    [
        (clock(4), np.zeros((5, 3)), False),
        ([0.0, 0.0], np.zeros((2, 3)), False),
        ([0.0, 1.0], [[0.0, 1.0, np.nan]] * 2, False),
        ([0.0, 1.0], np.zeros((2, 3)), True),
        ([0.0, np.inf], np.zeros((2, 3)), False),
    ],
)
def test_unusable_data_are_refused(times, values, attitude):
    with pytest.raises(RecordingError):
        ErrorModel(noise_sigma=1.0).apply(times, values, rng(), attitude=attitude)


def test_a_density_needs_a_rate():
    with pytest.raises(RecordingError, match="unknown"):
        ErrorModel(noise_density=1.0).apply([0.0], np.zeros((1, 3)), rng())
    assert np.all(np.isfinite(ErrorModel(noise_density=1.0).apply([0.0], np.zeros((1, 3)), rng(), rate=10.0)))
    with pytest.raises(RecordingError):
        ErrorModel(noise_density=1.0).white_sigma(0.0)
