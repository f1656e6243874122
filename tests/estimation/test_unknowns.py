"""Unknowns: priors of bodies as the URDF has them, panels that are heavier as a whole, polar pairs."""

import numpy as np
import pinocchio as pin
import pytest

from smsid.effects import BeamAppendage, Payload, WheelImbalance
from smsid.errors import DescriptionError
from smsid.estimation._retraction import retract
from smsid.estimation.panels import modal_panels, plain_panels
from smsid.estimation.parameter_vector import Point
from smsid.estimation.unknowns import unknowns_of
from smsid.model import build_model
from smsid.model.regressor import INERTIAL_NAMES
from tests.estimation.satellite import Satellite, guess

PANEL = BeamAppendage(
    name="wing",
    position=(1.0, 0.0, 0.0),
    length=4.0,
    width=1.0,
    thickness=0.002,
    density=2700.0,
    youngs_modulus=7e10,
    damping=0.005,
    modes=2,
    stations=(4.0,),
    prior={"density": 27.0},
)


@pytest.fixture
def craft(tmp_path):
    """A satellite without tank, a beam and a payload on it; the URDF's bus is 300 kg."""
    found = guess(tmp_path, Satellite(), off=0.0, tank=False, panel=False)
    more = Payload(name="box", frame="bus", mass=10.0, com=(0.0, 0.3, 0.0))
    return found.model_copy(update={"effect": (PANEL, more)})


def test_what_is_stated_of_a_body_is_of_the_body_alone(craft):
    """Mass and moments as the URDF has them, stated, are the values the model begins with."""
    modal, _ = modal_panels(craft)
    point = Point.of(modal)
    bare = build_model(craft.model_copy(update={"effect": (), "wheel": ()})).pin.inertias[1]
    stated = {
        f"bus.{n}": (float(x), 0.1) for n, x in zip(INERTIAL_NAMES, bare.toDynamicParameters(), strict=True)
    }
    unknowns = {u.name: u for u in unknowns_of(point, cad=stated).unknowns}
    for name in stated:
        assert unknowns[name].nominal == pytest.approx(point.value(unknowns[name]), abs=1e-9)
    heavier = {u.name: u for u in unknowns_of(point, cad={"bus.m": (stated["bus.m"][0] + 5.0, 0.1)}).unknowns}
    assert heavier["bus.m"].nominal - point.value(heavier["bus.m"]) == pytest.approx(5.0)


def test_a_denser_beam_is_a_heavier_panel(craft):
    """The whole inertia is that of the beam with another density; without a factor, too."""
    modal, densities = modal_panels(craft)
    panel = modal.get_effect("wing").with_values({"wing.participation_factor": 1.1})
    changed = modal.with_effects(panel)
    beam = craft.with_effects(PANEL.with_values({"wing.density": 1.1 * 2700.0}))
    wanted = build_model(beam)
    q = pin.neutral(wanted.pin)
    expected = pin.crba(wanted.pin, wanted.pin.createData(), q)[:6, :6]
    for description in (changed, plain_panels(changed)):
        model = build_model(description)
        found = pin.crba(model.pin, model.pin.createData(), q)[:6, :6]
        np.testing.assert_allclose(found, expected, atol=1e-9 * abs(expected).max())
    assert densities["wing.participation_factor"][0] == "wing.linear_density"
    assert plain_panels(changed).get_effect("wing").participation_factor == 1.0


@pytest.mark.parametrize("phase", [0.0, 2.5])
@pytest.mark.parametrize("static", [0.0, 2e-3])
def test_an_amplitude_and_its_angle_move_as_components(craft, static, phase):
    """From no amplitude in any direction, and back; bodies stay where they are."""
    wheel = WheelImbalance(name="rough", wheel="rw1", static=static, phase=phase, prior={"static": 5e-3})
    point = Point.of(craft.model_copy(update={"effect": (wheel,)}))
    unknowns = unknowns_of(point, components=True).unknowns
    index = [i for i, u in enumerate(unknowns) if u.polar is not None]
    assert [unknowns[i].name for i in index] == ["rough.static", "rough.phase"]
    step = np.zeros(len(unknowns))
    step[index] = -3e-3, 4e-3
    moved = retract(point, unknowns, step)
    effect = moved.description.get_effect("rough")
    reference = np.array([np.cos(phase), np.sin(phase)])
    across = np.array([-reference[1], reference[0]])
    expected = (static - 3e-3) * reference + 4e-3 * across
    found = effect.static * np.array([np.cos(effect.phase), np.sin(effect.phase)])
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose([moved.value(unknowns[i]) for i in index], [static - 3e-3, 4e-3], atol=1e-12)
    np.testing.assert_allclose(list(moved.inertial.values()), 0.0, atol=1e-6)
    assert moved.moved(unknowns, -step).description.get_effect("rough").static == pytest.approx(static)


def test_a_craft_that_cannot_be_is_not_physical(tmp_path):
    """A panel takes more inertia than its body has: a fit that met that was the end of a diagnosis."""
    description = guess(tmp_path, Satellite(), off=0.0)
    point = Point.of(description)
    assert point.physical()
    (panel,) = (e for e in description.effect if e.kind == "modal_appendage")
    (mode,) = panel.mode
    heavy = mode.model_copy(update={"rotation": tuple(100.0 * x for x in mode.rotation)})
    beyond = point.with_effect(panel.model_copy(update={"mode": (heavy,)}))
    with pytest.raises(DescriptionError):
        beyond.model()
    assert not beyond.physical()
