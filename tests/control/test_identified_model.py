"""The estimate's values in the controller's model: exact where the estimate is, whatever the description."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest
from control_cases import URDF, paper

from smsid.control.identified_model import identified_level, identified_model, inertia_at
from smsid.control.reduced import ReducedDynamics
from smsid.description import load_description
from smsid.effects.appendage import BeamAppendage
from smsid.effects.slosh import Slosh
from smsid.errors import ControlError
from smsid.estimation.bodies import identified_bodies, inertial_equations, with_estimate
from smsid.identify.estimate import Estimate, classify
from smsid.identify.momentum_rows import carried_by_bus
from smsid.identify.parameter_estimate import parse_combination
from smsid.model import build_model
from smsid.model.regressor import Regressor, body_names

ARM = [np.array(x) for x in ([0.4, -0.6, 0.9], [0.0, 0.0, 0.0], [1.2, 0.7, -1.5])]
COMBINATIONS = """bus.mx - link1.m - link2.m - link3.m
bus.my - link1.m - link2.m - link3.m
bus.mz + link1.m + link1.mz + 1.5 link2.m + 1.5 link3.m
bus.Ixx + 2 link1.m + 2 link1.mz + link1.Iyy + 3.25 link2.m + 3.25 link3.m
bus.Ixy - link1.m - link2.m - link3.m
bus.Iyy + 2 link1.m + 2 link1.mz + link1.Iyy + 3.25 link2.m + 3.25 link3.m
bus.Ixz + link1.m + link1.mz + 1.5 link2.m + 1.5 link3.m
bus.Iyz + link1.m + link1.mz + 1.5 link2.m + 1.5 link3.m
bus.Izz + 2 link1.m + 2 link2.m + 2 link3.m
link1.mx
link1.my + link2.my + link3.my
link1.Ixx - link1.Iyy + link2.Izz + 4 link3.m + link3.Izz
link1.Ixy
link1.Ixz
link1.Iyz - 0.5 link2.my - 0.5 link3.my
link1.Izz + link2.Izz + 4 link3.m + link3.Izz
link2.mx + 2 link3.m
link2.mz
link2.Ixx - link2.Izz - 4 link3.m
link2.Ixy - 2 link3.my
link2.Iyy + 4 link3.m
link2.Ixz
link2.Iyz
link3.mx
link3.mz
link3.Ixx - link3.Izz
link3.Ixy
link3.Iyy
link3.Ixz
link3.Iyz""".splitlines()
"""What Exp. 2 identifies of the paper's spacecraft, as an estimate's file names it."""


def true_estimate(sigma: float = 1e-6, **changes: float) -> Estimate:
    """The paper's spacecraft as an estimate without error, every sigma relative."""
    model = paper()
    regressor = Regressor(model)
    theta = regressor.parameters + carried_by_bus(model, regressor)
    index = {n: k for k, n in enumerate(regressor.names)}
    found = [classify("total.mass", model.mass, "kg", sigma * model.mass, "exp1")]
    tank = next(e for e in model.description.effect if isinstance(e, Slosh))
    panel = next(e for e in model.description.effect if isinstance(e, BeamAppendage))
    scalars = {p.name: (p.value, p.unit) for p in tank.parameters()}
    scalars["panel.linear_density"] = panel.linear_density, "kg/m"
    for k, mode in enumerate(panel.modal_data(), start=1):
        scalars[f"panel.mode{k}.frequency"] = mode.frequency, "Hz"
        scalars[f"panel.mode{k}.damping"] = mode.damping, "1"
    for name, (value, unit) in scalars.items():
        found.append(classify(name, changes.get(name, value), unit, sigma * value, "exp1"))
    for name in COMBINATIONS:
        terms = parse_combination(name)
        assert terms is not None
        value = float(sum(factor * theta[index[n]] for n, factor in terms.items()))
        size = max(abs(value), 50.0 if ".I" in name.split(" ")[0] else 10.0)
        found.append(classify(name, value, "SI", sigma * size, "exp2.step_b", reference=size))
    return Estimate("paper_sms", "paper", tuple(found))


def wrong_description(folder):
    """Bus and links, slosh and panel 20 to 30 % off; geometry as it is."""
    tree = ElementTree.parse(URDF / "paper_sms.urdf")
    for k, inertial in enumerate(tree.getroot().iter("inertial")):
        for tag in ("mass", "inertia"):
            node = inertial.find(tag)
            for key, text in node.attrib.items():
                node.set(key, repr(float(text) * (1.3 if k % 2 else 0.75)))
    tree.write(folder / "wrong.urdf")
    described = load_description(URDF / "paper_sms.toml")
    effects = []
    for e in described.effect:
        if isinstance(e, Slosh):
            effects.append(e.model_copy(update={"mass": 1.3 * e.mass, "stiffness": (0.3, 0.5, 0.33)}))
        else:
            effects.append(e.model_copy(update={"density": 0.8 * e.density, "damping": 0.006}))
    return described.model_copy(update={"folder": folder, "urdf": "wrong.urdf"}).with_effects(*effects)


def test_a_wrong_description_with_a_true_estimate_is_the_true_spacecraft(tmp_path):
    """H of (40) at any arm angles, slosh, springs, modes; what the data do not see does not matter."""
    wrong = wrong_description(tmp_path)
    found = identified_model(wrong, true_estimate())
    assert found.left == () and found.misfit < 0.5
    exact, ours = ReducedDynamics(paper()), found.dynamics()
    before = ReducedDynamics(identified_model(wrong, true_estimate()).model)
    for angles in ARM:
        h = inertia_at(exact, angles)
        np.testing.assert_allclose(inertia_at(ours, angles), h, atol=2e-5 * np.abs(h).max())
        np.testing.assert_allclose(inertia_at(before, angles), inertia_at(ours, angles), rtol=1e-12)
    np.testing.assert_allclose(found.model.stiffness, paper().stiffness, rtol=1e-6)
    np.testing.assert_allclose(found.model.damping, paper().damping, rtol=1e-6)
    np.testing.assert_allclose(found.model.mass, paper().mass, rtol=1e-6)
    q, v = paper().home.copy(), np.zeros(paper().nv)
    v[3:] = np.random.default_rng(0).standard_normal(paper().nv - 3)
    np.testing.assert_allclose(
        found.model.acceleration(0.0, q, v, np.zeros(paper().nv)),
        paper().acceleration(0.0, q, v, np.zeros(paper().nv)),
        atol=1e-4 * np.abs(v).max(),
    )


def test_bias_of_the_controller_s_model_is_the_true_one_too(tmp_path):
    found = identified_model(wrong_description(tmp_path), true_estimate()).dynamics()
    rng = np.random.default_rng(3)
    omega, rates, spins = (
        0.1 * rng.standard_normal(3),
        0.2 * rng.standard_normal(3),
        30.0 * rng.standard_normal(3),
    )
    exact = ReducedDynamics(paper()).body_terms(omega, ARM[0], rates, spins).bias
    ours = found.body_terms(omega, ARM[0], rates, spins).bias
    np.testing.assert_allclose(ours, exact, atol=1e-4 * np.abs(exact).max())


def test_names_are_read_as_they_are_written():
    others = ("tank.mass", "(link1.m)*(link1.m)/m_s", "link1.m + c.m", "step A: link2.mx", "")
    read = "link1.m - 1.5 link2.mx + 2e-05 link3.Ixx"
    listed = [classify(n, 1.0, "1", 0.1, "exp2.step_b") for n in (read, *others)]
    rows, _, _, names = inertial_equations(paper(), Estimate("x", "paper", tuple(listed)))
    found = dict(zip(Regressor(paper()).names, rows[0], strict=True))
    assert {n: x for n, x in found.items() if x} == {"link1.m": 1.0, "link2.mx": -1.5, "link3.Ixx": 2e-5}
    assert names == (read,)


def test_combinations_leave_out_other_views_of_the_same():
    p = classify("step A: link3.mx", 50.0, "kg m", 0.1, "exp2.step_a")
    q = classify("link3.mx", 50.0, "kg m", 0.1, "exp2.step_b")
    r = classify("as printed: link3.mx", 40.0, "kg m", 0.1, "exp2.step_b_printed")
    followed = classify("link2.mx", 50.0, "kg m", 0.1, "tracked")  # an estimate of `track`
    rows, _, _, names = inertial_equations(paper(), Estimate("x", "paper", (p, q, r, followed)))
    assert names == ("link3.mx", "link2.mx") and np.count_nonzero(rows) == 2


def test_an_export_has_the_bodies_of_the_controller(tmp_path):
    """They were found in two ways, and differed where the data leave bodies open."""
    description = wrong_description(tmp_path)
    found = identified_model(description, true_estimate()).model
    whole = build_model(with_estimate(description, true_estimate())[0])
    bodies = identified_bodies(whole, true_estimate()).parameters
    for name in ("link1", "link2", "link3"):
        (joint,) = (j for j in bodies if body_names(found.pin)[found.pin.getJointId(j) - 1] == name)
        own = found.pin.inertias[found.pin.getJointId(joint)].toDynamicParameters()
        np.testing.assert_allclose(own, bodies[joint], rtol=1e-9, atol=1e-12)


def test_the_level_follows_the_intervals():
    """Twice the standard deviations, twice the level; and it covers the deviation they stand for."""
    rng = np.random.default_rng
    levels = [
        identified_level(identified_model(paper().description, true_estimate(s)), rng(0), draws=50)
        for s in (1e-3, 2e-3)
    ]
    assert levels[1] == pytest.approx(2.0 * levels[0], rel=0.02)
    assert 3e-4 < levels[0] < 2e-2


def test_what_is_not_identifiable_stays_as_described():
    estimate = true_estimate()
    unseen = [
        classify(p.name, 7.0 * p.value, p.unit, 10.0 * p.value, p.group) if p.name == "tank.damping.x" else p
        for p in estimate.parameters
    ]
    found = identified_model(paper().description, Estimate("paper_sms", "paper", tuple(unseen)))
    assert found.left == ("tank.damping.x",)
    np.testing.assert_allclose(found.model.damping, paper().damping, rtol=1e-6)


def test_bad_estimates_are_refused():
    described = paper().description
    with pytest.raises(ControlError, match="The estimate is of 'other'"):
        identified_model(described, Estimate("other", "paper", ()))
    with pytest.raises(ControlError, match=r"no inertial parameters of Exp\. 2"):
        identified_model(
            described, Estimate("paper_sms", "paper", (classify("total.mass", 1.0, "kg", 0.1, "exp1"),))
        )
    without = [
        classify(p.name, p.value, p.unit, np.nan, p.group) if p.name == "link3.mx" else p
        for p in true_estimate().parameters
    ]
    found = identified_model(described, Estimate("paper_sms", "paper", tuple(without)))
    with pytest.raises(ControlError, match=r"1 parameters have no interval, the first is 'link3.mx'"):
        identified_level(found, np.random.default_rng(0))
