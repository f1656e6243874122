"""Wheels hold the attitude and an arm moves under thrust, all in a closed loop: do intervals hold?"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import chi2

from smsid.estimation._normal_equations import normal_equations
from smsid.estimation.commands_between_samples import as_commands_act, with_timing
from smsid.estimation.flight import flight_of
from smsid.estimation.panels import modal_panels
from smsid.estimation.parameter_vector import Point
from smsid.estimation.unknowns import sensor_unknowns, unknowns_of
from smsid.model import build_model
from smsid.sensing import observe
from smsid.simulate import Inputs, Sampled, simulate, truth_of
from smsid.simulate.fixed_step import simulate_closed_loop
from tests.identify.support import paper

DRAWS, CONTROL_RATE = 3, 100.0
TURNS = 2 * np.pi * np.array([3.0, 4.2, 5.4])  # [rad] of the joints' courses in a flight


def flown(description, seconds):
    """Return a flight under a controller that holds what it asks for until its next sample."""
    model = build_model(description)
    home, arm, wheels = model.joint_angles(model.home), model.arm_joints, model.wheels
    mass = pin.crba(model.pin, model.pin.createData(), model.home)
    mass = np.triu(mass) + np.triu(mass, 1).T

    def controller(t, q, v):
        tau = np.zeros(model.nv)
        burn = int(t // (seconds / 8))
        if burn < 6:
            tau[burn // 2] = 18.0 if burn % 2 == 0 else -18.0
        asked = mass[3:6, 3:6] @ (0.18 * np.sign(q[6]) * q[3:6] + 0.48 * v[3:6])
        tau[wheels.v] = np.clip(asked, -2.0, 2.0)
        begun = 0.3 * (1.0 - np.exp(-t / 5.0))
        off = home + begun * np.sin(TURNS * t / seconds) - q[arm.q]
        late = begun * TURNS / seconds * np.cos(TURNS * t / seconds) - v[arm.v]
        tau[arm.v] = mass[arm.v, arm.v] * (off + 1.6 * late)
        return tau

    step = 1.0 / CONTROL_RATE
    run = simulate_closed_loop(model, controller, seconds, dt=step, control_rate=CONTROL_RATE, audit=False)
    time, tau = run.time, run.tau
    named = {"force": slice(3), "wheel_torque": wheels.v, "joint_torque": arm.v}
    held = {n: Sampled.from_samples(time, tau[:, v], degree=0) for n, v in named.items()}
    return simulate(model, Inputs(**held), seconds)


@pytest.mark.parametrize(("rate", "seconds", "hold"), [(100.0, 20.0, "held"), (10.0, 60.0, "jumps")])
def test_commands_act_as_they_do_and_the_score_at_the_truth_is_that_of_noise(rate, seconds, hold):
    """Where all commands are recorded, lines are wrong, with three times the chi-squared; of every tenth
    they are right. The torques' wide guess alone prefers lines in both.
    """
    description = paper()
    motion = flown(description, seconds)
    point = Point.of(modal_panels(description)[0])
    sensors = [s.model_copy(update={"rate": rate}) for s in description.effective_sensors()]
    exact = ["command.force", "command.wheel_torque", "command.joint_torque"]
    model, total, degrees, timing = motion.model, 0.0, 0.0, None
    for draw in range(DRAWS):
        recording = observe(
            truth_of(motion, sensors),
            sensors,
            start=0.0,
            stop=seconds,
            rng=np.random.default_rng(draw),
            exact=exact,
            rate=rate,
            labels={"wheel": model.wheels.names, "joint": model.arm_joints.names},
            name="loop",
        )
        flight = flight_of(point, recording, "loop")
        present = set(recording.channels)
        unknowns = [*unknowns_of(point, bodies=True, components=True).unknowns]
        unknowns += sensor_unknowns(point.base, description.effective_sensors(), present, "loop", set())
        for at_rest in () if timing else (False, True):
            timing = as_commands_act(point, unknowns, flight, at_rest).problem.timing
            assert (timing.hold, timing.side) == (hold, "right")
        flight = with_timing(flight, timing)
        found = normal_equations(point, unknowns, [flight])
        total += float(found.slope @ np.linalg.solve(found.gram, found.slope))
        degrees += float(np.trace(np.linalg.solve(found.gram, found.information)))
    assert chi2.ppf(0.005, degrees) < total < chi2.ppf(0.995, degrees)
