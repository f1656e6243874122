"""Signals: values, maps, derivatives, sums."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smsid.errors import ExperimentError
from smsid.inputs.signals import merge, sample
from smsid.simulate import Constant, Fourier, PiecewiseConstant, Sampled, Sum

RNG = np.random.default_rng(0)
TIMES = np.array([0.0, 0.5, 1.25, 2.0, 2.5, 3.5, 4.0])
SIGNALS = {
    "constant": Constant(np.array([1.0, -2.0])),
    "steps": PiecewiseConstant((0.5, 1.0, 3.0), RNG.standard_normal((3, 2))),
    "fourier": Fourier(0.3, RNG.standard_normal((2, 4)), RNG.standard_normal((2, 4)), RNG.standard_normal(2)),
    "held": Sampled.from_samples(TIMES, RNG.standard_normal((7, 2)), 0),
    "linear": Sampled.from_samples(TIMES, RNG.standard_normal((7, 2)), 1),
    "cubic": Sampled.from_samples(TIMES, RNG.standard_normal((7, 2)), 3),
    "quintic": Sampled.from_samples(TIMES, RNG.standard_normal((7, 2)), 5),
    "sum": Sum((Constant(np.ones(2)), PiecewiseConstant((1.0, 2.0), RNG.standard_normal((2, 2))))),
}
times = st.floats(0.0, 4.0)


@pytest.mark.parametrize("name", SIGNALS)
@settings(max_examples=30, deadline=None)
@given(t=times)
def test_mapping_a_signal_maps_its_values_and_keeps_its_jumps(name, t):
    signal = SIGNALS[name]
    matrix = np.array([[1.0, 2.0], [0.0, -1.0], [3.0, 0.5]])
    mapped = signal.mapped(matrix)
    np.testing.assert_allclose(mapped(t), matrix @ signal(t), atol=1e-12)
    assert mapped.size == 3 and signal.size == 2
    assert set(mapped.breakpoints) == set(signal.breakpoints)


@pytest.mark.parametrize("name", SIGNALS)
def test_sampling_is_calling_at_every_time(name):
    grid = np.linspace(0.0, 4.0, 37)
    expected = np.array([SIGNALS[name](float(t)) for t in grid])
    np.testing.assert_allclose(sample(SIGNALS[name], grid), expected, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(chosen=st.lists(st.sampled_from(sorted(SIGNALS)), min_size=1, max_size=6), t=times)
def test_merging_adds_up(chosen, t):
    signals = [SIGNALS[n] for n in chosen]
    merged = merge(signals)
    np.testing.assert_allclose(merged(t), sum(s(t) for s in signals), atol=1e-12)
    assert set(merged.breakpoints) == {b for s in signals for b in s.breakpoints}


def test_merging_leaves_one_series_per_frequency():
    fourier = SIGNALS["fourier"]
    merged = merge([fourier, Constant(np.zeros(2)), fourier.mapped(2 * np.eye(2))])
    assert isinstance(merged, Fourier)
    np.testing.assert_allclose(merged.cos, 3 * fourier.cos)
    assert isinstance(merge([Constant(np.ones(2)), Constant(np.ones(2))]), Constant)


@pytest.mark.parametrize("name", ["fourier", "linear", "cubic", "quintic"])
@settings(max_examples=40, deadline=None)
@given(t=st.floats(0.1, 3.9).filter(lambda t: np.abs(t - TIMES).min() > 1e-3))
def test_derivatives_are_the_numerical_ones(name, t):
    """Central differences with h = 1e-5: truncation of order h^2, rounding of order eps / h."""
    signal, h = SIGNALS[name], 1e-5
    numerical = (signal(t + h) - signal(t - h)) / (2 * h)
    np.testing.assert_allclose(signal.derivative()(t), numerical, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", ["linear", "cubic", "quintic"])
def test_interpolants_go_through_their_samples(name):
    values = np.random.default_rng(1).standard_normal((7, 2))
    signal = Sampled.from_samples(TIMES, values, SIGNALS[name].degree)
    np.testing.assert_allclose(sample(signal, TIMES), values, atol=1e-12)


def test_what_is_held_jumps_at_its_samples_by_any_clock():
    """0.01 k and k / 100 are the same time, though they often differ in their last digit."""
    knots, clock, values = 0.01 * np.arange(2000), np.arange(2000) / 100, np.arange(2000.0)[:, None]
    assert np.any(clock < knots)
    for signal in (Sampled.from_samples(knots, values, 0), PiecewiseConstant(tuple(knots), values)):
        np.testing.assert_array_equal(sample(signal, clock), values)


def test_steps_and_held_samples_take_the_right_limit():
    steps = PiecewiseConstant((1.0, 2.0), np.array([[3.0], [4.0]]))
    assert [steps(t)[0] for t in (0.0, np.nextafter(1.0, 0.0), 1.0, 1.5, 2.0, 9.0)] == [0, 0, 3, 3, 4, 4]
    held = Sampled.from_samples(np.array([1.0, 2.0, 3.0]), np.array([3.0, 4.0, 5.0]), 0)
    assert [held(t)[0] for t in (1.0, np.nextafter(2.0, 0.0), 2.0, 3.0, 3.5)] == [3, 3, 4, 5, 5]
    assert held.breakpoints == (1.0, 2.0, 3.0)


def test_the_derivative_of_a_linear_signal_jumps_at_its_samples():
    rate = Sampled.from_samples(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 0.0]), 1).derivative()
    assert rate.breakpoints == (0.0, 1.0)
    assert [rate(t)[0] for t in (0.5, 1.0, 2.0)] == [2.0, -1.0, -1.0]
    with pytest.raises(ExperimentError, match="no derivative"):
        rate.derivative()


@pytest.mark.parametrize(
    "make",
    [
        lambda: PiecewiseConstant((0.0, 0.0), np.ones((2, 1))),
        lambda: PiecewiseConstant((0.0, np.nan), np.ones((2, 1))),
        lambda: PiecewiseConstant((0.0, 1.0), np.ones((3, 1))),
        lambda: PiecewiseConstant((0.0, 1.0), np.ones(2)),
        lambda: Sampled.from_samples(np.array([0.0, 1.0]), np.array([1.0, np.nan])),
        lambda: Sampled.from_samples(np.array([0.0, 1.0, 1.0, 2.0]), np.ones(4)),
        lambda: Sampled.from_samples(np.array([0.0, 1.0, 2.0]), np.ones(3), 3),
        lambda: Sampled.from_samples(np.array([0.0]), np.ones(1), 0),
        lambda: Sampled.from_samples(np.arange(5.0), np.ones(4)),
    ],
)
def test_signals_that_make_no_sense_are_refused(make):
    with pytest.raises(ExperimentError):
        make()
