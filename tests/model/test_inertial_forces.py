"""Inertia that no body has: derivatives against differences, and against a model with a body for it."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import load_description
from smsid.effects import GearCompliance, GeometricStiffness, MassLoss, WheelImbalance
from smsid.model import SpacecraftModel, build_model

LATER = 20.0


def state(model: SpacecraftModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    q = pin.integrate(model.pin, model.home, 0.3 * rng.normal(size=model.nv))
    return q, *rng.normal(size=(2, model.nv))


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (0.3, -0.2, -1.6)])
@pytest.mark.parametrize("frame", ["bus", "link2"])
@pytest.mark.parametrize("kind", ["leak", "panel", "gear"])
def test_derivatives_are_those_of_the_force(urdf: Path, kind: str, frame: str, gravity: tuple) -> None:
    """Whatever a term says of itself, differences over every coordinate say too."""
    effect = {
        "leak": MassLoss(name="e", frame=frame, position=(0.5, -0.6, 0.4), rate=0.1),
        "panel": GeometricStiffness(name="e", appendage="panel"),
        "gear": GearCompliance(name="e", joint="joint2", compliance=1e-3, motor_inertia=0.2),
    }[kind]
    described = load_description(urdf / "paper_sms.toml").model_copy(update={"gravity": gravity})
    model = build_model(described.with_effects(effect))
    assert model.inertial is not None
    q, v, a = state(model)
    by_q, by_v = model.inertial.derivatives(LATER, q, v, a)
    rest = model.inertial.force(LATER, q, v, a)
    size = 1e-3 + np.abs(rest).max()
    for j, step in enumerate(1e-6 * np.eye(model.nv)):
        moved = [model.inertial.force(LATER, pin.integrate(model.pin, q, s * step), v, a) for s in (1, -1)]
        np.testing.assert_allclose(by_q[:, j], (moved[0] - moved[1]) / 2e-6, atol=2e-6 * size)
        faster = [model.inertial.force(LATER, q, v + s * step, a) for s in (1, -1)]
        np.testing.assert_allclose(by_v[:, j], (faster[0] - faster[1]) / 2e-6, atol=2e-6 * size)


def test_an_imbalance_leaves_the_mass_alone(urdf: Path) -> None:
    """What the wheel gets the bus gives: total mass and mass matrix at rest about the axis stay."""
    plain = load_description(urdf / "paper_sms.toml")
    model = build_model(plain)
    wheel = model.wheels.names[0]
    turned = build_model(plain.with_effects(WheelImbalance(name="w", wheel=wheel, static=0.03, phase=0.4)))
    assert pin.computeTotalMass(turned.pin) == pytest.approx(pin.computeTotalMass(model.pin), rel=1e-14)
    first, second = (pin.crba(m.pin, m.pin.createData(), m.home) for m in (model, turned))
    i = int(model.wheels.v[0])
    assert second[i, i] == pytest.approx(first[i, i], rel=1e-9)
    np.testing.assert_allclose(np.diag(second)[:3], np.diag(first)[:3], rtol=1e-12)
    # the pull of a first moment h at rate W, square to the axis
    v = np.zeros(model.nv)
    v[i] = 200.0
    pull = (
        pin.nonLinearEffects(turned.pin, turned.pin.createData(), turned.home, v)
        - pin.nonLinearEffects(model.pin, model.pin.createData(), model.home, v)
    )[:3]
    assert np.linalg.norm(pull) == pytest.approx(0.03 * 200.0**2, rel=1e-9)
