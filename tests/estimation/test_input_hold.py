"""Means of commands over steps: the impulse is kept, whatever the signal and its delay."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from smsid.estimation.input_hold import (
    _with_ramps,
    is_mixed_hold,
    is_stepwise,
    jump_intervals,
    limits,
    means,
    unevenness,
    unrecorded,
)
from smsid.inputs.changed import Delayed, Switched
from smsid.inputs.signals import Constant, Fourier, Sampled, Sum

TIMES = np.arange(21) * 0.05
VALUES = np.random.default_rng(2).standard_normal((21, 2))


@given(st.floats(0.0, 0.049), st.sampled_from([0, 1]))
def test_a_late_command_gives_the_impulse_of_quadrature(delay, degree):
    signal = Delayed.of(Sampled.from_samples(TIMES, VALUES, degree), delay)
    edges = np.array([0.1, 0.137, 0.2, 0.25, 0.33])
    found, further = means(signal, edges), unevenness(signal, edges)
    kinks = [t + delay for t in TIMES]
    for (a, b), row, more in zip(itertools.pairwise(edges), found, further, strict=True):
        inside = [t for t in kinks if a < t < b]
        for column in range(2):
            area = sum(
                quad(lambda t, c=column: signal(t)[c], lo, hi)[0]
                for lo, hi in zip([a, *inside], [*inside, b], strict=True)
            )
            assert abs(area / (b - a) - row[column]) < 1e-7
            twice = sum(
                quad(lambda t, c=column, end=b: (end - t) * signal(t)[c], lo, hi)[0]
                for lo, hi in zip([a, *inside], [*inside, b], strict=True)
            )
            assert abs(twice - 0.5 * (b - a) * area - more[column]) < 1e-8


def test_a_smooth_signal_by_its_antiderivative():
    rng = np.random.default_rng(3)
    signal = Fourier(0.4, *rng.standard_normal((2, 2, 3)), rng.standard_normal(2))
    edges = np.linspace(0.0, 1.0, 41)
    w = 2 * np.pi * 0.4 * np.arange(1, 4)

    def whole(t):
        return signal.offset * t + (signal.cos / w) @ np.sin(w * t) - (signal.sin / w) @ (np.cos(w * t) - 1.0)

    expected = np.diff([whole(t) for t in edges], axis=0) / np.diff(edges)[:, None]
    np.testing.assert_allclose(means(signal, edges), expected, atol=1e-9)
    for (a, b), row in zip(itertools.pairwise(edges), unevenness(signal, edges), strict=True):
        twice = [
            quad(lambda t, c=c, end=b: (end - t) * signal(t)[c], a, b)[0]
            - 0.5 * (b - a) * quad(lambda t, c=c: signal(t)[c], a, b)[0]
            for c in range(2)
        ]
        np.testing.assert_allclose(row, twice, atol=1e-12)


def test_either_side_of_a_jump():
    signal = Sampled.from_samples(TIMES, VALUES, 0)
    np.testing.assert_allclose(limits(signal, TIMES[3:6], "right"), VALUES[3:6])
    np.testing.assert_allclose(limits(signal, TIMES[3:6], "left"), VALUES[2:5])


def test_between_jumps_commands_vary_linearly():
    """A torque that varies, and jumps once: held over the jump alone, from its start to its end."""
    values = np.column_stack([np.sin(0.7 * TIMES), np.cos(0.3 * TIMES)])
    values[8:] += [3.0, 0.0]
    assert np.argwhere(jump_intervals(values)).tolist() == [[7, 0]]
    signal = Sampled.from_samples(*_with_ramps(TIMES, values, jump_intervals(values)), 1)
    edges = np.array([0.0, 0.2, 0.35, 0.39, 0.4, 0.45, 1.0])
    linear = Sampled.from_samples(TIMES, values, 1)
    expected = means(linear, edges)
    expected[2:4, 0] = values[7, 0]
    np.testing.assert_allclose(means(signal, edges), expected, atol=1e-6)
    for side, there in (("left", [values[7, 0], values[8, 1]]), ("right", values[8])):
        np.testing.assert_allclose(limits(signal, TIMES[8:9], side)[0], there, atol=1e-6)
    np.testing.assert_allclose(limits(signal, TIMES[4:5], "right")[0], values[4], atol=1e-6)


def test_a_jump_at_the_last_sample_is_no_slope():
    """Just after it a command is what it was last, not what the jump's slope leads to."""
    values = np.column_stack([np.sin(0.7 * TIMES), np.cos(0.3 * TIMES)])
    values[-1, 0] += 3.0
    assert jump_intervals(values)[-1].tolist() == [True, False]
    signal = Sampled.from_samples(*_with_ramps(TIMES, values, jump_intervals(values)), 1)
    np.testing.assert_allclose(limits(signal, TIMES[-1:], "right")[0], values[-1], atol=1e-6)
    np.testing.assert_allclose(
        limits(signal, TIMES[-1:], "left")[0], [values[-2, 0], values[-1, 1]], atol=1e-6
    )


def test_what_is_held_may_jump_slowly():
    """Only what jumps by itself goes straight to its next value; steps beside it are held."""
    jump = np.where(TIMES < 0.35, 1.0, -3.0)
    values = np.column_stack([np.random.default_rng(1).standard_normal(len(TIMES)), jump])
    at = jump_intervals(values)
    assert at[:, 1].sum() == 1
    slow = Sampled.from_samples(*_with_ramps(TIMES, values, ~at), 1)
    held = Sampled.from_samples(TIMES, values, 0)
    found, before = means(slow, TIMES), means(held, TIMES)
    np.testing.assert_allclose(found[~at], before[~at], atol=1e-6)
    np.testing.assert_allclose(found[at[:, 1], 1], -1.0, atol=1e-6)


def test_what_commands_look_like():
    steps = np.repeat([[0.0], [2.0], [-2.0], [0.0]], 10, axis=0)
    waves = np.sin(0.3 * np.arange(40.0))[:, None]
    assert is_stepwise({"command.force": steps}) and not is_mixed_hold({"command.force": steps})
    both = {"command.force": steps, "command.torque": waves}
    assert is_mixed_hold(both) and not is_stepwise(both)
    assert not is_stepwise({"command.torque": waves}) and not is_mixed_hold({"command.torque": waves})


def test_a_pulse_of_one_sample_is_two_jumps():
    values = np.zeros((21, 1))
    values[6:] += 1.0
    values[12] += 2.0
    assert np.argwhere(jump_intervals(values)).tolist() == [[5, 0], [11, 0], [12, 0]]


def test_times_since_the_epoch_may_have_ramps():
    values = np.sign(TIMES - 0.48)[:, None]
    times, _ = _with_ramps(1.7e9 + TIMES, values, jump_intervals(values))
    assert (np.diff(times) > 0.0).all()


WAVE = np.sin(np.outer(np.arange(400) * 0.05, [1.0, 2.0, 3.0]))
STEPS = np.sign(np.sin(np.arange(400) * 0.25))[:, None] * [1.0, 2.0, 3.0]
NOISE = np.random.default_rng(5).standard_normal((400, 3))


@pytest.mark.parametrize(
    ("force", "torque", "expected"),
    [
        (STEPS, WAVE, True),
        (STEPS, STEPS, False),
        (WAVE, WAVE, False),
        (STEPS, NOISE, False),
        (NOISE, NOISE, False),
        (STEPS, np.sign(NOISE), False),
        (STEPS, np.round(3.0 * WAVE), False),
    ],
    ids=["both", "steps", "waves", "steps and noise", "noise", "binary noise", "rounded"],
)
def test_what_is_mixed(force, torque, expected):
    """Steps alone are held, waves alone vary: only both together take both."""
    assert is_mixed_hold({"command.force": force, "command.torque": torque}) is expected


def test_what_was_commanded_before_the_recording_is_not_known():
    """Until the first command arrives, 70 ms late: by as much as it, in the share of the interval that is."""
    late = Delayed.of(Sampled.from_samples(TIMES, VALUES, 0), 0.07)
    edges = np.array([0.0, 0.05, 0.1, 0.15])
    expected = VALUES[0] * np.array([1.0, 0.4, 0.0])[:, None]
    np.testing.assert_allclose(unrecorded(late, edges), expected, atol=1e-12)
    np.testing.assert_allclose(means(late, edges)[0], VALUES[0])
    more = Sum((late, Constant(np.ones(2)), late.mapped(-2.0 * np.eye(2))))
    np.testing.assert_allclose(unrecorded(more, edges), -expected, atol=1e-12)
    begun = Switched(Sampled.from_samples(TIMES, VALUES, 0), late, 0.05)
    np.testing.assert_allclose(unrecorded(begun, edges), expected * [[0.0], [1.0], [1.0]], atol=1e-12)


def test_what_is_known_is():
    signal = Sampled.from_samples(TIMES, VALUES, 0)
    edges = np.array([0.1, 0.15, 0.2])
    assert unrecorded(signal, edges - 0.1) is None
    assert unrecorded(Delayed.of(signal, 0.07), edges) is None
    assert unrecorded(Sum((signal, Constant(np.ones(2)))), edges) is None
    assert unrecorded(Switched(signal, signal, 0.12), edges) is None
