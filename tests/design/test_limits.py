"""Limits: beam theory for tip and root, and which limit is whose."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.design._limits import Limits, root_moments, tip_shapes
from smsid.errors import ExperimentError
from smsid.experiments import ConstantProfile, Experiment, LimitUse
from smsid.simulate import simulate


def static(part, acceleration: float) -> np.ndarray:
    """Modal coordinates when the root accelerates for ever: delta = -L_t a / omega^2."""
    modes = part.modal_data()
    omega = np.array([2 * np.pi * m.frequency for m in modes])
    return -np.array([m.translation[2] for m in modes]) * acceleration / omega**2


def test_tip_and_root_of_a_beam_under_its_own_weight(model):
    """Euler and Bernoulli: tip w L^4 / 8 E I, root w L^2 / 2; three modes hold 99.9 and 97 % of them."""
    part = model.appendages[0].appendage
    delta = static(part, 1e-3)
    load = part.linear_density * 1e-3
    bending = part.youngs_modulus * part.width * part.thickness**3 / 12.0
    tip = np.linalg.norm(np.einsum("k,ski->si", delta, tip_shapes(part)))
    assert tip == pytest.approx(load * part.length**4 / (8.0 * bending), rel=2e-3)
    moment = np.linalg.norm(delta @ root_moments(part))
    assert moment == pytest.approx(load * part.length**2 / 2.0, rel=0.03)


@pytest.fixture(scope="module")
def turned(model):
    """Four seconds under a torque on the bus and on a wheel."""
    e = Experiment(
        name="e",
        duration=4.0,
        torque=ConstantProfile(value=(0.0, 0.0, 20.0)),
        wheel_torque=ConstantProfile(value=(1.0, 0.0, 0.0)),
        lock_joints=True,
    )
    motion = simulate(model, e.inputs(), 4.0, q0=e.start(model))
    return motion.states(np.linspace(0.0, 4.0, 200))


def test_user_limits_reach_what_they_are_for(model, turned):
    limits = Limits(pointing=0.01, wheel_torque=0.5, wheel_rate=1.0, stroke=1e-6, joint_rate=0.1)
    broken = {u.quantity for u in limits.violations(limits.use(model, turned, False))}
    assert {"turn of the bus", "torque of wheel_x", "rate of wheel_x", "stroke of tank"} <= broken
    assert not any("joint" in name for name in broken)
    assert not Limits().violations(Limits().use(model, turned, False))


def test_the_tighter_limit_counts(model, turned):
    loose = {u.quantity: u.limit for u in Limits(wheel_torque=9.0).use(model, turned, False)}
    assert loose["torque of wheel_x"] == 2.0
    tight = {u.quantity: u.limit for u in Limits(wheel_torque=0.3).use(model, turned, False)}
    assert tight["torque of wheel_x"] == 0.3


def test_turn_of_the_bus(model, turned):
    """From the attitude itself: angle of the last quaternion against the first."""
    use = {u.quantity: u.value for u in Limits().use(model, turned, False)}["turn of the bus"]
    angles = 2.0 * np.arccos(np.clip(np.abs(turned.q[:, 3:7] @ turned.q[0, 3:7]), 0.0, 1.0))
    assert use == pytest.approx(angles.max(), rel=1e-4)
    assert use > 0.01


def test_margin_is_left():
    use = LimitUse("stroke of tank", 0.49, 0.5, "m")
    assert not Limits(margin=0.02).violations([use])
    assert Limits(margin=0.03).violations([use]) == (use,)


@pytest.mark.parametrize("bad", [{"stroke": 0.0}, {"tip": -1.0}, {"margin": 1.0}, {"force": float("nan")}])
def test_limits_that_are_none_are_told(bad):
    with pytest.raises(ExperimentError):
        Limits(**bad)
