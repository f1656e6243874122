"""The step of rounded quaternions is found again, and none where there is none."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from smsid.diagnose._sensor_faults import step_of

LEAST = 5e-5
FEW = 16  # different readings of which it may be that no step is found


def rounded(q, step):
    """Rounded to a step and normalised again."""
    whole = np.round(q / step) * step
    return whole / np.linalg.norm(whole, axis=1, keepdims=True)


def turning(seed, count=400, axis=None):
    """Quaternions of a slow turn with some noise, about any axis or a given one."""
    rng = np.random.default_rng(seed)
    axis = rng.standard_normal(3) if axis is None else np.array(axis)
    angle = rng.uniform(0.0, 3.0) + np.linspace(0.0, rng.uniform(0.3, 1.0), count)
    noise = np.zeros((count, 3)) if np.count_nonzero(axis) == 1 else 1e-4 * rng.standard_normal((count, 3))
    turn = Rotation.from_rotvec(np.outer(angle, axis / np.linalg.norm(axis)))
    return (turn * Rotation.from_rotvec(noise)).as_quat()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(np.log(2e-4), np.log(0.03)))
@example(649, -4.328125)
def test_the_step_is_found(seed, logarithm):
    step = float(np.exp(logarithm))
    readings = rounded(turning(seed), step)
    found = step_of(readings, LEAST)
    if found is None:  # too few different ones may have a common factor: then none, not a wrong one
        assert len(np.unique(readings, axis=0)) < FEW
        return
    value, sigma = found
    assert abs(value - step) < 6.0 * max(
        sigma, 0.1 * step**2
    )  # the lengths of a slow turn are not independent


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_none_is_found_where_there_is_none(seed):
    q = turning(seed)
    assert step_of(q, LEAST) is None
    assert step_of(q.astype(np.float32).astype(float), LEAST) is None


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_single_precision_will_do(step):
    q = rounded(turning(3), step).astype(np.float32).astype(float)
    value, sigma = step_of(q, LEAST)
    assert value == pytest.approx(step, abs=6.0 * sigma)


def test_a_turn_about_one_axis_will_do_and_has_no_step_without_rounding():
    q = turning(5, axis=(0.0, 0.0, 1.0))
    assert step_of(q, LEAST) is None
    value, sigma = step_of(rounded(q, 1e-3), LEAST)
    assert value == pytest.approx(1e-3, abs=6.0 * sigma)


def test_some_readings_may_be_off():
    q = rounded(turning(7), 3e-3)
    q[::50] = turning(8)[::50]
    value, sigma = step_of(q, LEAST)
    assert value == pytest.approx(3e-3, abs=6.0 * sigma)


Q = rounded(turning(9), 1e-3)
EXACT = np.eye(4)[[0, 1, 2, 3] * 5]


@pytest.mark.parametrize(
    ("q", "least"),
    [
        (Q[:1].repeat(400, 0), LEAST),
        (Q, 2e-3),
        (Q[:5], LEAST),
        (Q[:0], LEAST),
        (np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, -1.0]] * 10), LEAST),
        (EXACT, LEAST),
        (Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2]] * 10).as_quat(), LEAST),
    ],
    ids=["at rest", "finer than the noise", "short", "empty", "signs", "half turns", "right angles"],
)
def test_what_does_not_tell(q, least):
    assert step_of(q, least) is None


def test_noise_of_which_nothing_is_known_will_do():
    assert step_of(Q, 0.0) is not None
