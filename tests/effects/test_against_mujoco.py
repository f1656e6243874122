"""Effects on bodies, wheels and actuators against the MuJoCo twin with the same change made there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from twins.cases import SKEWED, random_pairs, relative
from twins.description import Ordering, write_description
from twins.mujoco_twin import Drive, MujocoTwin
from twins.numbers import Spacecraft
from twins.state import Inputs as TwinInputs
from twins.state import State, rotation

from smsid.description import Description, load_description
from smsid.effects import (
    ActuatorDelay,
    BodyError,
    Effect,
    ExternalWrench,
    MassLoss,
    Payload,
    ThrusterGain,
    ThrusterMisalignment,
    TorqueGain,
    WheelImbalance,
)
from smsid.model import build_model
from smsid.simulate import Fourier, Inputs, simulate

N: Spacecraft = SKEWED


@pytest.fixture(scope="module")
def description(tmp_path_factory: pytest.TempPathFactory) -> Description:
    return load_description(write_description(N, tmp_path_factory.mktemp("twin")))


def point(mass: float, r: tuple[float, float, float]) -> np.ndarray:
    x, y, z = r
    return mass * np.array([1, x, y, z, y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y])


def add(twin: MujocoTwin, body: str, theta: np.ndarray) -> None:
    """Add inertial parameters (m, mc, xx, xy, yy, xz, yz, zz) about the origin of a MuJoCo body to it."""
    model, k = twin.model, twin.model.body(body).id
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[k])
    turn = turn.reshape(3, 3)
    mass, com = model.body_mass[k], model.body_ipos[k].copy()
    about = turn @ np.diag(model.body_inertia[k]) @ turn.T
    about += mass * (com @ com * np.eye(3) - np.outer(com, com))
    xx, xy, yy, xz, yz, zz = theta[4:]
    about += np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    first, mass = mass * com + theta[1:4], mass + theta[0]
    com = first / mass
    values, axes = np.linalg.eigh(about - mass * (com @ com * np.eye(3) - np.outer(com, com)))
    axes *= np.sign(np.linalg.det(axes))
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, axes.ravel())
    model.body_mass[k], model.body_ipos[k] = mass, com
    model.body_inertia[k], model.body_iquat[k] = values, quat


def twin_with(body: str, theta: np.ndarray) -> MujocoTwin:
    twin = MujocoTwin(N)
    add(twin, body, theta)
    return twin


ERROR = BodyError(
    name="e", body="link2", mass=-3.0, first_moment=(-2.0, 0.5, 0.3), inertia=(1.0, 0.2, 0.5, -0.1, 0.3, 0.8)
)
STATIC, DYNAMIC, PHASE = 0.02, 0.01, 0.7
RADIAL = np.array([np.cos(PHASE), np.sin(PHASE), 0.0])  # of the wheel about z
CASES: dict[str, tuple[Effect, str, np.ndarray]] = {
    "payload": (
        Payload(name="p", frame="link3", mass=7.0, com=(1.8, 0.1, -0.2)),
        "link2",
        point(7.0, (1.8, 0.1, -0.2)),
    ),
    "link": (ERROR, "link1", np.array([ERROR.mass, *ERROR.first_moment, *ERROR.inertia])),
    "bus": (
        BodyError(name="e", mass=50.0, first_moment=(5.0, -9.0, 3.0), inertia=(60, 4, 80, -3, 6, 70)),
        "base",
        np.array([50.0, 5.0, -9.0, 3.0, 60, 4, 80, -3, 6, 70]),
    ),
    "mass loss": (
        MassLoss(name="l", rate=2.0, position=(0.6, -0.5, 0.7), start=10.0),
        "base",
        point(-60.0, (0.6, -0.5, 0.7)),
    ),
    "mass loss of a link": (
        MassLoss(name="l", frame="link2", rate=0.5, position=(1.1, 0.1, 0.0)),
        "link1",
        point(-20.0, (1.1, 0.1, 0.0)),
    ),
    "wheel imbalance": (
        WheelImbalance(name="i", wheel="wheel2", static=STATIC, phase=PHASE, dynamic=DYNAMIC),
        "wheel2",
        np.array([0, *(STATIC * RADIAL), 0, 0, 0, -DYNAMIC * RADIAL[0], -DYNAMIC * RADIAL[1], 0]),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", list(CASES))
def test_accelerations_with_other_bodies(description: Description, name: str) -> None:
    """At 40 s, random states and inputs; the wheels turn at 50 rad/s."""
    effect, body, theta = CASES[name]
    model, twin, before = build_model(description.with_effects(effect)), twin_with(body, theta), MujocoTwin(N)
    order, worst, change = Ordering(model), 0.0, 0.0
    for state, inputs in random_pairs(30, seed=4):
        vdot = order.back(model.acceleration(40.0, order.q(state), order.v(state), order.tau(inputs)))
        expected = twin.accelerations(state, inputs)
        worst = max(worst, relative(vdot, expected))
        change = max(change, relative(before.accelerations(state, inputs), expected))
    assert worst < 1e-9 and change > 1e-4, (worst, change)


def test_a_flight_that_loses_mass_step_by_step(description: Description) -> None:
    """MuJoCo's base gets lighter in 100 steps of equal loss, velocities going on as they were.

    RK4 at 10 ms; halving the steps of the loss takes the difference from 4e-7 to 1e-7.
    """
    rng = np.random.default_rng(3)
    force = Fourier(0.1, 20 * rng.normal(size=(3, 2)), 20 * rng.normal(size=(3, 2)), np.zeros(3))
    place, rate, step, count = (0.6, -0.5, 0.7), 10.0, 0.1, 100
    model = build_model(description.with_effects(MassLoss(name="l", rate=rate, position=place)))
    order, start = Ordering(model), State.random(rng)
    trajectory = simulate(model, Inputs(force=force), step * count, q0=order.q(start), v0=order.v(start))
    twin, state = MujocoTwin(N), start
    for k in range(count):
        add(twin, "base", point(-rate * step * (0.5 if k == 0 else 1.0), place))  # that of the middle
        drive = Drive(force_body=lambda t, k=k: force(t + k * step))
        state = twin.simulate_state(drive, step, initial=state, dt=step / 10)
    q, v = trajectory.charts[-1].state(step * count)
    found = np.array([*q[:3], *v[:6]])
    twinned = np.array([*state.position, *state.v_b, *state.omega_b])
    assert relative(found, twinned) < 2e-6
    kept = simulate(
        build_model(description), Inputs(force=force), step * count, q0=order.q(start), v0=order.v(start)
    )
    q, v = kept.charts[-1].state(step * count)
    assert relative(np.array([*q[:3], *v[:6]]), twinned) > 1e-3  # 100 kg of 2260 matter


def turned(angles: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Rodrigues' rotation of x by a rotation vector."""
    angle = np.linalg.norm(angles)
    axis = angles / angle
    return x * np.cos(angle) + np.cross(axis, x) * np.sin(angle) + axis * (axis @ x) * (1 - np.cos(angle))


def test_a_flight_with_actuators_that_do_something_else(description: Description) -> None:
    rng = np.random.default_rng(8)

    def series(size: float) -> Fourier:
        return Fourier(0.05, *(size * rng.normal(size=(3, 3)) for _ in range(2)), size * rng.normal(size=3))

    force, wheel, joint = series(20.0), series(0.3), series(3.0)
    gain, angles, late = np.array([0.05, -0.1, 0.2]), np.array([0.02, -0.05, 0.04]), 0.1
    effects = (
        ThrusterGain(name="a", gain=tuple(gain)),
        ThrusterMisalignment(name="b", angles=tuple(angles), start=4.0),
        TorqueGain(name="c", joint="joint2", error=-0.15),
        TorqueGain(name="d", joint="wheel0", error=0.1),
        ActuatorDelay(name="e", actuator="joint3", delay=late),
        ActuatorDelay(name="f", actuator="wheel2", delay=2 * late),
    )

    def thrust(t: float) -> np.ndarray:
        pushed = (1 + gain) * force(t)
        return turned(angles, pushed) if t >= 4.0 else pushed

    def drive_of(signal: Callable[[float], np.ndarray], scale: np.ndarray, delay: np.ndarray) -> Callable:
        def value(t: float) -> np.ndarray:
            return np.array(
                [s * signal(t - d)[k] * (t >= d) for k, (s, d) in enumerate(zip(scale, delay, strict=True))]
            )

        return value

    drive = Drive(
        force_body=thrust,
        wheel_torque=drive_of(wheel, np.array([1.1, 1, 1]), np.array([0, 0, 2 * late])),
        joint_torque=drive_of(joint, np.array([1, 0.85, 1]), np.array([0, 0, late])),
    )
    model = build_model(description.with_effects(*effects))
    order, start = Ordering(model), State(q=np.array([0.4, -0.6, 0.9]))
    inputs = Inputs(force=force, wheel_torque=wheel, joint_torque=joint)
    trajectory = simulate(model, inputs, 8.0, q0=order.q(start), v0=order.v(start))
    end = MujocoTwin(N).simulate_state(drive, 8.0, initial=start, dt=0.01)
    assert relative(order.back(trajectory.states(np.array([8.0])).v[0]), end.velocity) < 1e-7
    plain = simulate(build_model(description), inputs, 8.0, q0=order.q(start), v0=order.v(start))
    assert relative(order.back(plain.states(np.array([8.0])).v[0]), end.velocity) > 1e-2


@pytest.mark.parametrize("frame", ["body", "inertial"])
def test_a_constant_wrench(description: Description, frame: str) -> None:
    force, torque, place = np.array([1.0, -2.0, 3.0]), np.array([0.5, 0.2, -0.4]), np.array([0.3, 1.0, -0.5])
    effect = ExternalWrench(
        name="w", force=tuple(force), torque=tuple(torque), point=tuple(place), frame=frame, start=5.0
    )
    model, twin = build_model(description.with_effects(effect)), MujocoTwin(N)
    order = Ordering(model)
    for state, _ in random_pairs(10, seed=9):
        turn = rotation(state.quaternion).T if frame == "inertial" else np.eye(3)
        pushed = TwinInputs(
            force_body=turn @ force, torque_body=turn @ torque + np.cross(place, turn @ force)
        )
        nothing = np.zeros(model.nv)
        on = model.acceleration(5.0, order.q(state), order.v(state), nothing)
        off = model.acceleration(4.99, order.q(state), order.v(state), nothing)
        assert relative(order.back(on), twin.accelerations(state, pushed)) < 1e-9
        assert relative(order.back(off), twin.accelerations(state, TwinInputs())) < 1e-9


def test_commands_are_recorded_as_commanded(urdf: Path) -> None:
    from smsid.simulate import Constant, truth_of

    description = load_description(urdf / "paper_sms.toml")
    effects = (ThrusterGain(name="a", gain=(0.5, 0.5, 0.5)), TorqueGain(name="b", joint="joint1", error=1.0))
    inputs = Inputs(
        force=Constant(np.array([1.0, 2.0, 3.0])), joint_torque=Constant(np.array([0.1, 0.2, 0.3]))
    )
    trajectory = simulate(build_model(description.with_effects(*effects)), inputs, 1.0)
    truth = truth_of(trajectory, ())(np.array([0.0, 0.5]))
    np.testing.assert_array_equal(truth["command.force"], np.tile([1.0, 2.0, 3.0], (2, 1)))
    np.testing.assert_array_equal(truth["command.joint_torque"], np.tile([0.1, 0.2, 0.3], (2, 1)))
