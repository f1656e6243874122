"""The light step against SciPy's own RK45 and against the matrix exponential."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import RK45
from scipy.linalg import expm

from smsid.description import load_description
from smsid.inputs.signals import Sampled, merge
from smsid.kernel.jit import SWITCH
from smsid.model import build_model
from smsid.simulate import Inputs, Tolerance, simulate
from smsid.simulate._held_chart import HeldChart
from smsid.simulate._short_step import ShortPiece, short_step, short_steps

A = np.array([[0.0, 1.0, 0.0], [-4.0, -0.1, 0.5], [0.0, -0.3, -0.2]])
START = np.array([1.0, -0.5, 0.3])


def rate(t: float, y: np.ndarray, out: np.ndarray) -> np.ndarray:
    out[:] = A @ y + np.cos(t)
    return out


def steps(h: float, tolerance: float = 1e-3) -> list[ShortPiece] | None:
    first = rate(0.0, START, np.empty(3))
    return short_steps(rate, 0.0, START, first, h, tolerance, tolerance)


def test_is_scipys_step():
    """Same step, same end, same polynomial."""
    theirs = RK45(
        lambda t, y: A @ y + np.cos(t), 0.0, START, 0.05, first_step=0.05, max_step=0.05, rtol=1e-3, atol=1e-3
    )
    theirs.step()
    (found,) = steps(0.05) or []
    np.testing.assert_allclose(found.y, theirs.y, rtol=1e-14)
    times = np.linspace(0.0, 0.05, 7)
    np.testing.assert_allclose(found(times), theirs.dense_output()(times), rtol=1e-13)
    np.testing.assert_allclose(found(0.02), theirs.dense_output()(0.02), rtol=1e-13)
    np.testing.assert_allclose(found.end_rate, rate(0.05, found.y, np.empty(3)))


def test_order():
    """The error over one step falls by 2^6 when the step is halved."""

    def error(h: float) -> float:
        still, _ = short_step(
            lambda t, y, out: np.copyto(out, A @ y) or out, 0.0, START, A @ START, h, 1.0, 1.0
        )
        return float(np.abs(still.y - expm(A * h) @ START).max())

    assert error(0.4) / error(0.2) == pytest.approx(2.0**6, rel=0.3)


def test_a_miss_is_left_to_the_eighth_order():
    assert steps(0.5, 1e-9) is None
    assert steps(0.5, 1e-1) is not None


def test_a_near_miss_is_taken_in_parts():
    """Of equal length, each within the tolerance, one going on where the one before ends."""
    found = steps(0.2, 1e-7)
    assert found is not None and len(found) == 3
    edges = [piece.t_old for piece in found] + [found[-1].t]
    np.testing.assert_allclose(edges, np.linspace(0.0, 0.2, 4), atol=1e-15)
    for before, after in pairwise(found):
        np.testing.assert_array_equal(before.y, after.y_old)
    theirs = RK45(lambda t, y: A @ y + np.cos(t), 0.0, START, 0.2, rtol=1e-12, atol=1e-13)
    while theirs.status == "running":
        theirs.step()
    assert 0.0 < np.abs(found[-1].y - theirs.y).max() < 1e-7


@pytest.mark.filterwarnings("ignore:invalid value")
def test_not_a_number_is_no_step():
    bad = short_steps(lambda t, y, out: np.copyto(out, np.nan) or out, 0.0, START, A @ START, 0.1, 1.0, 1.0)
    assert bad is None


@pytest.mark.parametrize("way", ["compiled", "plain"])
def test_held_torque_equals_restarts_one_by_one(urdf, monkeypatch, way):
    """Joint torque held at 20 Hz against separate simulations of constant torque, to the tolerance."""
    monkeypatch.setenv(SWITCH, "1" if way == "compiled" else "0")
    model = build_model(load_description(urdf / "paper_sms.toml"))
    rng = np.random.default_rng(0)
    times = np.arange(11) / 20.0
    values = rng.uniform(-2.0, 2.0, (11, len(model.arm_joints)))
    tight = Tolerance(1e-11, 1e-13)
    held = simulate(
        model, Inputs(joint_torque=Sampled.from_samples(times, values, degree=0)), 0.5, tolerance=tight
    )
    q, v = None, None
    for k in range(10):
        alone = Sampled.from_samples(np.array([0.0, 1.0]), np.tile(values[k], (2, 1)), degree=0)
        piece = simulate(model, Inputs(joint_torque=alone), 0.05, q0=q, v0=v, tolerance=tight)
        end = piece.states(np.array([0.05]))
        q, v = end.q[0], end.v[0]
    found = held.states(np.array([0.5]))
    np.testing.assert_allclose(found.q[0], q, atol=1e-10)
    np.testing.assert_allclose(found.v[0], v, atol=1e-10)
    loose = simulate(model, held.inputs, 0.5, tolerance=Tolerance(1e-4, 1e-6))
    short = [isinstance(c, HeldChart) or isinstance(c.pieces[0], ShortPiece) for c in loose.charts]
    assert any(short)
    np.testing.assert_allclose(loose.states(np.array([0.5])).v[0], v, atol=1e-5)


def test_held_values_and_their_sum():
    """Looked up as the spline has them, at samples, between, before and after; equal clocks merge."""
    times = np.array([0.0, 0.1, 0.25, 0.3])
    one, two = (Sampled.from_samples(times, np.arange(8.0).reshape(4, 2) * k, degree=0) for k in (1.0, 3.0))
    for t in (-0.2, 0.0, 0.05, 0.1, 0.2, 0.25, 0.299, 0.3, 0.35):
        np.testing.assert_array_equal(one(t), one.spline(t), err_msg=str(t))
    both = merge([one, two])
    assert isinstance(both, Sampled)
    np.testing.assert_array_equal(both(0.26), one(0.26) + two(0.26))
    assert both.breakpoints == one.breakpoints
    with pytest.raises(ValueError, match="read-only"):
        one(0.1)[0] = 1.0
