"""Panels whose modes other effects correct, that soften or have modes more: to the linear method and back."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.effects import BeamMode, GeometricStiffness, ModeError
from smsid.effects.appendage import BeamAppendage, ModalAppendage
from smsid.errors import DescriptionError
from smsid.export import with_estimate
from smsid.identify import identify
from smsid.identify.appendages import as_described, linear_appendages
from smsid.identify.estimate import Estimate, classify
from smsid.identify.modes import identified_modes
from smsid.identify.momentum_rows import carried_by_bus, carried_matrix
from smsid.likelihood.parameters import Parameters
from smsid.model import build_model
from smsid.model.regressor import Regressor

from .support import noisy, oracle, paper, reference

ERRORS = (
    ModeError(name="slow", appendage="panel", mode=1, frequency=-0.05, damping=1e-3),
    ModeError(name="fast", appendage="panel", mode=3, frequency=0.02),
)
SOFT = GeometricStiffness(name="soft", appendage="panel")
MORE = BeamMode(name="more", appendage="panel", mode=4, factor=0.9)


def accelerations(description):
    """At a random state, forces on everything: what inertias, springs and dampers are together."""
    model, rng = build_model(description), np.random.default_rng(2)
    q, v, tau = model.home.copy(), rng.uniform(-0.1, 0.1, model.nv), rng.uniform(-5.0, 5.0, model.nv)
    q[model.modes.q] = rng.uniform(-0.1, 0.1, len(model.modes.q))
    return model.acceleration(0.0, q, v, tau)


def identified(description):
    """The panel as if identified: lighter, its modes elsewhere."""
    panel = description.get_effect("panel")
    modal = identified_modes(panel, 0.97, (), panel.described_modes(description.effect))
    return modal.with_values({"panel.mode1.frequency": 0.047, "panel.mode2.damping": 0.007})


def test_what_corrects_a_mode_goes_into_it():
    described = paper().with_effects(*ERRORS)
    linear, notes = linear_appendages(described)
    assert isinstance(linear.get_effect("panel"), ModalAppendage) and not notes
    assert [e.name for e in linear.effect] == ["tank", "panel"]
    np.testing.assert_allclose(accelerations(linear), accelerations(described), rtol=1e-10)


def test_a_panel_without_such_effects_stays_what_it_is():
    assert linear_appendages(paper()) == (paper(), [])


def test_what_only_a_beam_can_have_is_left_out_and_said_so():
    linear, notes = linear_appendages(paper().with_effects(SOFT, MORE))
    assert linear == paper()
    assert len(notes) == 2 and "'soft' (geometric_stiffness)" in notes[0] and "'more'" in notes[1]


def test_a_beam_bends_as_the_identified_appendage():
    described = paper()
    panel, modal = described.get_effect("panel"), identified(described)
    assert isinstance(panel, BeamAppendage)
    beam = described.with_effects(*panel.bent_as(modal))
    expected = accelerations(described.with_effects(modal))
    np.testing.assert_allclose(accelerations(beam), expected, rtol=1e-10)


def test_errors_of_one_mode_add_up():
    twice = [ModeError(name=n, appendage="panel", mode=1, frequency=0.05, damping=1e-3) for n in "ab"]
    described = paper().with_effects(*twice)
    linear, _ = linear_appendages(described)
    np.testing.assert_allclose(accelerations(linear), accelerations(described), rtol=1e-10)


def test_an_error_of_a_mode_there_is_not():
    beyond = ModeError(name="beyond", appendage="panel", mode=4)
    with pytest.raises(DescriptionError, match="has 3 modes"):
        paper().get_effect("panel").described_modes(paper().with_effects(beyond).effect)


def test_a_further_mode_stays_where_it_was():
    """Though the beam it is relative to is another; its damping, too, and how much of it there is."""
    found = build_model(as_described(paper().with_effects(MORE), [identified(paper())]))
    before = build_model(paper().with_effects(MORE))
    (v,) = before.further_modes.v
    place = [list(m.spring_v).index(v) for m in (found, before)]
    mass = [m.pin.inertias[int(m.further_modes.joints[0])].mass for m in (found, before)]
    assert mass[0] == pytest.approx(0.97 * mass[1], rel=1e-12)
    for a, b in ((found.stiffness, before.stiffness), (found.damping, before.damping)):
        assert a[place[0]] / mass[0] == pytest.approx(b[place[1]] / mass[1], rel=1e-12)


def test_the_bus_has_the_whole_panel_whatever_modes_it_has():
    """What the linear method, which leaves a further mode out, calls the bus."""
    plain, more = (build_model(d) for d in (paper(), paper().with_effects(MORE)))
    bus = []
    for model in (plain, more):
        regressor = Regressor(model)
        bus.append((regressor.parameters + carried_by_bus(model, regressor))[:10])
        at = Parameters.of(model)
        np.testing.assert_allclose(
            carried_matrix(at.layout.model, regressor) @ at.theta(), carried_by_bus(model, regressor)
        )
    np.testing.assert_allclose(bus[1], bus[0], rtol=1e-10)


@pytest.mark.parametrize("effects", [ERRORS, (*ERRORS, SOFT), (*ERRORS, SOFT, MORE)])
def test_identified_in_the_terms_of_the_description(effects):
    """No correction counts twice, and what needs a beam finds one."""
    described = paper().with_effects(*effects)
    found = as_described(described, [identified(described)])
    linear, _ = linear_appendages(found)
    expected = paper().with_effects(identified(described))
    np.testing.assert_allclose(accelerations(linear), accelerations(expected), rtol=1e-10)
    kinds = [type(e) for e in found.effect if isinstance(e, GeometricStiffness | BeamMode)]
    assert kinds == [type(e) for e in effects if isinstance(e, GeometricStiffness | BeamMode)]
    build_model(found)


def test_an_estimate_goes_into_a_panel_that_softens():
    described = paper().with_effects(*ERRORS, SOFT, MORE)
    values = (classify("panel.mode1.frequency", 0.047, "Hz", 1e-4, "exp1"),)
    found, _ = with_estimate(described, Estimate("paper_sms", "test", values))
    panel = found.get_effect("panel")
    assert isinstance(panel, BeamAppendage)
    modes = panel.described_modes(found.effect)
    before = described.get_effect("panel").described_modes(described.effect)
    assert modes[0].frequency == pytest.approx(0.047, rel=1e-12)
    assert [m.frequency for m in modes[1:]] == pytest.approx([m.frequency for m in before[1:]], rel=1e-12)
    assert [m.damping for m in modes] == pytest.approx([m.damping for m in before], rel=1e-12)


def test_parameters_begin_and_end_at_corrected_modes():
    described = paper().with_effects(*ERRORS, SOFT)
    at = Parameters.of(build_model(described))
    assert at.scalar("panel.mode1.frequency") == pytest.approx(0.95 * 0.0456957, rel=1e-5)
    linear, _ = linear_appendages(described)
    again, _ = linear_appendages(at.description())
    np.testing.assert_allclose(accelerations(again), accelerations(linear), rtol=1e-10)


@oracle
def test_a_panel_that_softens_is_identified():
    """By the paper's method, on recordings of the linear panel: the numbers are those without the effects."""
    recordings = [
        noisy(reference("exp1_xyz_modal3"), paper(), 1),
        noisy(reference("exp2_modal3"), paper(), 2),
    ]
    plain = identify(paper(), recordings)
    found = identify(paper().with_effects(SOFT, MORE), recordings)
    assert [p.value for p in found.estimate.parameters] == [p.value for p in plain.estimate.parameters]
    assert {"soft", "more"} <= {e.name for e in found.description.effect}
    assert isinstance(found.description.get_effect("panel"), BeamAppendage)
    assert sum("is left out" in n for n in found.estimate.notes) == 2
