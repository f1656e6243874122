"""An estimate's panel in the model that is diagnosed: a beam still, with the identified modes."""

import numpy as np
import pytest

from smsid.diagnose.hypotheses import propose
from smsid.diagnose.priors import nominal
from smsid.effects import BeamAppendage, GeometricStiffness
from smsid.estimation.bodies import with_estimate
from smsid.identify.estimate import Estimate, ParameterEstimate
from smsid.model import build_model

FOUND = {
    "panel.linear_density": (16.3, 0.03, "kg/m"),
    "panel.mode1.frequency": (0.0459, 1e-5, "Hz"),
    "panel.mode1.damping": (0.0054, 2e-4, "1"),
    "panel.mode2.frequency": (0.2858, 5e-6, "Hz"),
    "panel.mode2.damping": (0.0049, 1e-5, "1"),
    "panel.mode3.frequency": (0.796, 5e-5, "Hz"),
    "panel.mode3.damping": (0.0048, 7e-5, "1"),
}


@pytest.fixture(scope="module")
def estimate(description):
    parameters = [
        ParameterEstimate(name, value, unit, sigma, "identifiable", "maximum_likelihood")
        for name, (value, sigma, unit) in FOUND.items()
    ]
    return Estimate(description.name, "maximum_likelihood", tuple(parameters), ("exp1",))


def test_its_modes_are_those_identified(description, estimate):
    found = nominal(description, estimate)
    panel = found.point.description.get_effect("panel")
    assert isinstance(panel, BeamAppendage)
    model, modal = found.point.model(), build_model(with_estimate(description, estimate)[0])
    np.testing.assert_allclose(model.stiffness, modal.stiffness, rtol=1e-9)
    np.testing.assert_allclose(model.damping, modal.damping, rtol=1e-9)
    masses = [m.pin.inertias[1].mass for m in (model, modal)]
    assert masses[0] == pytest.approx(masses[1], rel=1e-12)


def test_its_uncertainty_is_the_estimates(description, estimate):
    found = {u.name: u for u in nominal(description, estimate).unknowns}
    relative = {name: found[f"panel.{name}"] for name in ("density", "damping", "youngs_modulus")}
    relative = {name: u.sigma / u.nominal for name, u in relative.items()}
    assert relative["density"] == pytest.approx(0.03 / 16.3)
    assert relative["damping"] == pytest.approx(2e-4 / 0.0054)
    # Young's modulus goes as density times frequency squared
    assert relative["youngs_modulus"] == pytest.approx(np.hypot(0.03 / 16.3, 2e-5 / 0.0459))


def test_its_modes_are_as_uncertain_as_the_estimate_has_them(description, estimate):
    """What the first mode, the beam's, is off by is in the errors of the others, too."""
    found = {u.name: u for u in nominal(description, estimate).unknowns}
    second = found["mode_error_panel_2.frequency"]
    relative = np.hypot(1e-5 / 0.0459, 5e-6 / 0.2858)
    assert second.sigma == pytest.approx((1.0 + second.nominal) * relative)
    assert found["mode_error_panel_3.damping"].sigma == pytest.approx(np.hypot(2e-4, 7e-5))


def test_a_mode_may_be_more_off_than_the_estimate_says(description, estimate, problem):
    found = nominal(description, estimate)
    shifts = [c for c in propose(found.point, problem, found.unknowns) if c.kind == "mode_error"]
    assert ("mode_error_panel_2.frequency",) in [c.free for c in shifts if c.effect is None]
    assert len(shifts) == len({c.key for c in shifts}) == 6


def test_an_estimate_for_a_beam_that_softens(description, estimate):
    """It still does, and its modes are known as well as those of one that does not."""
    soft = description.with_effects(GeometricStiffness(name="soft", appendage="panel"))
    found = nominal(soft, estimate)
    assert {u.name: u.sigma for u in found.unknowns} == {
        u.name: u.sigma for u in nominal(description, estimate).unknowns
    }
    assert found.point.description.get_effect("soft").factor == 1.0


def test_it_may_still_soften(description, estimate, problem):
    found = nominal(description, estimate)
    kinds = {c.kind for c in propose(found.point, problem, found.unknowns)}
    assert {"geometric_stiffness", "mode_error"} <= kinds


def test_a_combination_makes_only_what_is_in_it_uncertain(description):
    moment = "bus.mx - link1.m - link2.m - link3.m"
    known = ParameterEstimate(moment, -110.0, "kg m", 0.01, "identifiable", "maximum_likelihood")
    estimate = Estimate(description.name, "maximum_likelihood", (known,), ("exp2",))
    before = {u.name: u.sigma for u in nominal(description, None).unknowns}
    after = {u.name: u.sigma for u in nominal(description, estimate).unknowns}
    wider = {name for name in before if after[name] > 1.5 * before[name]}
    assert wider == {"bus.mx", "link1.m", "link2.m", "link3.m"}
