"""Gravity gradient: the closed form of the torque on the whole, and work that is a potential's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from pydantic import ValidationError

from smsid.description import Description, load_description
from smsid.effects import ExternalWrench, GravityGradient
from smsid.errors import DescriptionError
from smsid.model import SpacecraftModel, build_model

GRADIENT = 2.5e-5  # [1/s^2]


@pytest.fixture(scope="module")
def models(urdf: Path) -> tuple[SpacecraftModel, SpacecraftModel]:
    description = load_description(urdf / "paper_sms.toml")
    effect = GravityGradient(name="g", gradient=GRADIENT, nadir=(0, 0.6, -0.8), normal=(2.0, 0, 0))
    return build_model(description), build_model(description.with_effects(effect))


def vertical(t: float) -> np.ndarray:
    angle = np.sqrt(GRADIENT) * t
    down, normal = np.array([0.0, 0.6, -0.8]), np.array([1.0, 0, 0])
    return np.cos(angle) * down + np.sin(angle) * np.cross(normal, down)


def tide(models: tuple[SpacecraftModel, SpacecraftModel], t: float, q: np.ndarray) -> np.ndarray:
    plain, model = models
    v = np.zeros(plain.nv)
    return model.passive_forces(t, q, v) - plain.passive_forces(t, q, v)


def state(model: SpacecraftModel, rng: np.random.Generator) -> np.ndarray:
    return pin.integrate(model.pin, pin.randomConfiguration(model.pin, -np.ones(model.nq), np.ones(model.nq)),
                         0.3 * rng.normal(size=model.nv))  # fmt: skip


@pytest.mark.parametrize("t", [0.0, 100.0])
def test_the_torque_is_three_n_squared_r_cross_i_r_and_there_is_no_force(models, t: float) -> None:
    plain, rng = models[0], np.random.default_rng(1)
    for _ in range(5):
        q = state(plain, rng)
        tau = tide(models, t, q)
        data = plain.pin.createData()
        pin.ccrba(plain.pin, data, q, np.zeros(plain.nv))
        r = vertical(t)
        expected = 3.0 * GRADIENT * np.cross(r, data.Ig.inertia @ r)  # of the whole, held stiff, about its CM
        turn = pin.Quaternion(q[3:7]).toRotationMatrix()
        arm = data.com[0] - q[:3]
        force = turn @ tau[:3]
        np.testing.assert_allclose(force, 0.0, atol=1e-12)
        np.testing.assert_allclose(turn @ tau[3:6] - np.cross(arm, force), expected, atol=1e-12)


def test_it_is_the_gradient_of_a_potential(models) -> None:
    """``-1/2 gradient sum m (3 (d . r)^2 - d^2)`` over points that have every body's second moments."""
    plain, rng, t = models[0], np.random.default_rng(2), 40.0

    def potential(q: np.ndarray) -> float:
        data = plain.pin.createData()
        com = pin.centerOfMass(plain.pin, data, q)
        total = 0.0
        for place, body in zip(data.oMi, plain.pin.inertias, strict=True):
            second = 0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia
            d = place.act(body.lever) - com
            spread = place.rotation @ second @ place.rotation.T + body.mass * np.outer(d, d)
            total -= 0.5 * GRADIENT * (3.0 * vertical(t) @ spread @ vertical(t) - np.trace(spread))
        return total

    q, h = state(plain, rng), 1e-4
    slope = np.array(
        [
            (potential(pin.integrate(plain.pin, q, h * e)) - potential(pin.integrate(plain.pin, q, -h * e)))
            / (2 * h)
            for e in np.eye(plain.nv)
        ]
    )
    tau = tide(models, t, q)
    np.testing.assert_allclose(tau, -slope, atol=1e-7 * np.abs(tau).max())
    assert np.abs(tau[6:]).max() > 1e-6  # joints, slosh and modes feel it too


def test_the_orbital_rate_may_be_given(urdf: Path) -> None:
    effect = GravityGradient.model_validate({"name": "g", "rate": 1.1e-3})
    assert effect.gradient == pytest.approx(1.21e-6) and effect.rate == pytest.approx(1.1e-3)
    with pytest.raises(ValidationError, match="perpendicular"):
        GravityGradient(name="g", gradient=1e-6, nadir=(1, 0, 0), normal=(1, 1, 0))


@pytest.mark.parametrize("effect", [GravityGradient(name="g", gradient=1e-6), ExternalWrench(name="g")])
def test_a_welded_bus_feels_nothing(urdf: Path, effect) -> None:
    fixed = Description(name="x", urdf="paper_sms.urdf", folder=urdf, root="fixed", effect=(effect,))
    with pytest.raises(DescriptionError, match="welded bus"):
        build_model(fixed)
