"""Simulations with held inputs: compiled against the plain way, to 1e-10."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.effects import JointFriction
from smsid.errors import SimulationError
from smsid.kernel.arrays import Kernel, arrays_of
from smsid.model import build_model
from smsid.simulate import Inputs, PiecewiseConstant, Sampled, Tolerance, simulate, simulate_closed_loop
from smsid.simulate._held_chart import HeldChart
from smsid.simulate.held_step import held_step, take_held_steps

from .test_filter import FORCES, LAWS


def held(model, seconds, rate, seed=0):
    """Return inputs held at a rate [Hz]: joint torques, and a force on a free bus from half a second on."""
    rng, times = np.random.default_rng(seed), np.arange(round(seconds * rate) + 1) / rate
    given = {}
    if len(model.arm_joints):
        torque = rng.uniform(-2.0, 2.0, (len(times), len(model.arm_joints)))
        given["joint_torque"] = Sampled.from_samples(times, torque, degree=0)
    if model.free:
        given["force"] = PiecewiseConstant((0.5, 1.25), rng.uniform(-5.0, 5.0, (2, 3)))
    return Inputs(**given)


def start(model):
    return 0.05 * np.random.default_rng(5).standard_normal(model.nv)


@pytest.mark.parametrize(("tolerance", "rate"), [(Tolerance(), 50.0), (Tolerance(1e-11, 1e-13), 200.0)])
def test_open_loop(craft, both_ways, tolerance, rate):
    """States between samples and at them, in any order, accelerations and the audit."""
    inputs, times = held(craft, 2.0, rate), np.random.default_rng(2).permutation(np.linspace(0.0, 2.0, 301))

    def fly():
        found = simulate(craft, inputs, 2.0, v0=start(craft), tolerance=tolerance)
        return found, found.states(times), found.audit()

    (motion, ours, audit), (plain, exact, expected) = both_ways(fly)
    assert not any(isinstance(c, HeldChart) for c in plain.charts)
    if craft.nv > 6:
        assert any(isinstance(c, HeldChart) for c in motion.charts)
    for name in ("q", "v", "a", "tau"):
        a, b = getattr(ours, name), getattr(exact, name)
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10 * max(1.0, np.abs(b).max()), err_msg=name)
    assert audit.energy_scale == pytest.approx(expected.energy_scale, rel=1e-9)
    assert audit.energy_drift < 1e-7 * audit.energy_scale


RUB = {k: JointFriction(name="rub", joint="joint2", smoothing=0.5, **x) for k, x in LAWS.items()}
LAWFUL = {**RUB, **FORCES}


@pytest.mark.parametrize("law", LAWFUL)
def test_forces_by_a_law(crafts, both_ways, law):
    """Open and closed loops with each of the forces the kernel knows, some of which begin on the way."""
    craft = build_model(crafts["paper"].description.with_effects(LAWFUL[law]))
    inputs, times = held(craft, 1.0, 100.0), np.linspace(0.0, 1.0, 77)

    def fly():
        found = simulate(craft, inputs, 1.0, v0=start(craft))
        loop = simulate_closed_loop(
            craft, lambda t, q, v: -5.0 * v, 1.0, dt=0.005, control_rate=20.0, v0=start(craft)
        )
        return found, found.states(times), found.audit(), loop

    assert Kernel.of(craft) is not None
    (motion, ours, audit, loop), (_, exact, expected, plain) = both_ways(fly)
    assert sum(len(c.tau) for c in motion.charts if isinstance(c, HeldChart)) > 40
    for name in ("q", "v", "a", "tau"):
        for x, y in ((ours, exact), (loop, plain)):
            if hasattr(x, name):
                a, b = getattr(x, name), getattr(y, name)
                np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10 * max(1.0, np.abs(b).max()))
    assert audit.energy_drift < 1e-7 * expected.energy_scale
    assert loop.audit.energy_drift == pytest.approx(
        plain.audit.energy_drift, abs=1e-11 * plain.audit.energy_scale, rel=1e-6
    )


def test_a_stretch_is_taken_in_parts_where_its_error_says_so(crafts, both_ways):
    craft = crafts["paper"]
    inputs = held(craft, 2.0, 100.0)
    motion, _ = both_ways(
        lambda: simulate(craft, inputs, 2.0, v0=start(craft), tolerance=Tolerance(1e-11, 1e-13))
    )
    parts = np.concatenate([c.parts for c in motion.charts if isinstance(c, HeldChart)])
    assert parts.max() > 1 and motion.steps >= parts.sum()


def test_progress_and_a_longest_step(crafts, both_ways):
    craft, told = crafts["paper"], []
    inputs = held(craft, 1.0, 50.0)
    ours, plain = both_ways(
        lambda: simulate(craft, inputs, 1.0, max_step=0.004, progress=told.append).states(np.array([1.0]))
    )
    np.testing.assert_allclose(ours.v, plain.v, atol=1e-10)
    assert told[-1] == 1.0 and told.count(1.0) == 2


def test_closed_loop(craft, both_ways):
    """Feedback at 20 Hz, late, in steps of 10 ms, with the audit."""

    def controller(t, q, v):
        tau = -5.0 * v
        tau[:] += np.sin(3.0 * t)
        return tau

    def fly():
        return simulate_closed_loop(
            craft, controller, 2.0, dt=0.01, control_rate=20.0, v0=start(craft), delay=1
        )

    ours, plain = both_ways(fly)
    for name in ("q", "v", "tau"):
        a, b = getattr(ours, name), getattr(plain, name)
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10 * max(1.0, np.abs(b).max()), err_msg=name)
    for name in ("momentum_scale", "energy_scale"):
        assert getattr(ours.audit, name) == pytest.approx(getattr(plain.audit, name), rel=1e-10)
    for name, scale in (("momentum_drift", "momentum_scale"), ("energy_drift", "energy_scale")):
        size = 1e-11 * getattr(plain.audit, scale)
        expected = getattr(plain.audit, name)
        assert getattr(ours.audit, name) == pytest.approx(expected, abs=size, rel=1e-6, nan_ok=True)


def test_steps_that_disagree_are_left_to_the_adaptive_method(crafts, both_ways):
    """A panel far too fast for the step: both ways take the adaptive one, and agree."""
    craft = crafts["paper"]
    q, v, tau = craft.home, start(craft), np.zeros(craft.nv)
    fast = arrays_of(craft)
    fast.bodies[craft.modes.v - 6, 26] *= 1e5

    def steps(kernel):
        qs, vs = np.empty((3, craft.nq)), np.full((3, craft.nv), np.nan)
        qs[0], vs[0] = q, v
        take_held_steps(craft, kernel, 0.0, 0.01, qs, vs, tau)
        return vs

    exact, one = steps(None), held_step(craft, 0.0, 0.01, q, v, tau)[1]
    np.testing.assert_allclose(exact[1], one, atol=1e-12)
    # the arrays say what the model does not: were the kernel's step taken, it would be another
    np.testing.assert_allclose(steps(fast), exact, atol=1e-12)


def test_an_unstable_loop_is_told_with_its_time(crafts, both_ways):
    def fly():
        with pytest.raises(SimulationError, match="blew up at t = ") as caught:
            simulate_closed_loop(
                crafts["satellite"], lambda t, q, v: 1e200 * (1.0 + v**2), 1.0, dt=0.05, control_rate=10.0
            )
        return caught.value.evidence

    ours, plain = both_ways(fly)
    assert ours["time"] == plain["time"]
    np.testing.assert_array_equal(ours["v"], plain["v"])
