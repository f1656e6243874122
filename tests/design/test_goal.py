"""Goals: which words stand for which parameters, and criteria against their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.design._goal import Goal, goal_of, needs_motion
from smsid.errors import ExperimentError
from smsid.likelihood.parameters import Parameters


@pytest.fixture(scope="module")
def parameters(model):
    return Parameters.of(model)


@pytest.mark.parametrize(
    ("word", "first", "count"),
    [
        ("b_s", "tank.damping.x", 3),
        ("k_s", "tank.stiffness.x", 3),
        ("m_s", "tank.mass", 1),
        ("slosh", "tank.mass", 7),
        ("tank", "tank.mass", 7),
        ("panel", "panel.linear_density", 7),
        ("appendage", "panel.linear_density", 7),
        ("mass", "total.mass", 1),
        ("tank.damping.y", "tank.damping.y", 1),
        ("panel.mode?.frequency", "panel.mode1.frequency", 3),
    ],
)
def test_words(parameters, word: str, first: str, count: int):
    goal = goal_of(parameters, [word], "worst", None)
    assert goal.names[0] == first and len(goal.names) == count
    assert not needs_motion(parameters, [word])


def test_inertia_needs_motion(parameters):
    assert needs_motion(parameters, ["slosh", "inertia"])
    with pytest.raises(ExperimentError, match="nothing moves that would show them"):
        goal_of(parameters, ["inertia"], "worst", None)


def test_unknown_words_are_told(parameters):
    with pytest.raises(ExperimentError, match=r"nothing 'slosch' to be found out\. Did you mean 'slosh'"):
        goal_of(parameters, ["slosch"], "worst", None)


def random_goal(rng: np.random.Generator, criterion: str) -> tuple[Goal, np.ndarray]:
    root = rng.normal(size=(6, 6))
    goal = Goal(
        ("a", "b", "c"),
        ("1",) * 3,
        np.ones(3),
        np.array([1.0, 2.0, 0.5]),
        rng.normal(size=(3, 5)),
        criterion,  # type: ignore[arg-type]
    )
    return goal, root @ root.T


@pytest.mark.parametrize("criterion", ["worst", "A", "D"])
def test_weight_is_the_derivative_of_the_cost(criterion: str):
    rng = np.random.default_rng(1)
    goal, covariance = random_goal(rng, criterion)
    _, weight = goal.cost_and_weight(covariance)
    change = rng.normal(size=(6, 6))
    change = change + change.T
    up, down = (goal.cost(covariance + h * change) for h in (1e-5, -1e-5))
    assert np.sum(weight * change) == pytest.approx((up - down) / 2e-5, rel=1e-5)


def test_criteria_are_what_they_say():
    goal, covariance = random_goal(np.random.default_rng(2), "A")
    sigma = goal.relative(covariance)
    assert np.exp(goal.cost(covariance)) == pytest.approx(np.sqrt(np.mean(sigma**2)))
    worst = np.exp(goal.by("worst").cost(covariance))
    assert sigma.max() * 3 ** (-1 / 16) <= worst <= sigma.max()
    scaled = goal.gradients / goal.scales[:, None]
    own = scaled @ covariance[:5, :5] @ scaled.T
    assert np.exp(6 * goal.by("D").cost(covariance)) == pytest.approx(np.linalg.det(own))
