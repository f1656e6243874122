"""A flight under a saved controller: what is recorded is what the controller saw and asked for."""

import json

import numpy as np
import pinocchio as pin
import pytest
import typer
from control_cases import URDF, described, paper
from typer.testing import CliRunner

from smsid.cli.simulate import simulate_command
from smsid.control.closed_loop import Actuators, track
from smsid.control.controller_file import load_controller, save_controller
from smsid.control.design import DesignRequest, design
from smsid.control.pd import MeasuredState
from smsid.control.recorded_flight import fly_controlled
from smsid.control.trajectory import Reference, minimum_jerk
from smsid.description import load_description
from smsid.effects import ActuatorDelay, TorqueGain
from smsid.errors import ControlError
from smsid.experiments import Experiment, StepProfile
from smsid.model import build_model
from smsid.recording import load_recording

RATE = 10.0
STEPS = StepProfile(times=(0.0, 2.0, 4.0), values=((0.5, 0.0, 0.0), (0.0, -0.5, 0.0), (0.0, 0.0, 0.0)))
THRUST = Experiment(name="thrust", duration=6.0, force=STEPS)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("controller") / "controller.json"
    request = DesignRequest(gains=(0.64, 1.6), uncertainty=0.05, rate=RATE)
    save_controller(design(described(), None, request, np.random.default_rng(1)), path)
    return path


def gentle(model):
    home = model.joint_angles(model.home)
    return minimum_jerk(home, home + 0.05, 6.0)


def test_the_rate_is_kept_and_older_files_mean_the_default(saved, tmp_path):
    assert load_controller(saved).rate == RATE
    document = json.loads(saved.read_text())
    del document["rate"]
    (tmp_path / "old.json").write_text(json.dumps(document))
    assert load_controller(tmp_path / "old.json").rate == 100.0


def test_what_is_recorded_is_what_the_controller_read(saved):
    """From the recording alone, noise and all, every torque that was commanded follows once more."""
    model, controller = paper(), load_controller(saved)
    path = gentle(model)
    flown = fly_controlled(model, controller, THRUST, np.random.default_rng(3), path=path)
    recording = flown.flight.recording
    law = controller.controller(model, Reference(path), 1.0 / RATE)
    actuators = Actuators(model, 1.0 / RATE)
    channels = {
        q: recording[c]
        for c in recording.channels
        if (q := c.split(".")[1])
        in ("attitude", "angular_rate", "joint_position", "joint_velocity", "wheel_rate")
    }
    clocks = {c.split(".")[1]: recording.time(c) for c in recording.channels}
    for k in range(60):
        t = k / RATE
        now = {q: values[np.searchsorted(clocks[q], t + 1e-6) - 1] for q, values in channels.items()}
        seen = MeasuredState(
            pin.Quaternion(np.asarray(now["attitude"], dtype=float)).toRotationMatrix(),
            *(now[q] for q in ("angular_rate", "joint_position", "joint_velocity", "wheel_rate")),
        )
        tau = actuators(law.command(t, seen).torques, now["wheel_rate"])
        i = np.searchsorted(clocks["wheel_torque"], t + 1e-6) - 1
        np.testing.assert_allclose(
            recording["command.wheel_torque"][i], tau[model.wheels.v], atol=1e-6, err_msg=str(t)
        )
        np.testing.assert_allclose(recording["command.joint_torque"][i], tau[model.arm_joints.v], atol=1e-6)
    np.testing.assert_allclose(
        recording["command.force"][np.searchsorted(clocks["force"], 3.0 + 1e-6) - 1], [0, -0.5, 0]
    )


def test_without_noise_and_thrust_it_flies_as_the_compiled_flight_does(saved):
    perfect = described()
    perfect = perfect.with_sensors(
        *(s.model_copy(update={"errors": {}, "rate": 20.0}) for s in perfect.sensor)
    )
    model, controller = build_model(perfect), load_controller(saved)
    path = gentle(model)
    rest = Experiment(name="rest", duration=6.0)
    found = fly_controlled(model, controller, rest, np.random.default_rng(1), path=path).tracking
    law = controller.controller(model, Reference(path), 1.0 / RATE)
    want = track(model, law, rate=RATE, dt=0.01, duration=6.0)
    np.testing.assert_allclose(found.v, want.v, atol=1e-9)
    np.testing.assert_allclose(found.wheel_torque, want.wheel_torque, atol=1e-7)


def test_effects_on_actuators_act_on_what_the_controller_asks_for(saved):
    """Late and weak torques: the motion is that of an open loop with the recorded commands."""
    late = ActuatorDelay(name="late", actuator="joint1", delay=0.13)
    weak = TorqueGain(name="weak", joint="wheel_x", error=-0.3)
    effects = (*described().effect, late, weak)
    model, controller = build_model(described(effect=effects)), load_controller(saved)
    path = gentle(model)
    flown = fly_controlled(model, controller, THRUST, np.random.default_rng(3), path=path)
    tracking = flown.tracking
    states = flown.flight.trajectory.states(tracking.time)
    np.testing.assert_allclose(tracking.q, states.q, atol=1e-7)
    np.testing.assert_allclose(tracking.v, states.v, atol=1e-6)
    plain = fly_controlled(paper(), controller, THRUST, np.random.default_rng(3), path=path).tracking
    assert np.abs(tracking.v - plain.v).max() > 1e-4


def test_a_controller_of_another_spacecraft_is_refused(saved):
    model = build_model(load_description(URDF / "two_arm_sms.toml"))
    with pytest.raises(ControlError, match="was designed for"):
        fly_controlled(model, load_controller(saved), THRUST, np.random.default_rng(1))


PUSH = """\
schema = 1
name = "push"
duration = 4.0
[wheel_torque]
kind = "constant"
value = [0.1, 0.0, 0.0]
"""


def test_the_command_flies_it_and_says_what_it_leaves_out(saved, tmp_path):
    app = typer.Typer()
    app.command()(simulate_command)
    made, craft = tmp_path / "made.nc", str(URDF / "paper_sms.toml")
    (tmp_path / "push.toml").write_text(PUSH)
    words = [craft, str(tmp_path / "push.toml"), "--controller", str(saved), "-o", str(made)]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.exception
    assert "largest errors: attitude" in result.output
    assert "wheel_torque of 'push' is left out" in result.output
    recording = load_recording(made)
    assert np.abs(recording["command.wheel_torque"][1:] - [0.1, 0.0, 0.0]).max() > 0.05
    assert recording.provenance["controller"]["rate"] == RATE
    refused = CliRunner().invoke(app, [craft, "trapezoid", "-o", str(tmp_path / "none.nc")])
    assert "--controller" in str(refused.exception) and not (tmp_path / "none.nc").exists()


def test_a_motion_beyond_the_joints_limits_is_refused(saved):
    model = paper()
    home = model.joint_angles(model.home)
    with pytest.raises(ControlError, match="joint"):
        fly_controlled(
            model,
            load_controller(saved),
            THRUST,
            np.random.default_rng(1),
            path=minimum_jerk(home, home + 9.0, 6.0),
        )
