"""A mode that a beam's description leaves out, against the beam that has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import Description, load_description
from smsid.effects import BeamMode, Effect, ModalAppendage
from smsid.errors import DescriptionError
from smsid.experiments import thrust_experiment
from smsid.model import build_model
from smsid.simulate import simulate, truth_of


@pytest.fixture()
def description(urdf: Path) -> Description:
    return load_description(urdf / "paper_sms.toml")


def with_modes(description: Description, number: int, *effects: Effect) -> Description:
    beam = description.get_effect("panel").model_copy(update={"modes": number})
    return description.with_effects(beam, *effects)


def test_it_is_the_beam_with_one_mode_more(description: Description) -> None:
    apart = build_model(with_modes(description, 3, BeamMode(name="x", appendage="panel", mode=4)))
    whole = build_model(with_modes(description, 4))
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = pin.integrate(whole.pin, whole.home, 0.2 * rng.normal(size=whole.nv))
        v, tau = rng.normal(size=(2, whole.nv))
        expected = whole.acceleration(0.0, q, v, tau)
        np.testing.assert_allclose(apart.acceleration(0.0, q, v, tau), expected, rtol=1e-9, atol=1e-9)


def test_its_stations_see_it(description: Description) -> None:
    """What the accelerometers read: the same as of the beam that has it, and not that of one without."""
    read = {}
    time = np.linspace(0.1, 8.0, 80)
    for name, own in {
        "apart": with_modes(description, 3, BeamMode(name="x", appendage="panel", mode=4)),
        "whole": with_modes(description, 4),
        "without": with_modes(description, 3),
    }.items():
        model = build_model(own)
        flight = simulate(model, thrust_experiment("z").inputs(), 8.0)
        read[name] = truth_of(flight, description.sensor)(time)["panel.acceleration"]
    size = np.abs(read["whole"]).max()
    assert np.abs(read["whole"] - read["without"]).max() > 0.05 * size
    np.testing.assert_allclose(read["apart"], read["whole"], atol=1e-6 * size)


def test_its_errors(description: Description) -> None:
    """A small one rings at its own frequency: the mode's clamped one, ``1 + frequency`` times."""
    more = BeamMode(name="x", appendage="panel", mode=4, factor=1e-9, frequency=0.1, damping=0.02)
    model = build_model(description.with_effects(more))
    joint = model.pin.joints[model.pin.getJointId("x")]
    q = model.home.copy()
    mode = with_modes(description, 4).get_effect("panel").modal_data()[-1]  # type: ignore[attr-defined]
    omega = 2 * np.pi * 1.1 * mode.frequency
    bent, moving = q.copy(), np.zeros(model.nv)
    bent[joint.idx_q] = 1.0
    moving[joint.idx_v] = 1.0
    rest = np.zeros(model.nv)
    spring = model.acceleration(0.0, bent, rest, rest)[joint.idx_v]
    damper = model.acceleration(0.0, q, moving, rest)[joint.idx_v]
    assert spring == pytest.approx(-(omega**2), rel=1e-6)
    assert damper == pytest.approx(-2 * 0.02 * omega, rel=1e-6)


def test_what_cannot_be(description: Description) -> None:
    once = BeamMode(name="x", appendage="panel", mode=4)
    with pytest.raises(DescriptionError, match="'panel' has mode 4 already"):
        build_model(description.with_effects(once, once.model_copy(update={"name": "y"})))


def test_only_a_beam_that_has_not_got_it(urdf: Path, description: Description) -> None:
    with pytest.raises(DescriptionError, match="'panel' has mode 3 already"):
        build_model(description.with_effects(BeamMode(name="x", appendage="panel", mode=3)))
    sail = ModalAppendage(
        name="sail", position=(1, 0, 0), mass=5.0, center_of_mass=(1, 0, 0), inertia=(0.1, 0, 7, 0, 0, 7)
    )
    effect = BeamMode(name="x", appendage="sail", mode=3)
    with pytest.raises(DescriptionError, match="'sail' is no beam_appendage"):
        build_model(Description(name="x", urdf="bus.urdf", folder=urdf, effect=(sail, effect)))
