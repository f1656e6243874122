"""Combinations that differ in name are brought to what both estimates know, or said not to be comparable."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.comparison import compare
from smsid.comparison._common_basis import common_basis
from smsid.identify.estimate import Estimate, classify

from .estimates import craft, estimate, grasped


def made(values, covariance=None, group="maximum_likelihood"):
    sigma = np.sqrt(np.diag(covariance)) if covariance is not None else np.ones(len(values))
    found = [classify(n, x, "kg", float(s), group) for (n, x), s in zip(values.items(), sigma, strict=True)]
    return Estimate("craft", group, tuple(found), covariance=covariance)


def test_a_combination_of_the_others_is_made_with_its_covariance():
    """a knows x and y, b their sum and y: x is b's difference, with the covariance of that."""
    a = made({"p.m": 3.0, "q.m": 5.0}, np.diag([1.0, 4.0]))
    c = np.array([[2.0, 0.5], [0.5, 1.0]])
    b = made({"p.m + 2 q.m": 14.0, "q.m": 5.5}, c)
    found = common_basis(a, b)
    assert found.names == ("q.m", "p.m")
    assert found.derived.tolist() == [False, True]
    np.testing.assert_allclose(found.after, [5.5, 14.0 - 11.0])
    weights = np.array([1.0, -2.0])
    assert found.covariances[1][1, 1] == pytest.approx(weights @ c @ weights)
    assert found.covariances[1][0, 1] == pytest.approx(0.5 - 2.0)
    assert not found.not_comparable


def test_what_the_other_does_not_tell_is_named_with_the_reason():
    a = made({"p.m": 3.0, "q.m": 5.0, "tank.mass": 1.0}, np.eye(3))
    b = made({"p.m + 2 q.m": 14.0}, np.eye(1))
    found = common_basis(a, b)
    assert found.names == ("p.m + 2 q.m",)
    np.testing.assert_allclose(found.before, [13.0])
    assert {(x.name, x.estimate) for x in found.not_comparable} == {
        ("p.m", "first"), ("q.m", "first"), ("tank.mass", "first")
    }  # fmt: skip
    assert {x.reason for x in found.not_comparable if x.name == "tank.mass"} == {
        "the other estimate does not have it"
    }


def test_factors_rounded_alike_are_the_same_combination():
    a, b = (made({f"p.m + {f} q.m": 1.0}, np.eye(1)) for f in ("1.333", "1.3331"))
    assert common_basis(a, b).names == ("p.m + 1.333 q.m",)
    assert not common_basis(a, made({"p.m + 1.35 q.m": 1.0}, np.eye(1))).names


def test_biases_of_recordings_are_not_compared():
    a = made({"p.m": 1.0}, np.eye(1), group="nuisance")
    found = compare(a, a)
    assert not found.parameters
    assert found.sentence.startswith("Nothing can be compared")


@pytest.mark.parametrize("seed", range(5))
def test_bases_lumped_towards_the_tips_and_towards_the_bus_compare_alike(seed):
    """All 31 combinations of the one are combinations of the other's: no false change, the grasp found."""
    rng = np.random.default_rng(seed)
    before = estimate(craft(), rng, noise=0.2)
    same = estimate(craft(), rng, noise=0.2, tipwards=True)
    assert not set(before.names) <= set(same.names)
    found = compare(before, same, craft())
    assert found.freedom == 35 and not found.changed
    grasp = compare(before, estimate(grasped(60.0), rng, noise=0.2, tipwards=True), craft())
    assert [(f.kind, f.subject) for f in grasp.findings] == [("body_grasped", "link3")]
    mass = grasp.findings[0]["mass"]
    assert abs(mass.value - 60.0) < 4.0 * mass.sigma


def test_a_parameter_without_bound_hides_no_change():
    """Infinite intervals stand on the diagonal where an estimate has no covariance."""
    sigmas = {"a.m": 0.1, "b.m": 0.2, "c.m": np.inf}
    before, after = (
        Estimate(
            "d",
            "paper",
            tuple(classify(n, x if n == "a.m" else 1.0, "kg", s, "g") for n, s in sigmas.items()),
        )
        for x in (1.0, 5.0)
    )
    found = compare(before, after)
    assert found["a.m"].changed and found["a.m"].sigma == pytest.approx(0.1 * np.sqrt(2.0))
    assert not found["b.m"].changed and found.changed
    assert {n.name for n in found.not_comparable} == {"c.m"}
