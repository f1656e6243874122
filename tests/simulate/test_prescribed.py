"""Prescribed motion, held attitude, locked joints and wheels; dense output; the audit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import Description, load_description
from smsid.effects import JointFriction
from smsid.errors import ExperimentError
from smsid.model import build_model
from smsid.simulate import (
    Constant,
    Fourier,
    Inputs,
    JointMotion,
    PiecewiseConstant,
    Sampled,
    Tolerance,
    simulate,
)
from smsid.simulate._dynamics import Dynamics

URDF = Path(__file__).resolve().parents[2] / "urdf"
PAPER = load_description(URDF / "paper_sms.toml")
MODEL = build_model(PAPER)
RNG = np.random.default_rng(4)
THRUST = PiecewiseConstant(
    (0.0, 4.0, 8.0), np.array([[40.0, 10.0, -20.0], [-40.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
)


def fourier(size, amplitude, offset=None):
    cos, sin = amplitude * RNG.standard_normal((2, size, 3))
    return Fourier(1 / 20, cos, sin, np.zeros(size) if offset is None else offset)


ROLLING = Inputs(wheel_torque=fourier(3, 0.3), joint_torque=fourier(3, 2.0))
MOTION = JointMotion.of(fourier(3, 0.05, np.array([0.4, -0.6, 0.9])))
MOVING = Inputs(joint_motion=MOTION, wheel_torque=fourier(3, 0.3), force=THRUST)
HELD = Inputs(force=THRUST, hold_attitude=True, lock_joints=True, lock_wheels=True)


@pytest.mark.parametrize("inputs", [ROLLING, MOVING, HELD], ids=["rolling", "moving", "held"])
def test_dense_output_is_as_good_as_a_tighter_run(inputs):
    """Between the steps as at them; the default tolerance is 1e-9 of each coordinate."""
    grid = np.sort(RNG.uniform(0.0, 12.0, 200))
    found = simulate(MODEL, inputs, 12.0).states(grid)
    exact = simulate(MODEL, inputs, 12.0, tolerance=Tolerance(1e-12, 1e-14)).states(grid)
    for name in ("q", "v", "a", "reaction"):
        a, b = getattr(found, name), getattr(exact, name)
        np.testing.assert_allclose(a, b, atol=3e-8 * max(1.0, np.abs(b).max()), err_msg=name)


@pytest.mark.parametrize("inputs", [ROLLING, MOVING, HELD], ids=["rolling", "moving", "held"])
def test_momentum_and_energy_close(inputs):
    audit = simulate(MODEL, inputs, 12.0).audit()
    assert audit.energy_scale > 0.01
    assert audit.momentum_drift < 1e-9 * audit.momentum_scale
    assert audit.energy_drift < 1e-9 * audit.energy_scale


def test_energy_closes_with_friction():
    friction = JointFriction(name="f", joint="joint2", viscous=0.4, coulomb=0.3, smoothing=0.02)
    audit = simulate(build_model(PAPER.with_effects(friction)), ROLLING, 12.0).audit()
    assert audit.momentum_drift < 1e-9 * audit.momentum_scale
    assert audit.energy_drift < 1e-8 * audit.energy_scale  # tanh is sharp against the steps of the quadrature


def test_the_audit_sees_what_is_wrong():
    """With forces that the audit does not count, the drift is their impulse and work."""
    trajectory = simulate(MODEL, Inputs(force=Constant(np.array([2.0, 0.0, 0.0]))), 5.0)
    blind = type(trajectory)(MODEL, Inputs(), trajectory.charts, trajectory.start, trajectory.stop).audit()
    assert blind.momentum_drift == pytest.approx(10.0, rel=1e-3)
    assert blind.energy_drift > 0.01


def test_joints_follow_their_prescribed_motion_exactly():
    times = np.linspace(0.0, 12.0, 50)
    states = simulate(MODEL, MOVING, 12.0).states(times)
    j = MODEL.arm_joints.v
    for signal, found in (
        (MOTION.position, MODEL.joint_angles(states.q)),
        (MOTION.velocity, states.v[:, j]),
        (MOTION.acceleration, states.a[:, j]),
    ):
        np.testing.assert_allclose(found, [signal(float(t)) for t in times], atol=1e-12)
    others = np.setdiff1d(np.arange(MODEL.nv), j)
    np.testing.assert_array_equal(states.reaction[:, others], 0.0)


@pytest.mark.parametrize("inputs", [MOVING, HELD], ids=["moving", "held"])
def test_accelerations_at_many_times_are_those_at_each(inputs):
    states, dynamics = simulate(MODEL, inputs, 2.0).states(np.linspace(0.0, 2.0, 9)), Dynamics(MODEL, inputs)
    found = [
        dynamics.acceleration(float(t), q, v) for t, q, v in zip(states.time, states.q, states.v, strict=True)
    ]
    np.testing.assert_allclose(states.a, found, atol=1e-13)


def test_the_reaction_fed_back_as_torque_reproduces_the_motion():
    trajectory = simulate(MODEL, Inputs(joint_motion=MOTION), 6.0, tolerance=Tolerance(1e-11, 1e-13))
    grid = np.linspace(0.0, 6.0, 1201)
    states = trajectory.states(grid)
    torque = Sampled.from_samples(grid, states.reaction[:, MODEL.arm_joints.v], 5)
    again = simulate(MODEL, Inputs(joint_torque=torque), 6.0, q0=states.q[0], v0=states.v[0]).states(grid)
    np.testing.assert_allclose(again.q, states.q, atol=1e-8)
    np.testing.assert_allclose(again.v, states.v, atol=1e-8)
    assert np.ptp(MODEL.joint_angles(again.q), axis=0).min() > 0.05


def test_held_attitude_stays_and_its_torque_fed_back_holds_it():
    grid = np.linspace(0.0, 3.9, 401)  # up to the next step of thrust, where the torque jumps
    trajectory = simulate(MODEL, HELD, 3.9, tolerance=Tolerance(1e-11, 1e-13))
    states = trajectory.states(grid)
    np.testing.assert_array_equal(states.v[:, 3:6], 0.0)
    np.testing.assert_allclose(states.q[:, 3:7], np.tile([0.0, 0.0, 0.0, 1.0], (401, 1)), atol=1e-14)
    torque = Sampled.from_samples(grid, states.reaction[:, 3:6], 5)
    assert np.abs(torque(2.0)).max() > 1.0
    free = Inputs(force=THRUST, torque=torque, lock_joints=True, lock_wheels=True)
    again = simulate(MODEL, free, 3.9).states(grid)
    np.testing.assert_allclose(again.q, states.q, atol=1e-8)


def test_locked_joints_and_wheels_do_not_move():
    states = simulate(MODEL, HELD, 12.0).states(np.linspace(0.0, 12.0, 30))
    for group in (MODEL.arm_joints, MODEL.wheels):
        np.testing.assert_array_equal(states.v[:, group.v], 0.0)
        np.testing.assert_allclose(states.q[:, group.q], np.tile(MODEL.home[group.q], (30, 1)), atol=1e-14)
    assert np.abs(states.reaction[:, MODEL.arm_joints.v]).max() > 1.0


def test_locked_joints_are_those_of_a_welded_arm():
    """The spacecraft with locked joints accelerates as one body of its composite inertia."""
    model = build_model(Description(name="x", urdf="paper_sms.urdf", folder=URDF))
    force = np.array([10.0, -5.0, 3.0])
    states = simulate(model, Inputs(force=Constant(force), lock_joints=True), 1.0).states(np.zeros(1))
    composite = np.triu(pin.crba(model.pin, model.data, model.home))[:6, :6]
    composite = composite + np.triu(composite, 1).T
    np.testing.assert_allclose(states.a[0, :6], np.linalg.solve(composite, [*force, 0, 0, 0]), rtol=1e-10)


def test_held_samples_are_steps():
    times, values = np.array([0.0, 1.0, 2.5]), RNG.standard_normal((3, 3))
    held = simulate(MODEL, Inputs(force=Sampled.from_samples(times, values, 0)), 4.0)
    steps = simulate(MODEL, Inputs(force=PiecewiseConstant(tuple(times), values)), 4.0)
    grid = np.linspace(0.0, 4.0, 21)
    np.testing.assert_allclose(held.states(grid).q, steps.states(grid).q, atol=1e-13)


def test_starting_later_shifts_time():
    late = simulate(MODEL, ROLLING, 5.0, start=3.0).states(np.array([3.0, 8.0]))
    np.testing.assert_array_equal(late.q[0], MODEL.home)
    np.testing.assert_allclose(late.tau[1, MODEL.wheels.v], ROLLING.wheel_torque(8.0), atol=1e-14)


def test_going_on_from_a_state_is_the_same_motion():
    whole = simulate(MODEL, ROLLING, 8.0, tolerance=Tolerance(1e-12, 1e-14)).states(np.array([5.0, 8.0]))
    rest = simulate(
        MODEL, ROLLING, 3.0, q0=whole.q[0], v0=whole.v[0], start=5.0, tolerance=Tolerance(1e-12, 1e-14)
    )
    np.testing.assert_allclose(rest.states(np.array([8.0])).q[0], whole.q[1], atol=1e-10)


def test_progress_and_the_largest_step():
    seen: list[float] = []
    trajectory = simulate(MODEL, ROLLING, 2.0, max_step=0.01, progress=seen.append)
    assert trajectory.steps >= 200 and seen[-1] == 2.0
    assert np.all(np.diff(seen) > 0.0)


MISFITS = {
    "force of two": (Inputs(force=Constant(np.zeros(2))), "'force' has 2 components"),
    "four joints": (Inputs(joint_torque=Constant(np.zeros(4))), "'joint_torque' has 4"),
    "motion of two": (Inputs(joint_motion=JointMotion.of(fourier(2, 0.1))), "2 joints of 3"),
    "torque and motion": (
        Inputs(joint_torque=fourier(3, 1.0), joint_motion=MOTION),
        "driven by torque",
    ),
    "torque and lock": (Inputs(joint_torque=fourier(3, 1.0), lock_joints=True), "driven by torque"),
    "motion and lock": (Inputs(joint_motion=MOTION, lock_joints=True), "moved along"),
    "wheels and lock": (Inputs(wheel_torque=fourier(3, 1.0), lock_wheels=True), "Wheels cannot"),
}


@pytest.mark.parametrize("case", MISFITS)
def test_inputs_that_do_not_fit_are_refused(case):
    inputs, text = MISFITS[case]
    with pytest.raises(ExperimentError, match=text):
        simulate(MODEL, inputs, 1.0)


@pytest.mark.parametrize(
    "inputs",
    [Inputs(hold_attitude=True), Inputs(force=Constant(np.zeros(3))), Inputs(torque=Constant(np.zeros(3)))],
)
def test_a_welded_base_takes_no_thrust(inputs):
    model = build_model(Description(name="x", urdf="paper_sms.urdf", folder=URDF, root="fixed"))
    with pytest.raises(ExperimentError, match="welded base"):
        simulate(model, inputs, 1.0)
