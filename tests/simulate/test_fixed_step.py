"""The fixed-step integrator for closed loops: order, hold, delay, drift."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import Description, load_description
from smsid.errors import ExperimentError, SimulationError
from smsid.model import build_model
from smsid.simulate import Fourier, Inputs, PiecewiseConstant, Tolerance, simulate, simulate_closed_loop

URDF = Path(__file__).resolve().parents[2] / "urdf"
MODEL = build_model(load_description(URDF / "paper_sms.toml"))
BUS = build_model(Description(name="x", urdf="bus.urdf", folder=URDF))


def nothing(t, q, v):
    return np.zeros(len(v))


def spinning_start():
    rng = np.random.default_rng(0)
    v = np.zeros(MODEL.nv)
    v[:6] = [0.1, -0.2, 0.05, 0.45, -0.3, 0.5]
    v[MODEL.arm_joints.v] = 0.2 * rng.standard_normal(3)
    v[MODEL.wheels.v] = 30.0 * rng.standard_normal(3)
    return v


def test_fourth_order_on_the_manifold():
    """Halving the step divides the error of position, attitude and rates by sixteen; the bus turns on."""
    v0 = spinning_start()
    exact = simulate(MODEL, Inputs(), 4.0, v0=v0, tolerance=Tolerance(1e-13, 1e-15)).states(np.array([4.0]))
    errors = []
    for dt in (0.02, 0.01, 0.005):
        found = simulate_closed_loop(MODEL, nothing, 4.0, dt=dt, control_rate=50.0, v0=v0)
        gap = pin.difference(MODEL.pin, exact.q[0], found.q[-1])
        errors.append([np.abs(gap[:3]).max(), np.abs(gap[3:6]).max(), np.abs(found.v[-1] - exact.v[0]).max()])
    order = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(np.abs(order - 4.0) < 0.25)


def test_the_drift_is_of_fourth_order_too():
    drifts = [
        simulate_closed_loop(MODEL, nothing, 2.0, dt=dt, control_rate=50.0, v0=spinning_start()).audit
        for dt in (0.02, 0.01, 0.005)
    ]
    momentum = np.log2([drifts[i].momentum_drift / drifts[i + 1].momentum_drift for i in range(2)])
    energy = np.log2([drifts[i].energy_drift / drifts[i + 1].energy_drift for i in range(2)])
    assert np.all(momentum > 3.7) and np.all(energy > 3.7)


def test_quaternions_stay_unit():
    found = simulate_closed_loop(MODEL, nothing, 10.0, dt=0.02, control_rate=10.0, v0=spinning_start())
    assert np.abs(np.linalg.norm(found.q[:, 3:7], axis=1) - 1.0).max() < 1e-12


def sampled(rate, tau):
    """A controller that plays back values by sample number and notes when it is asked."""
    asked = []

    def controller(t, q, v):
        asked.append(t)
        return tau[round(t * rate)]

    return controller, asked


def test_held_commands_are_the_steps_of_the_adaptive_integrator():
    rng = np.random.default_rng(1)
    tau = np.zeros((20, MODEL.nv))
    tau[:, MODEL.arm_joints.v] = 3.0 * rng.standard_normal((20, 3))
    tau[:, :3] = 20.0 * rng.standard_normal((20, 3))
    controller, asked = sampled(10.0, tau)
    found = simulate_closed_loop(MODEL, controller, 2.0, dt=0.005, control_rate=10.0)
    times = tuple(0.1 * k for k in range(20))
    inputs = Inputs(
        force=PiecewiseConstant(times, tau[:, :3]),
        joint_torque=PiecewiseConstant(times, tau[:, MODEL.arm_joints.v]),
    )
    exact = simulate(MODEL, inputs, 2.0, tolerance=Tolerance(1e-12, 1e-14)).states(found.time)
    np.testing.assert_allclose(asked, times, atol=1e-12)
    np.testing.assert_allclose(found.q, exact.q, atol=1e-9)
    np.testing.assert_allclose(found.v, exact.v, atol=1e-8)
    np.testing.assert_array_equal(found.tau[:-1], np.repeat(tau, 20, axis=0))
    np.testing.assert_array_equal(found.tau[-1], tau[-1])
    assert found.audit.momentum_drift < 1e-8 * found.audit.momentum_scale
    assert found.audit.energy_drift < 1e-8 * found.audit.energy_scale


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_commands_act_after_their_delay(delay):
    tau = np.zeros((10, 6))
    tau[:, 0] = np.arange(1.0, 11.0)
    controller, _ = sampled(5.0, tau)
    found = simulate_closed_loop(BUS, controller, 2.0, dt=0.1, control_rate=5.0, delay=delay)
    acted = found.tau[:-1:2, 0]
    np.testing.assert_array_equal(acted, np.concatenate([np.zeros(delay), np.arange(1.0, 11.0 - delay)]))
    assert found.v[-1, 0] == pytest.approx(acted.sum() * 0.2 / 2000.0, rel=1e-12)


def test_a_sampled_regulator_does_what_its_z_transform_says():
    """A double integrator under u = -k x - d v at 2 Hz: x[k + 1] = A x[k] exactly."""
    stiffness, damping, period = 200.0, 900.0, 0.5
    a = np.array([[1.0, period], [0.0, 1.0]])
    a -= np.outer([period**2 / 2, period], [stiffness, damping]) / 2000.0

    def controller(t, q, v):
        return np.array([-stiffness * q[0] - damping * v[0], 0, 0, 0, 0, 0])

    q0 = BUS.home.copy()
    q0[0] = 1.0
    found = simulate_closed_loop(BUS, controller, 20.0, dt=0.1, control_rate=2.0, q0=q0)
    state = np.array([1.0, 0.0])
    for k in range(41):
        np.testing.assert_allclose([found.q[5 * k, 0], found.v[5 * k, 0]], state, atol=1e-12)
        state = a @ state


def test_a_controller_cannot_spoil_the_state():
    def controller(t, q, v):
        q[:] = np.nan
        v[:] = np.nan
        return np.zeros(6)

    found = simulate_closed_loop(BUS, controller, 1.0, dt=0.1, control_rate=10.0)
    np.testing.assert_array_equal(found.q, np.tile(BUS.home, (11, 1)))


def test_an_unstable_loop_is_told_with_its_time():
    def controller(t, q, v):
        return 1e200 * (1.0 + np.abs(v)) * np.ones(6)

    with pytest.raises(SimulationError, match="blew up at t = ") as caught:
        simulate_closed_loop(BUS, controller, 10.0, dt=0.1, control_rate=10.0)
    assert caught.value.evidence["time"] > 0.0


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ({"dt": 0.03, "control_rate": 10.0}, "control period"),
        ({"dt": 0.2, "control_rate": 10.0}, "control period"),
        ({"dt": 0.07, "control_rate": 1 / 0.07}, "duration"),
        ({"dt": 0.0, "control_rate": 10.0}, "whole number"),
        ({"dt": 0.1, "control_rate": 10.0, "delay": -1}, "delay of -1"),
    ],
)
def test_steps_that_do_not_fit_are_refused(keys, text):
    with pytest.raises(ExperimentError, match=text):
        simulate_closed_loop(BUS, nothing, 1.0, **keys)


@pytest.mark.parametrize("answer", [np.zeros(3), 0.0, np.zeros((1, 6))])
def test_a_controller_must_return_generalised_forces(answer):
    with pytest.raises(ExperimentError, match="The controller returned shape"):
        simulate_closed_loop(BUS, lambda t, q, v: answer, 1.0, dt=0.1, control_rate=10.0)


def test_the_papers_experiment_2_at_ten_milliseconds():
    """RK4 at 10 ms leaves an error of omega of about 8e-9 rad/s after 80 s (reference engine); here 20 s."""
    rng = np.random.default_rng(3)
    torque = Fourier(1 / 20, 2.0 * rng.standard_normal((3, 3)), np.zeros((3, 3)), np.zeros(3))

    def controller(t, q, v):
        tau = np.zeros(MODEL.nv)
        tau[MODEL.arm_joints.v] = torque(t)
        return tau

    found = simulate_closed_loop(MODEL, controller, 20.0, dt=0.01, control_rate=100.0)
    fine = simulate_closed_loop(MODEL, controller, 20.0, dt=0.005, control_rate=100.0)
    assert np.abs(found.v[-1, 3:6] - fine.v[-1, 3:6]).max() < 8e-9


def test_a_stiff_joint_is_followed_at_the_controllers_rate(light):
    """Dry friction that settles within 5e-7 s, torques held for 50 ms: against the adaptive method."""
    values = np.array([0.5, 1.5, -1.2, 0.3, -0.9])
    torques = PiecewiseConstant(tuple(0.05 * k for k in range(5)), values[:, None])
    found = simulate_closed_loop(light, lambda t, q, v: torques(t), 0.25, dt=0.05, control_rate=20.0)
    exact = simulate(light, Inputs(joint_torque=torques), 0.25).states(found.time)
    np.testing.assert_allclose(found.q, exact.q, atol=1e-5)
    np.testing.assert_allclose(found.v, exact.v, rtol=1e-5, atol=1e-6)
    assert found.audit is not None and found.audit.energy_drift < 1e-3 * found.audit.energy_scale
