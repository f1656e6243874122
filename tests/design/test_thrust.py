"""Linear answers to pulses of thrust against simulation, finite differences and the full Cramer-Rao bound."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.design._forecast import Forecast
from smsid.design._goal import goal_of
from smsid.design._limits import Limits
from smsid.design._thrust import thrust_space
from smsid.design._thrusting import Feasible, best_pulses, intervals_of, random_start, thrust_steps
from smsid.experiments.fly import limit_use
from smsid.likelihood import fisher_information
from smsid.simulate import simulate

DURATION = 24.0
LIMITS = Limits(stroke=0.2, tip=0.5, root_moment=20.0)


@pytest.fixture(scope="module")
def space(model):
    return thrust_space(Forecast.of(model, DURATION), (0, 2), 24, LIMITS, 50.0)


@pytest.fixture(scope="module")
def goal(space):
    return goal_of(space.forecast.parameters, ["slosh", "panel"], "worst", None)


@pytest.fixture(scope="module")
def thrust(space):
    return 10.0 * random_start(space, np.random.default_rng(4))


def flown(thrust: np.ndarray):
    """The thrust (intervals, 2) along x and z as an experiment."""
    whole = np.zeros((len(thrust), 3))
    whole[:, [0, 2]] = thrust
    return thrust_steps(whole, DURATION)


def answer(space, bound, thrust):
    """What a bound is on, (times, components), under thrust (intervals, axes) [N]."""
    return np.einsum("tcua,ua->tc", space.matrix(bound), thrust)


def test_sigma_is_that_of_the_full_bound(description, space, goal, thrust):
    """Thinned samples and long steps against every sample of a simulated experiment."""
    full = fisher_information(description, flown(thrust)).sigma
    quick = goal.relative(space.covariance(thrust)[0]) * goal.scales
    for name, sigma in zip(goal.names, quick, strict=True):
        if not name.endswith(".y"):
            assert sigma == pytest.approx(full[name], rel=0.05), name


def test_slope_is_that_of_differences(space, goal, thrust):
    covariance, jacobian = space.covariance(thrust)
    for criterion in ("worst", "A", "D"):
        own = goal.by(criterion)
        _, weight = own.cost_and_weight(covariance)
        slope = space.cost_gradient(jacobian, weight, covariance)
        way = np.random.default_rng(0).normal(size=thrust.shape)
        up, down = (own.cost(space.covariance(thrust + h * way)[0]) for h in (1e-3, -1e-3))
        assert np.sum(slope * way) == pytest.approx((up - down) / 2e-3, rel=1e-4), criterion


def test_bounded_answers_are_those_of_a_simulation(model, space, thrust):
    experiment = flown(thrust)
    motion = simulate(model, experiment.inputs(), DURATION, q0=experiment.start(model))
    states = motion.states(np.linspace(0.0, DURATION, space.samples))
    uses = {u.quantity: u.value for u in limit_use(model, states, True)}
    uses |= {u.quantity: u.value for u in LIMITS.use(model, states, True)}
    assert {b.quantity for b in space.bounds} <= set(uses)
    for bound in space.bounds:
        largest = np.linalg.norm(answer(space, bound, thrust), axis=1).max()
        assert largest == pytest.approx(uses[bound.quantity], rel=1e-3), bound.quantity


def test_the_search_gains_and_keeps_all_limits(space, goal, thrust):
    feasible = Feasible(space)
    start = thrust * feasible.scale(thrust)
    costs: list[float] = []
    found, cost = best_pulses(space, goal, thrust, feasible, lambda _, cost: costs.append(cost))
    assert costs == sorted(costs, reverse=True)
    assert cost < goal.cost(space.covariance(start)[0])
    assert np.abs(found).max() <= 50.0 * (1 + 1e-9)
    for bound in space.bounds:
        assert np.linalg.norm(answer(space, bound, found), axis=1).max() <= bound.limit * (1 + 1e-6)


def test_information_of_a_thrust_twice_as_strong(space, thrust):
    """Where nothing else is unknown, four times as much: a quadratic form without linear part."""
    own = space.rows.any(axis=(0, 1, 3)) & ~space.still.any(axis=(0, 1))
    one, two = (space.jacobian(f * thrust)[:, :, own] for f in (1.0, 2.0))
    np.testing.assert_allclose(two, 2.0 * one, atol=1e-9 * np.abs(one).max())


@pytest.mark.parametrize("duration", [120.0, 60.0, 100.0, 105.6, 37.5, 83.21])
def test_intervals_end_on_ticks(duration: float):
    count = intervals_of(duration)
    assert 40 <= count <= 72
    ticks = duration / count / 0.01
    assert abs(ticks - round(ticks)) < 1e-6 or duration == 83.21
