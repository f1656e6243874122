"""The kernel's dynamics and charts against Pinocchio, to rounding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

from smsid.effects import JointFriction
from smsid.kernel._motion import chart_rate, gravity_here, move, start_of_chart
from smsid.kernel._tree import acceleration, workspace
from smsid.kernel.arrays import Kernel, arrays_of
from smsid.kernel.columns import TURNING
from smsid.kernel.steps import conserved
from smsid.model import build_model
from smsid.simulate.trajectory import closing_audit


def some_state(model, seed):
    rng = np.random.default_rng(seed)
    q = pin.integrate(model.pin, model.home, rng.standard_normal(model.nv))
    return q, rng.standard_normal(model.nv), 10.0 * rng.standard_normal(model.nv)


@pytest.mark.parametrize("seed", range(3))
def test_accelerations_are_pinocchios(craft, seed):
    kernel = arrays_of(craft)
    q, v, tau = some_state(craft, seed)
    angles, found = np.empty(len(kernel.tree)), np.empty(craft.nv)
    gravity = start_of_chart(kernel.tree, kernel.root, q, angles)
    acceleration(*kernel.arrays, angles, v, tau, gravity, workspace(len(kernel.tree)), found)
    exact = craft.acceleration(0.0, q, v, tau)
    np.testing.assert_allclose(found, exact, rtol=1e-10, atol=1e-10 * np.abs(exact).max())


def test_gravity_turns_with_the_chart(crafts):
    craft = crafts["sliding"]
    kernel = arrays_of(craft)
    q, xi, _ = some_state(craft, 0)
    angles = np.empty(len(kernel.tree))
    here = gravity_here(kernel.root, start_of_chart(kernel.tree, kernel.root, q, angles), xi)
    moved = pin.Quaternion(pin.integrate(craft.pin, q, xi)[3:7]).toRotationMatrix()
    np.testing.assert_allclose(here, moved.T @ craft.pin.gravity.linear, atol=1e-13)


@pytest.mark.parametrize("size", [1e-9, 1e-3, 0.1, 0.23, 1.0, 2.0])
def test_configurations_move_as_pinocchios(craft, size):
    kernel = arrays_of(craft)
    q, xi, _ = some_state(craft, 1)
    found = np.empty(craft.nq)
    move(kernel.tree, kernel.root, q, size * xi, found)
    np.testing.assert_allclose(found, pin.integrate(craft.pin, q, size * xi), atol=1e-13)


def adjoint(xi):
    """Return the matrix (6, 6) of the Lie bracket with xi (6,)."""
    w, v = pin.skew(xi[3:]), pin.skew(xi[:3])
    return np.block([[w, v], [np.zeros((3, 3)), w]])


@pytest.mark.parametrize("size", [1e-9, 1e-3, 0.1, 0.22, 0.23, 0.5, 1.0, 3.0])
def test_the_rate_of_a_chart_inverts_the_exponentials_derivative(size):
    """int_0^1 exp(-s ad) ds takes it back to v; Pinocchio's Jlog6 is off by up to 1e-9 for small angles."""
    for seed in range(5):
        xi, v = np.random.default_rng(seed).standard_normal((2, 6))
        xi *= size / np.linalg.norm(xi[3:])
        found = np.empty(6)
        chart_rate(xi, v, found)
        both = np.zeros((12, 12))
        both[:6, :6], both[:6, 6:] = -adjoint(xi), np.eye(6)
        np.testing.assert_allclose(expm(both)[:6, 6:] @ found, v, atol=2e-12)
        np.testing.assert_allclose(found, pin.Jlog6(pin.exp6(xi)) @ v, atol=1e-8)


def test_momentum_and_energy_are_the_models(craft):
    kernel = arrays_of(craft)
    states = [some_state(craft, seed) for seed in range(4)]
    q, v = np.array([s[0] for s in states]), np.array([s[1] for s in states])
    found = np.empty((4, 8))
    conserved(*kernel.arrays, q, v, found)
    for row, a, b in zip(found, q, v, strict=True):
        exact = [craft.energy(a, b), pin.computeKineticEnergy(craft.pin, craft.data, a, b)]
        np.testing.assert_allclose(row[6:], exact, rtol=1e-12)
        if craft.free:
            exact = craft.momentum(a, b)
            np.testing.assert_allclose(row[:6], exact, atol=1e-12 * np.abs(exact).max())
    plain = closing_audit(craft, q, v, np.zeros((4, 7)))
    ours = closing_audit(craft, q, v, np.zeros((4, 7)), kernel)
    assert ours.energy_drift == pytest.approx(plain.energy_drift, rel=1e-12)
    assert ours.momentum_scale == pytest.approx(plain.momentum_scale, rel=1e-12)


def test_balanced_wheels_and_what_only_slides_do_not_turn(crafts):
    """That is what makes them cheap; a wheel with an imbalance turns."""
    craft = crafts["paper"]
    turning = arrays_of(craft).tree[:, TURNING]
    assert sorted(np.flatnonzero(turning)) == sorted(craft.arm_joints.v - 6)
    wheel = int(craft.wheels.joints[0])
    model = build_model(craft.description)
    model.pin.inertias[wheel] = pin.Inertia(0.1, np.array([0.01, 0.0, 0.02]), 0.01 * np.eye(3))
    assert arrays_of(model).tree[craft.wheels.v[0] - 6, TURNING]


def test_forces_of_no_known_law_go_the_plain_way(crafts):
    d = crafts["paper"].description
    friction = JointFriction(name="dry", joint=crafts["paper"].arm_joints.names[0], coulomb=1.0)
    model = build_model(d.with_effects(friction))
    assert Kernel.of(model) is not None
    of_its_own = replace(model, forces=(*model.forces, lambda t, q, v, tau: None))
    assert Kernel.of(of_its_own) is None


def test_joints_of_another_kind_go_the_plain_way(crafts):
    model = build_model(crafts["satellite"].description)
    model.pin.addJoint(1, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    assert arrays_of(model) is None
