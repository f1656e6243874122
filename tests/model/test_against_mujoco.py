"""The model and its simulation against a MuJoCo twin built from plain numbers.

MuJoCo is a different algorithm, a different engine and other people's code; the twin is in `tests/twins`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from twins.cases import SKEWED, random_pairs, relative
from twins.description import Ordering, write_description
from twins.mujoco_twin import Drive, MujocoTwin
from twins.numbers import PAPER, Spacecraft
from twins.recordings import Q0_ARM, exp1
from twins.state import State

from smsid.description import load_description
from smsid.model import SpacecraftModel, build_model
from smsid.simulate import Fourier, Inputs, PiecewiseConstant, simulate, truth_of

Case = tuple[SpacecraftModel, Spacecraft]
URDF = Path(__file__).parents[2] / "urdf"

# channel of the model's truth -> channel of the twin
CHANNELS = {
    "pose.position": "base_pos_P",
    "pose.velocity": "base_vel_P",
    "imu.angular_rate": "omega_body",
    "imu.acceleration": "acc_imu_body",
    "encoder.joint_position": "q",
    "encoder.joint_velocity": "qd",
    "tachometer.wheel_rate": "rw_rate",
    "panel.acceleration": "panel_acc_base",
    "truth.slosh_position": "truth_slosh",
    "truth.slosh_velocity": "truth_slosh_vel",
    "truth.modal_position": "truth_panel_modal",
    "truth.modal_velocity": "truth_panel_modal_vel",
}


@pytest.fixture(scope="module", params=["paper_sms", "skewed"])
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    """The description in `urdf/`, and one with nothing symmetric written from the twins' numbers."""
    if request.param == "paper_sms":
        return build_model(load_description(URDF / "paper_sms.toml")), PAPER
    folder = tmp_path_factory.mktemp("skewed")
    return build_model(load_description(write_description(SKEWED, folder))), SKEWED


def test_accelerations_at_random_states(case: Case):
    """200 states, relative to the largest acceleration: nothing but round-off sets the two apart."""
    model, numbers = case
    twin, order = MujocoTwin(numbers), Ordering(model)
    worst = 0.0
    for state, inputs in random_pairs(200, seed=11):
        vdot = order.back(model.acceleration(0.0, order.q(state), order.v(state), order.tau(inputs)))
        worst = max(worst, relative(vdot, twin.accelerations(state, inputs)))
    assert worst < 1e-9, worst


def test_momentum_and_energy_at_random_states(case: Case):
    model, numbers = case
    twin, order = MujocoTwin(numbers), Ordering(model)
    for state, _ in random_pairs(50, seed=12):
        q, v = order.q(state), order.v(state)
        p, h = (state.attitude @ x for x in twin.momentum(state, "inertial"))
        found = model.momentum(q, v)
        assert max(relative(found[:3], p), relative(found[3:], h)) < 1e-12
        assert relative(model.energy(q, v), twin.energy(state)) < 1e-12


def compare(model: SpacecraftModel, trajectory, channels: dict[str, np.ndarray]) -> dict[str, float]:
    """Largest difference of every channel relative to the twin's largest value."""
    truth = truth_of(trajectory, model.description.sensor)(channels["t"])
    assert set(CHANNELS) <= set(truth)
    errors = {ours: np.abs(truth[ours] - channels[theirs]).max() for ours, theirs in CHANNELS.items()}
    return {ours: e / max(np.abs(channels[CHANNELS[ours]]).max(), 1e-9) for ours, e in errors.items()}


def test_free_floating_experiment():
    """Exp. 2: 80 s of Fourier torques on wheels and arm, all channels, measured and hidden.

    MuJoCo integrates with RK4 at 10 ms (half of that changes the body rate by 6e-11, others by 1e-8 at
    most), the model adaptively at 1e-9.
    """
    model = build_model(load_description(URDF / "paper_sms.toml"))
    rng = np.random.default_rng(5)

    def series(size: float) -> Fourier:
        return Fourier(1 / 40, *(size * rng.standard_normal((3, 5)) for _ in range(2)), np.zeros(3))

    wheels, arm = series(0.3), series(1.0)
    trajectory = simulate(model, Inputs(wheel_torque=wheels, joint_torque=arm), 80.0)
    drive = Drive(wheel_torque=wheels, joint_torque=arm)
    channels = MujocoTwin().simulate(drive, 80.0, initial=State(q=Q0_ARM), dt=1e-2, rate=20.0)
    errors = compare(model, trajectory, channels)
    assert max(errors.values()) < 1e-6, errors


def test_thrust_experiment():
    """Exp. 1: thrust (48) along z, attitude held, arm and wheels locked; also the holding torque.

    RK4 at 10 ms leaves 3e-7 on the panel's acceleration: mode 3 at 5 rad/s, stepped at 0, 20 and 40 s.
    """
    model = build_model(load_description(URDF / "paper_sms.toml"))
    force = PiecewiseConstant((0.0, 20.0, 40.0), np.array([[0, 0, 40.0], [0, 0, -40.0], [0, 0, 0.0]]))
    inputs = Inputs(force=force, hold_attitude=True, lock_joints=True, lock_wheels=True)
    trajectory = simulate(model, inputs, 70.0)
    drive, start = exp1((0, 0, 1))
    channels = MujocoTwin().simulate(drive, 70.0, initial=start, hold=True, dt=1e-2, rate=20.0)
    errors = compare(model, trajectory, channels)
    assert max(errors.values()) < 1e-6, errors
    held = truth_of(trajectory, ())(channels["t"])["command.torque"]
    assert relative(held, channels["tau_hold"]) < 1e-6
