"""Signals that arrive late or change over, and forces that begin midway."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smsid.description import load_description
from smsid.effects import ExternalWrench
from smsid.inputs.signals import sample
from smsid.model import build_model
from smsid.simulate import (
    Constant,
    Delayed,
    Fourier,
    Inputs,
    PiecewiseConstant,
    Sampled,
    Signal,
    Sum,
    Switched,
    simulate,
)

RNG = np.random.default_rng(0)
SERIES = Fourier(0.1, RNG.normal(size=(2, 3)), RNG.normal(size=(2, 3)), RNG.normal(size=2))
STEPS = PiecewiseConstant((0.0, 3.0, 6.0), RNG.normal(size=(3, 2)))
SAMPLED = Sampled.from_samples(np.linspace(2.0, 12.0, 30), RNG.normal(size=(30, 2)))


@pytest.mark.parametrize("signal", [SERIES, STEPS, SAMPLED, Sum((SERIES, STEPS))])
@given(delay=st.floats(0.0, 2.0), t=st.floats(0.0, 12.0))
def test_what_is_commanded_at_a_time_arrives_later(signal: Signal, delay: float, t: float) -> None:
    late = Delayed.of(signal, delay)
    begin = 2.0 if signal is SAMPLED else 0.0
    expected = np.zeros(2) if t < begin + delay else signal(t - delay)
    np.testing.assert_array_equal(late(t), expected)
    matrix = np.array([[1.0, 2.0], [0.5, -1.0], [0.0, 3.0]])
    np.testing.assert_allclose(late.mapped(matrix)(t), matrix @ expected, atol=1e-12)


def test_sums_begin_with_what_is_sampled_of_them() -> None:
    """Of a recording that begins at 2 s, beside a constant and itself late."""
    late = Delayed.of(Sum((Constant(np.zeros(2)), SAMPLED)), 0.5)
    assert late.begin == 2.0 and not late(2.4).any() and late(2.6).any()
    assert Delayed.of(Sum((Delayed.of(SAMPLED, 0.5),)), 0.25).begin == 2.5
    assert Delayed.of(Switched(SAMPLED, Delayed.of(SAMPLED, 0.5), 4.0), 0.25).begin == 2.0
    assert Delayed.of(Sum((SERIES, STEPS)), 0.5).begin == 0.0


def test_breakpoints_move_along() -> None:
    assert Delayed.of(STEPS, 0.5).breakpoints == (0.5, 3.5, 6.5)
    assert Delayed.of(SERIES, 0.5).breakpoints == (0.5,)
    assert Switched(STEPS, STEPS, 4.0).breakpoints == (0.0, 3.0, 4.0, 6.0)
    assert Switched(STEPS, Delayed.of(STEPS, 0.5), 4.0).breakpoints == (0.0, 3.0, 4.0, 6.5)


@pytest.mark.parametrize(
    "signal",
    [
        Delayed.of(SERIES, 0.3),
        Delayed.of(SAMPLED, 0.3),
        Switched(SERIES, STEPS, 5.0),
        Sum((SERIES, Delayed.of(STEPS, 1.0))),
        Switched(Constant(np.array([1.0, 0.0])), SERIES, 5.0),
    ],
)
def test_samples_are_the_values(signal: Signal) -> None:
    times = np.concatenate([np.linspace(2.0, 12.0, 101), [5.0, np.nextafter(5.0, 0.0)]])
    np.testing.assert_allclose(sample(signal, times), [signal(float(t)) for t in times], atol=1e-14)
    assert signal.size == 2


def test_a_force_that_begins_midway_gives_its_impulse(urdf: Path) -> None:
    """The integrator stops at the onset: the momentum is right to round-off, not to a step's error."""
    description = load_description(urdf / "paper_sms.toml")
    leak = ExternalWrench(name="leak", force=(1.0, -2.0, 0.5), frame="inertial", start=2.1)
    trajectory = simulate(build_model(description.with_effects(leak)), Inputs(), 7.3)
    assert any(chart.times[-1] == 2.1 for chart in trajectory.charts)
    s = trajectory.states(np.array([2.1, 7.3]))
    momentum = [trajectory.model.momentum(q, v)[:3] for q, v in zip(s.q, s.v, strict=True)]
    np.testing.assert_allclose(momentum[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(momentum[1], np.array([1.0, -2.0, 0.5]) * 5.2, rtol=1e-10)
