"""Regressors against Pinocchio's own momenta, mass matrix and inverse dynamics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import load_description
from smsid.effects import ModalAppendage, Mode
from smsid.model import build_model
from smsid.model.regressor import INERTIAL_NAMES, Regressor

URDF = Path(__file__).resolve().parents[2] / "urdf"


def helical():
    twist = Mode(frequency=0.3, damping=0.0, translation=(0.0, 0.0, 4.0), rotation=(0.3, -13.0, 5.0))
    sail = ModalAppendage(
        name="panel",
        position=(1.5, 0.1, 0.0),
        rpy=(0.1, 0.2, 0.3),
        mass=90.0,
        center_of_mass=(3.0, 0.2, 0.0),
        inertia=(80.0, -54.0, 1100.0, 0.0, 0.0, 1180.0),
        mode=(twist,),
    )
    description = load_description(URDF / "paper_sms.toml")
    return description.with_effects(sail).model_copy(update={"gravity": (0.0, 1.0, -9.81)})


MODELS = {
    "paper": load_description(URDF / "paper_sms.toml"),
    "two_arm": load_description(URDF / "two_arm_sms.toml"),
    "helical, gravity": helical(),
}


@pytest.fixture(params=MODELS)
def case(request):
    model = build_model(MODELS[request.param])
    rng = np.random.default_rng(2)
    q = np.array([pin.integrate(model.pin, model.home, x) for x in rng.standard_normal((4, model.nv))])
    v, a = rng.standard_normal((2, 4, model.nv))
    return model, Regressor(model), q, v, a


def test_momentum_is_that_of_pinocchio_in_bus_axes(case):
    model, regressor, q, v, _ = case
    found = regressor.momentum(q, v) @ regressor.parameters
    for i in range(len(q)):
        centroidal = pin.computeCentroidalMomentum(model.pin, model.data, q[i], v[i])
        bus = pin.XYZQUATToSE3(q[i][:7])
        arm = model.data.com[0] - bus.translation
        angular = centroidal.angular + np.cross(arm, centroidal.linear)
        expected = np.concatenate([bus.rotation.T @ centroidal.linear, bus.rotation.T @ angular])
        np.testing.assert_allclose(found[i], expected, rtol=1e-11, atol=1e-9)


def test_momentum_and_generalised_momentum_are_mass_matrix_times_rates(case):
    model, regressor, q, v, _ = case
    theta = regressor.parameters
    generalised = regressor.generalised_momentum(q, v)
    for i in range(len(q)):
        upper = np.triu(pin.crba(model.pin, model.data, q[i]))
        expected = (upper + np.triu(upper, 1).T) @ v[i]
        np.testing.assert_allclose(generalised[i] @ theta, expected, rtol=1e-11, atol=1e-9)
        np.testing.assert_allclose(generalised[i][:6], regressor.momentum(q[i], v[i])[0], atol=1e-12)


def test_torque_is_inverse_dynamics(case):
    model, regressor, q, v, a = case
    found = regressor.torque(q, v, a) @ regressor.parameters
    for i in range(len(q)):
        expected = pin.rnea(model.pin, model.data, q[i], v[i], a[i])
        np.testing.assert_allclose(found[i], expected, rtol=1e-10, atol=1e-7)


def test_rows_do_not_share_memory(case):
    _, regressor, q, v, a = case
    first = regressor.torque(q, v, a)
    before = first.copy()
    regressor.torque(q[::-1], v, a)
    regressor.momentum(q, a)
    np.testing.assert_array_equal(first, before)


def test_columns_are_named_and_have_units(case):
    model, regressor, *_ = case
    assert len(regressor.names) == len(regressor.units) == regressor.columns == 10 * (model.pin.njoints - 1)
    assert len(set(regressor.names)) == regressor.columns
    assert regressor.bodies[0] == "bus"
    mass = [p for n, p in zip(regressor.names, regressor.parameters, strict=True) if n.endswith(".m")]
    assert sum(mass) == pytest.approx(model.mass)


def test_bodies_of_the_paper():
    regressor = Regressor(build_model(MODELS["paper"]))
    expected = ("bus", "link1", "link2", "link3", "wheel_x", "wheel_y", "wheel_z", "tank")
    assert regressor.bodies[:8] == expected
    assert regressor.names[:10] == tuple(f"bus.{p}" for p in INERTIAL_NAMES)
