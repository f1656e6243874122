"""What changed between two estimates of known truth is found, and nothing where nothing changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from smsid.comparison import compare, load_comparison, save_comparison
from smsid.effects import BodyError
from smsid.errors import SmsidError
from smsid.identify.estimate import Estimate, classify

from .estimates import craft, estimate, grasped

NOISE = 0.2


def test_nothing_is_found_in_a_hundred_pairs_of_the_same_craft():
    found = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        before, after = (estimate(craft(), rng, noise=NOISE, name=n) for n in "ab")
        found.append(compare(before, after))
    assert not any(c.changed or c.findings for c in found)
    assert not any(p.changed for c in found for p in c.parameters)
    p_values = [c.p_value for c in found]
    assert found[0].freedom == 35
    assert kstest(p_values, "uniform").pvalue > 0.01, "chi-squared is what it says"


@pytest.mark.parametrize("mass", [1.0, 5.0, 20.0, 60.0, 150.0, 300.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_grasped_body_is_found_at_the_last_link(mass, seed):
    rng = np.random.default_rng(seed)
    after = grasped(mass)
    true = after.get_effect("target")
    found = compare(
        estimate(craft(), rng, noise=NOISE), estimate(after, rng, noise=NOISE), craft(), names=("a", "b")
    )
    assert found.changed
    assert [(f.kind, f.subject, f.others) for f in found.findings] == [("body_grasped", "link3", ())]
    body = found.findings[0]
    numbers = {"mass": true.mass}
    numbers |= {f"centre.{a}": x for a, x in zip("xyz", true.centre, strict=True)}
    axes = ("xx", "xy", "yy", "xz", "yz", "zz")
    numbers |= {f"inertia.{a}": x for a, x in zip(axes, true.inertia, strict=True)}
    numbers |= {f"first_moment.{a}": x for a, x in zip("xyz", true.first_moment, strict=True)}
    for name, truth in numbers.items():
        assert body[name].told
        assert abs(body[name].value - truth) < 4.0 * body[name].sigma, name
    assert found.left is not None and found.left > 1e-3


def test_intervals_of_a_grasped_body_hold_the_truth():
    """95 % of the intervals of ten parameters in 60 pairs, within the binomial band of that many."""
    after = grasped(60.0)
    truth = after.get_effect("target").inertial_parameters()
    axes = ("xx", "xy", "yy", "xz", "yz", "zz")
    names = ("mass", *(f"first_moment.{a}" for a in "xyz"), *(f"inertia.{a}" for a in axes))
    inside = []
    for seed in range(60):
        rng = np.random.default_rng(1000 + seed)
        body = compare(estimate(craft(), rng, noise=NOISE), estimate(after, rng, noise=NOISE)).findings[0]
        for name, x in zip(names, truth, strict=True):
            low, high = body[name].interval
            inside.append(low <= x <= high)
    assert 0.92 <= np.mean(inside) <= 0.98


@pytest.mark.parametrize("link", ["link1", "link2"])
def test_it_is_found_at_another_link(link):
    rng = np.random.default_rng(3)
    after = grasped(30.0, link=link)
    found = compare(estimate(craft(), rng, noise=NOISE), estimate(after, rng, noise=NOISE))
    assert found.findings[0].kind == "body_grasped"
    assert link in (found.findings[0].subject, *found.findings[0].others)


def test_a_body_let_go_is_said_to_be_released():
    rng = np.random.default_rng(4)
    found = compare(estimate(grasped(60.0), rng, noise=NOISE), estimate(craft(), rng, noise=NOISE))
    assert [(f.kind, f.subject) for f in found.findings] == [("body_released", "link3")]
    assert found.findings[0]["mass"].value == pytest.approx(-60.0, abs=1.0)


def test_fuel_used_is_told_with_the_tank_it_left():
    """A point mass less at the tank's place, and less of it sloshing."""
    place = np.array(craft().get_effect("tank").position)
    loss = 12.0
    lost = BodyError(
        name="used",
        mass=-loss,
        first_moment=tuple(-loss * place),
        inertia=tuple(-loss * _about(place)),
    )
    tank = craft().get_effect("tank").with_values({"tank.mass": 40.0})
    rng = np.random.default_rng(5)
    before, after = (estimate(d, rng, noise=NOISE) for d in (craft(), craft().with_effects(lost, tank)))
    found = compare(before, after, craft())
    assert {(f.kind, f.subject) for f in found.findings} == {
        ("mass_left", "bus_body" if "bus_body" in str(before.names) else "bus"),
        ("effect_changed", "tank"),
    }
    fuel = next(f for f in found.findings if f.kind == "mass_left")
    assert "of fuel has been used from 'tank'" in fuel.sentence
    assert abs(fuel["mass"].value + loss) < 4.0 * fuel["mass"].sigma
    slosh = next(f for f in found.findings if f.kind == "effect_changed")
    assert "less propellant sloshes in it: tank.mass 49" in slosh.sentence


def _about(x):
    a, b, c = x
    return np.array([b * b + c * c, -a * b, a * a + c * c, -a * c, -b * c, a * a + b * b])


def test_a_grasp_and_a_tank_are_told_apart_when_both_changed():
    rng = np.random.default_rng(6)
    tank = craft().get_effect("tank").with_values({"tank.stiffness.x": 0.45})
    found = compare(
        estimate(craft(), rng, noise=NOISE),
        estimate(grasped(20.0).with_effects(tank), rng, noise=NOISE),
        craft(),
    )
    assert {(f.kind, f.subject) for f in found.findings} == {
        ("body_grasped", "link3"),
        ("effect_changed", "tank"),
    }
    assert "its propellant is held more stiffly" in " ".join(f.sentence for f in found.findings)


def test_a_change_that_no_body_and_no_effect_makes_is_not_explained_away():
    """One combination alone is off by 30 sigma: it is said, and no body of ten parameters is made up."""
    a = estimate(craft(), None, noise=NOISE)
    k = a.names.index("link2.mx + 2 link3.m")
    p = a.parameters[k]
    other = list(estimate(craft(), None, noise=NOISE).parameters)
    other[k] = replace(p, value=p.value + 30.0 * p.sigma)
    found = compare(a, replace(a, parameters=tuple(other)))
    assert found.changed
    assert not [f for f in found.findings if f.kind in ("body_grasped", "body_released")]
    assert [q.name for q in found.parameters if q.changed] == ["link2.mx + 2 link3.m"]


def test_without_covariance_parameters_are_compared_one_by_one_and_nothing_is_said_jointly():
    rng = np.random.default_rng(7)
    a = estimate(craft(), rng, noise=NOISE)
    b = estimate(grasped(60.0), rng, noise=NOISE)
    bare = Estimate(b.description, "paper", b.parameters)
    found = compare(a, bare)
    assert found.statistic is None and found.p_value is None
    assert found.changed and not found.findings
    assert any("has no covariance" in n for n in found.notes)


def test_a_comparison_comes_back_from_its_file(tmp_path):
    rng = np.random.default_rng(8)
    found = compare(estimate(craft(), rng, noise=NOISE), estimate(grasped(5.0), rng, noise=NOISE), craft())
    save_comparison(found, tmp_path / "c.json")
    assert load_comparison(tmp_path / "c.json") == found
    (tmp_path / "c.json").write_text('{"kind": "estimate", "schema": 1}')
    with pytest.raises(SmsidError, match="of the kind 'estimate', no comparison"):
        load_comparison(tmp_path / "c.json")


def test_estimates_that_share_a_recording_are_said_not_to_be_independent():
    a = estimate(craft(), np.random.default_rng(9), noise=NOISE, name="one")
    assert any("not independent" in n for n in compare(a, a).notes)


def test_a_rotor_in_a_sum_hides_no_link():
    """1.5 kg on the outer link change the sum that the inner link's joint tells, rotor included: nothing but
    the body grasped has changed.
    """
    mass, at = 1.5, 0.4
    rows = (  # name, unit, before, what the body adds
        ("slide.m", "kg", 3.4, mass),
        ("slide.mx", "kg m", 0.54, mass * at),
        ("swing.Iyy + slide.Iyy + rotor_luff.inertia", "kg m^2", 1.16, mass * at**2),
        ("swing.mx", "kg m", 2.0, 0.0),
    )
    pair = []
    for share in (0.0, 1.0):
        own = [classify(n, x + share * more, u, 0.002, "arm", nominal=x) for n, u, x, more in rows]
        pair.append(Estimate("arm", "filter", tuple(own), covariance=0.002**2 * np.eye(len(rows))))
    found = compare(*pair)
    assert [(f.kind, f.subject) for f in found.findings] == [("body_grasped", "slide")]
    assert abs(found.findings[0]["mass"].value - mass) < 0.01
