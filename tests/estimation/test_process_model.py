"""Derivatives of accelerations against differences, with inertia that no body has."""

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import load_description
from smsid.effects import GravityGradient, JointFriction, MassLoss, WheelImbalance, catalogue
from smsid.estimation.process_model import ProcessModel
from smsid.model import build_model
from tests.effects.test_catalogue import example

STEP = 1e-6


@pytest.fixture(scope="module")
def state(known):
    """A plant that loses mass, has a wheel out of balance and a joint that rubs; any state and torques."""
    point = known.point
    for effect in (
        MassLoss(name="leak", rate=3.0, position=(0.4, -0.3, 0.2)),
        WheelImbalance(name="wobble", wheel="wheel_x", static=0.3, phase=0.4),
        JointFriction(name="rub", joint="joint2", viscous=0.5),
    ):
        point = point.with_effect(effect)
    model, rng = point.model(), np.random.default_rng(0)
    q = pin.integrate(model.pin, model.home, 0.3 * rng.standard_normal(model.nv))
    return (
        ProcessModel(model, np.zeros(0, dtype=int)),
        q,
        rng.standard_normal(model.nv),
        rng.standard_normal(model.nv),
    )


@pytest.mark.parametrize("by", ["by_q", "by_v", "by_tau"])
def test_derivatives_are_those_of_differences(state, by):
    plant, q, v, tau = state
    time = 40.0

    def acceleration(step):
        if by == "by_q":
            return plant.acceleration(time, pin.integrate(plant.pin, q, step), v, tau)
        return plant.acceleration(time, q, v + step * (by == "by_v"), tau + step * (by == "by_tau"))

    found = getattr(plant.linear(time, q, v, tau), by)
    steps = STEP * np.eye(plant.nv)
    expected = np.stack([(acceleration(s) - acceleration(-s)) / (2 * STEP) for s in steps], axis=1)
    np.testing.assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max())


@pytest.mark.parametrize("kind", sorted(catalogue()))
def test_every_effect_is_linearised_whole(kind, urdf):
    """Terms say what they depend on, so that differences leave the rest out: do they forget anything?"""
    effect = example(kind)
    if "quasistatic" in type(effect).model_fields:
        effect = effect.model_copy(update={"quasistatic": False})
    described = load_description(urdf / "paper_sms.toml").with_effects(effect)
    model, rng = build_model(described), np.random.default_rng(5)
    plant = ProcessModel(model, np.zeros(0, dtype=int))
    q = pin.integrate(model.pin, model.home, 0.3 * rng.standard_normal(model.nv))
    v, tau = rng.standard_normal((2, model.nv))
    found = plant.linear(40.0, q, v, tau)
    steps = STEP * np.eye(plant.nv)
    by_q = [plant.acceleration(40.0, pin.integrate(plant.pin, q, s), v, tau) for s in (*steps, *-steps)]
    by_v = [plant.acceleration(40.0, q, v + s, tau) for s in (*steps, *-steps)]
    for own, ends in ((found.by_q, by_q), (found.by_v, by_v)):
        expected = (np.array(ends[: plant.nv]) - np.array(ends[plant.nv :])).T / (2 * STEP)
        np.testing.assert_allclose(own, expected, atol=3e-6 * np.abs(expected).max())


def test_a_slow_force_is_held_over_a_step_and_nothing_shows(known):
    tide = GravityGradient(name="tide", gradient=1.2e-6, nadir=(1.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
    model, rng = known.point.with_effect(tide).model(), np.random.default_rng(1)
    q = pin.integrate(model.pin, model.home, 0.3 * rng.standard_normal(model.nv))
    v, tau = 0.1 * rng.standard_normal((2, model.nv))
    held, exact, free = (ProcessModel(m, np.zeros(0, dtype=int)) for m in (model, model, known.point.model()))
    exact.model, exact._slow = model, []
    ends = [p.step(0.0, 0.025, q, v, tau)[1] for p in (held, exact, free)]
    by_hold, by_tide = ends[0] - ends[2], ends[1] - ends[2]
    assert np.abs(by_tide).max() > 1e-10
    np.testing.assert_allclose(by_hold, by_tide, rtol=0.0, atol=0.02 * np.abs(by_tide).max())
