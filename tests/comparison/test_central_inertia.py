"""A body about its centre of mass in one estimate, about the origin in the other: they are compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from smsid.comparison import compare
from smsid.comparison._common_basis import CENTRAL, in_terms_of
from smsid.identify.estimate import Estimate, classify
from smsid.model.regressor import INERTIAL_NAMES

THETA = np.array([12.0, 0.6, -0.36, 1.2, 2.0, 0.1, 3.0, -0.2, 0.05, 4.0])
ROOT = np.diag([0.02, 0.01, 0.01, 0.01, *6 * [0.03]]) @ (np.eye(10) + 0.3 * np.tri(10, k=-1))
UNITS = ("kg", *3 * ("kg m",), *6 * ("kg m^2",))


def made(names, values, covariance, units=UNITS, name="flight"):
    sigma = np.sqrt(np.diag(covariance))
    rows = zip(names, values, units, sigma, strict=True)
    found = [classify(f"bus.{n}", float(x), u, float(s), "maximum_likelihood") for n, x, u, s in rows]
    return Estimate("craft", "maximum_likelihood", tuple(found), (name,), covariance=covariance)


def by_origin(theta=THETA):
    return made(INERTIAL_NAMES, theta, ROOT @ ROOT.T)


def central(theta):
    """By Steiner's theorem, written out."""
    m, c = theta[0], theta[1:4] / theta[0]
    xx, xy, yy, xz, yz, zz = theta[4:]
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - m * (c @ c * np.eye(3) - np.outer(c, c))
    return np.array([*c, own[0, 0], own[0, 1], own[1, 1], own[0, 2], own[1, 2], own[2, 2]])


def about_centre(theta=THETA, own=range(9), sigma=0.01):
    own = list(own)
    units = [("m" if k < 3 else "kg m^2") for k in own]
    return made([CENTRAL[k] for k in own], central(theta)[own], sigma**2 * np.eye(len(own)), units, "wheels")


def test_values_and_covariance_are_those_of_draws():
    found = in_terms_of(by_origin(), about_centre())
    assert [p.name for p in found.parameters] == ["bus.m", *(f"bus.{c}" for c in CENTRAL)]
    np.testing.assert_allclose([p.value for p in found.parameters[1:]], central(THETA), rtol=1e-9)
    rng = np.random.default_rng(0)
    drawn = np.array([central(THETA + ROOT @ rng.normal(size=10)) for _ in range(20_000)])
    size = np.sqrt(np.diag(found.covariance))[1:]
    np.testing.assert_allclose(
        np.cov(drawn.T) / np.outer(size, size), found.covariance[1:, 1:] / np.outer(size, size), atol=0.03
    )
    np.testing.assert_allclose([p.sigma for p in found.parameters[1:]], size)


def test_the_same_craft_has_not_changed_and_another_one_has():
    some = [3, 5, 8]  # Icxx, Icyy, Iczz alone
    same = compare(by_origin(), about_centre(own=some))
    assert [p.name for p in same.parameters] == ["bus.Icxx", "bus.Icyy", "bus.Iczz"]
    assert not any(p.changed for p in same.parameters)
    heavier = THETA + 0.6 * np.eye(10)[4]
    for pair in ((by_origin(heavier), about_centre(own=some)), (about_centre(own=some), by_origin(heavier))):
        assert [p.name for p in compare(*pair).parameters if p.changed] == ["bus.Icxx"]


def test_what_the_centre_of_mass_needs_must_be_told():
    """Without mass nothing is put about the centre; without a covariance nothing goes together."""
    whole = by_origin()
    lone = replace(whole, parameters=whole.parameters[1:], covariance=whole.covariance[1:, 1:])
    assert in_terms_of(lone, about_centre()) is lone
    assert {x.name for x in compare(lone, about_centre(own=[3])).not_comparable} >= {"bus.Icxx", "bus.Ixx"}
    found = in_terms_of(replace(whole, covariance=None), about_centre(own=[0]))
    m, mx = whole.parameters[:2]
    expected = np.hypot(mx.sigma / m.value, mx.value * m.sigma / m.value**2)
    assert found.covariance is None
    assert found.parameters[1].sigma == pytest.approx(expected)
