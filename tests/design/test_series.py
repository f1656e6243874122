"""Fourier series of joints and wheels keep their limits, whatever the point."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from smsid.design._limits import Limits
from smsid.design._moving import SeriesSpace
from smsid.inputs.signals import sample
from smsid.model import build_model

TIMES = np.linspace(0.0, 40.0, 4001)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(0.01, 100.0))
def test_limits_are_kept(model, seed: int, size: float):
    limits = Limits(swing=1.2, wheel_rate=100.0, margin=0.05)
    space = SeriesSpace(model, limits, 40.0)
    inputs = space.experiment(size * space.random(np.random.default_rng(seed))).inputs()
    motion, torque = inputs.joint_motion, inputs.wheel_torque
    assert motion is not None and torque is not None
    home = model.joint_angles(model.home)
    angle, rate = sample(motion.position, TIMES), sample(motion.velocity, TIMES)
    slack = 1.001  # the limits are looked at on a coarser grid
    assert np.abs(angle - home).max() <= 0.95 * 1.2 * slack
    assert np.abs(rate).max() <= 0.95 * 0.5 * slack
    np.testing.assert_allclose(angle[0], home, atol=1e-12)
    np.testing.assert_allclose(rate[0], 0.0, atol=1e-12)
    push = sample(torque, TIMES)
    assert np.abs(push).max() <= 0.95 * 2.0 * slack
    spin = np.cumsum(0.5 * (push[1:] + push[:-1]), axis=0) * 0.01 / 0.159
    assert np.abs(spin).max() <= 0.95 * 100.0 * slack


def test_long_coefficients_reach_a_limit(model):
    space = SeriesSpace(model, Limits(margin=0.0), 40.0)
    inputs = space.experiment(10.0 * space.random(np.random.default_rng(0))).inputs()
    assert inputs.joint_motion is not None
    angle, rate = (sample(s, TIMES) for s in (inputs.joint_motion.position, inputs.joint_motion.velocity))
    use = np.maximum(np.abs(angle).max(axis=0) / 3.1, np.abs(rate).max(axis=0) / 0.5)
    np.testing.assert_allclose(use, 1.0, rtol=2e-3)


def test_a_tilted_wheel_reaches_its_rate(model):
    axis = (0.5**0.5, 0.5, 0.5)
    wheels = tuple(w.model_copy(update={"axis": axis}) for w in model.description.wheel)
    tilted = build_model(model.description.model_copy(update={"wheel": wheels}))
    space = SeriesSpace(tilted, Limits(wheel_rate=1.0, margin=0.0), 40.0)
    torque = space.experiment(10.0 * space.random(np.random.default_rng(0))).inputs().wheel_torque
    assert torque is not None
    push = sample(torque, TIMES)
    spin = np.cumsum(0.5 * (push[1:] + push[:-1]), axis=0) * 0.01 / 0.159
    np.testing.assert_allclose(np.abs(spin).max(axis=0), 1.0, rtol=2e-3)
