"""The reduced dynamics (40) against forward dynamics of the whole, and against MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from control_cases import URDF, described, joint_space, paper, random_state, rigid_paper, two_arms
from twins.cases import SKEWED
from twins.description import write_description
from twins.mujoco_twin import MujocoTwin
from twins.numbers import PAPER
from twins.state import State

from smsid.control.reduced import ReducedDynamics
from smsid.description import load_description
from smsid.errors import ControlError
from smsid.model import build_model


def states(model, count, seed=3):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        q, v = random_state(model, rng)
        yield q, v, rng.standard_normal(len(model.wheels)), 10.0 * rng.standard_normal(len(model.arm_joints))


@pytest.fixture(params=["rigid paper", "two rigid arms"])
def rigid(request):
    if request.param == "rigid paper":
        return rigid_paper()
    bare = load_description(URDF / "two_arm_sms.toml").model_copy(update={"effect": (), "sensor": ()})
    return build_model(bare)


def test_accelerations_are_those_of_forward_dynamics(rigid):
    """pin.aba of the whole spacecraft, any velocity of the centre of mass, any wheel layout."""
    reduced = ReducedDynamics(rigid)
    for q, v, wheel_torque, joint_torque in states(rigid, 50):
        tau = np.zeros(rigid.nv)
        tau[rigid.wheels.v], tau[rigid.arm_joints.v] = wheel_torque, joint_torque
        full = pin.aba(rigid.pin, rigid.data, q, v, tau)
        terms = reduced.body_terms(v[3:6], rigid.joint_angles(q), v[rigid.arm_joints.v], v[rigid.wheels.v])
        force = terms.input @ np.concatenate([wheel_torque, joint_torque])
        found = np.linalg.solve(terms.inertia, force - terms.bias)
        exact = np.concatenate([full[3:6], full[rigid.arm_joints.v]])
        assert np.abs(found - exact).max() < 1e-9 * np.abs(exact).max()


def test_wheels_on_the_base_are_what_their_axes_say(rigid):
    reduced = ReducedDynamics(rigid)
    q, v, *_ = next(states(rigid, 1))
    terms = reduced.body_terms(v[3:6], rigid.joint_angles(q), v[rigid.arm_joints.v], v[rigid.wheels.v])
    np.testing.assert_allclose(reduced.base_input(terms), np.eye(reduced.size), atol=1e-12)


def test_euler_form_is_the_paper_s_equation(rigid):
    """H qdd + c = J_c^T Q_c with Euler angles, their second derivative from the whole spacecraft's motion."""
    reduced = ReducedDynamics(rigid)
    for q, v, _, joint_torque in states(rigid, 20):
        rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
        angles = pin.rpy.matrixToRpy(rotation)
        if np.cos(angles[1]) < 0.1:
            continue
        jacobian = pin.rpy.computeRpyJacobian(angles, pin.LOCAL)
        rates = np.linalg.solve(jacobian, v[3:6])
        change = pin.rpy.computeRpyJacobianTimeDerivative(angles, rates, pin.LOCAL)
        base_torque = np.array([0.5, -1.0, 0.7])
        tau = np.zeros(rigid.nv)
        tau[rigid.wheels.v] = -reduced.layout.inverse @ base_torque
        tau[rigid.arm_joints.v] = joint_torque
        full = pin.aba(rigid.pin, rigid.data, q, v, tau)
        second = np.concatenate(
            [np.linalg.solve(jacobian, full[3:6] - change @ rates), full[rigid.arm_joints.v]]
        )
        form = joint_space(
            reduced,
            np.concatenate([angles, rigid.joint_angles(q)]),
            np.concatenate([rates, v[rigid.arm_joints.v]]),
            v[rigid.wheels.v],
        )
        given = form.input @ np.concatenate([base_torque, joint_torque])
        left = form.inertia @ second + form.bias
        assert np.abs(left - given).max() < 1e-9 * max(np.abs(given).max(), np.abs(form.bias).max())
        np.testing.assert_allclose(form.inertia, form.inertia.T, rtol=0.0, atol=1e-9 * form.inertia.max())
        assert np.linalg.eigvalsh(form.inertia).min() > 0.0


def test_wheel_rates_follow_from_zero_momentum():
    """Started at rest, a moving spacecraft's wheels carry what the rest does not: no tachometer needed."""
    model = rigid_paper()
    reduced = ReducedDynamics(model)
    q, v = random_state(model, np.random.default_rng(5))
    v[model.wheels.v] = 0.0
    h = pin.computeCentroidalMomentum(model.pin, model.data, q, v)
    rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
    v[model.wheels.v] = -rotation.T @ h.angular / reduced.layout.inertia
    angles, rates = model.joint_angles(q), v[model.arm_joints.v]
    measured = reduced.body_terms(v[3:6], angles, rates, v[model.wheels.v])
    conserved = reduced.body_terms(v[3:6], angles, rates)
    np.testing.assert_allclose(conserved.bias, measured.bias, atol=1e-9 * np.abs(measured.bias).max())
    wrong = reduced.body_terms(v[3:6], angles, rates, np.zeros(3))
    assert np.abs(wrong.bias - measured.bias).max() > 1e-2 * np.abs(measured.bias).max()


def test_four_wheels_store_the_momentum_of_their_rates():
    model = two_arms()
    reduced = ReducedDynamics(model)
    q, v = random_state(model, np.random.default_rng(6))
    angles, rates = model.joint_angles(q), v[model.arm_joints.v]
    spin = v[model.wheels.v]
    shifted = spin + reduced.layout.null_space[:, 0] * 30.0
    a = reduced.body_terms(v[3:6], angles, rates, spin)
    b = reduced.body_terms(v[3:6], angles, rates, shifted)
    np.testing.assert_allclose(a.bias, b.bias, atol=1e-10 * np.abs(a.bias).max())


@pytest.mark.parametrize("numbers", [PAPER, SKEWED], ids=["paper", "skewed"])
def test_against_mujoco_with_slosh_and_panel_frozen(numbers, tmp_path):
    """MuJoCo's mass matrix and bias of base, wheels and arm, slosh and bending held at rest."""
    model = build_model(load_description(write_description(numbers, tmp_path)))
    reduced, twin = ReducedDynamics(model), MujocoTwin(numbers)
    rng = np.random.default_rng(8)
    worst = 0.0
    for _ in range(50):
        state = State.random(rng)
        zero = {name: np.zeros(3) for name in ("rho", "rho_dot", "delta", "delta_dot")}
        state = State(**{**vars(state), **zero})
        twin.data.qpos, twin.data.qvel = twin._pack(state)
        mujoco.mj_forward(twin.model, twin.data)
        force = np.zeros(12)
        force[6:12] = rng.standard_normal(6)
        exact = np.linalg.solve(twin._full_mass()[:12, :12], force - twin.data.qfrc_bias[:12])
        terms = reduced.body_terms(state.omega_b, state.q, state.qd, state.wheel_rate)
        found = np.linalg.solve(terms.inertia, terms.input @ force[6:12] - terms.bias)
        exact = np.concatenate([exact[3:6], exact[9:12]])
        worst = max(worst, np.abs(found - exact).max() / np.abs(exact).max())
    assert worst < 1e-9, worst


def test_freezing_keeps_the_mass_and_the_order_of_the_joints():
    model = two_arms()
    reduced = ReducedDynamics(model)
    np.testing.assert_allclose(reduced.mass, model.mass, rtol=1e-12)
    assert reduced.arm.names == model.arm_joints.names
    assert reduced.pin.nv == 6 + len(model.arm_joints) + len(model.wheels)


def test_bad_input_is_refused():
    reduced = ReducedDynamics(paper())
    with pytest.raises(ControlError, match=r"`rates` has shape \(2,\), the spacecraft needs \(3,\)"):
        reduced.body_terms(np.zeros(3), np.zeros(3), np.zeros(2))
    with pytest.raises(ControlError, match="welded"):
        ReducedDynamics(build_model(described(root="fixed")))
    flat = described(wheel=described().wheel[:2])
    with pytest.raises(ControlError, match="layout is singular"):
        ReducedDynamics(build_model(flat))
    with pytest.raises(ControlError, match="0 inertias were given for 7 bodies"):
        reduced.with_inertias([])
