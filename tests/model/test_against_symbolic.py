"""The model against momenta (7)-(9) and equations of motion (10)-(15) derived from T, V and dissipation.

The derivation (`tests/twins`) knows nothing of the project. Its beam integrates over the plate's material
points; its `frozen` panel has the inertia of (9) as printed.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from twins.cases import SKEWED, random_pairs, relative
from twins.description import Ordering, write_description
from twins.numbers import PAPER, Spacecraft
from twins.state import Inputs, State
from twins.symbolic import SymbolicTwin

from smsid.description import load_description
from smsid.model import SpacecraftModel, build_model

EXACT = 1e-10  # relative; measured: 5e-14 on accelerations, 6e-15 on the rest
URDF = Path(__file__).parents[2] / "urdf"

Case = tuple[SpacecraftModel, Spacecraft]


@pytest.fixture(scope="module", params=["paper_sms", "paper", "skewed"])
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    """The description in `urdf/`, and descriptions written from the twins' numbers."""
    numbers = SKEWED if request.param == "skewed" else PAPER
    if request.param == "paper_sms":
        path = URDF / "paper_sms.toml"
    else:
        path = write_description(numbers, tmp_path_factory.mktemp(request.param))
    return build_model(load_description(path)), numbers


def mass_matrix(model: SpacecraftModel, state: State) -> np.ndarray:
    """(18, 18) mass matrix in the twins' ordering."""
    order = Ordering(model)
    upper = np.triu(pin.crba(model.pin, model.data, order.q(state)))
    return order.turn.T @ (upper + np.triu(upper, 1).T) @ order.turn


def accelerations(model: SpacecraftModel, state: State, inputs: Inputs) -> np.ndarray:
    """(18,) accelerations in the twins' ordering."""
    order = Ordering(model)
    return order.back(model.acceleration(0.0, order.q(state), order.v(state), order.tau(inputs)))


def test_mass_and_degrees_of_freedom(case: Case):
    model, numbers = case
    assert (model.nq, model.nv) == (19, 18)
    np.testing.assert_allclose(model.mass, numbers.total_mass, rtol=1e-14)


def test_momentum(case: Case):
    """Equations (7), (8), (9): about the inertial origin, in inertial axes, deflections of any size."""
    model, numbers = case
    twin, order = SymbolicTwin(numbers), Ordering(model)
    for state, _ in random_pairs(50):
        found = model.momentum(order.q(state), order.v(state))
        p, h = (state.attitude @ x for x in twin.momentum(state, "inertial"))
        assert relative(found[:3], p) < EXACT
        assert relative(found[3:], h) < EXACT


def test_equations_of_motion(case: Case):
    """Equations (10)-(15): mass matrix, energy, and what is left of each with the model's accelerations."""
    model, numbers = case
    twin, order = SymbolicTwin(numbers), Ordering(model)
    for state, inputs in random_pairs(50):
        terms = twin.terms(state)
        assert relative(mass_matrix(model, state), terms.mass) < EXACT
        assert relative(model.energy(order.q(state), order.v(state)), terms.energy) < EXACT
        vdot = accelerations(model, state, inputs)
        assert relative(vdot, twin.accelerations(state, inputs)) < EXACT
        residual = terms.mass @ vdot + terms.bias - inputs.generalized
        size = np.abs(terms.mass * vdot).sum(axis=1) + np.abs(terms.bias)  # per equation
        assert (np.abs(residual) < EXACT * size).all()


def test_inertia_follows_the_deflection(case: Case):
    """Deflections scaled by eps: the inertia is the beam's, and differs by eps from (9) as printed.

    The panel truncated to first order in delta differs by eps^2: the model has the second order too.
    """
    model, numbers = case
    beam, first, frozen = (SymbolicTwin(numbers, v) for v in ("exact", "first_order", "frozen"))
    for state, _ in random_pairs(5):
        sizes = []
        for eps in (1e-1, 1e-2, 1e-3):
            small = replace(state, delta=eps * state.delta)
            found = mass_matrix(model, small)
            sizes.append([np.abs(found - twin.mass_matrix(small)).max() for twin in (beam, first, frozen)])
        exact, second_order, first_order = np.array(sizes).T
        assert exact.max() < EXACT * np.abs(found).max()
        np.testing.assert_allclose(-np.diff(np.log10(second_order)), 2.0, atol=0.1)
        np.testing.assert_allclose(-np.diff(np.log10(first_order)), 1.0, atol=0.1)


def test_frozen_inertia_loses_the_centrifugal_force_on_the_modes(case: Case):
    """With (9) as printed a mode does not feel L_r omega_x omega_z, there without any deflection."""
    model, numbers = case
    frozen = SymbolicTwin(numbers, "frozen")
    for state, inputs in random_pairs(5):
        flat = replace(state, delta=np.zeros(3))
        terms = frozen.terms(flat)
        missing = inputs.generalized - terms.bias - terms.mass @ accelerations(model, flat, inputs)
        root = numbers.panel_root
        trans, rot = numbers.panel.translation, numbers.panel.rotation
        wx, wy, wz = flat.omega_b
        # d/d delta of half omega . I_a,b omega about the base: the root's offset counts as well
        lever = root[0] * trans + rot
        expected = wz * wx * lever + wz * wy * root[1] * trans - (wx**2 + wy**2) * root[2] * trans
        size = np.abs(terms.mass[15:] @ np.abs(accelerations(model, flat, inputs))).max()
        np.testing.assert_allclose(missing[15:], expected, rtol=0, atol=EXACT * size)


small = st.floats(-1.0, 1.0, allow_nan=False, width=32)
triple = st.tuples(small, small, small).map(np.array)


@settings(max_examples=60, deadline=None)
@given(
    omega=triple,
    v=triple,
    qd=triple,
    rho=triple,
    delta=triple,
    rates=triple,
    torque=triple,
    seed=st.integers(0, 99),
)
def test_internal_torques_change_no_momentum(omega, v, qd, rho, delta, rates, torque, seed):
    """d/dt (p, h) = 0 in inertial axes under wheel and joint torques, springs and dampers."""
    model = build_model_once()
    state = State.random(np.random.default_rng(seed))
    state = replace(
        state, omega_b=omega, v_b=v, qd=qd, rho=rho, delta=3 * delta, rho_dot=rates, delta_dot=-2 * rates
    )
    order = Ordering(model)
    q, u = order.q(state), order.v(state)
    vdot = model.acceleration(0.0, q, u, order.tau(Inputs(wheel_torque=torque, joint_torque=30 * torque)))
    rate = pin.computeCentroidalMomentumTimeVariation(model.pin, model.data, q, u, vdot)
    scale = np.abs(mass_matrix(model, state) @ np.abs(order.back(vdot))).max() + 1.0
    assert np.abs(rate.vector).max() < EXACT * scale


_MODELS: list[SpacecraftModel] = []


def build_model_once() -> SpacecraftModel:
    """The paper's model, built once: hypothesis does not mix with fixtures of function scope."""
    if not _MODELS:
        _MODELS.append(build_model(load_description(URDF / "paper_sms.toml")))
    return _MODELS[0]
