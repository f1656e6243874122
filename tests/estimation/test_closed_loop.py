"""Wheels hold the attitude and an arm moves under thrust, all in a closed loop: do intervals hold?"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import chi2

from smsid.estimation.commands_between_samples import as_commands_act, with_timing
from smsid.estimation.flight import flight_of
from smsid.estimation.normal_equations import normal_equations
from smsid.estimation.panels import modal_panels
from smsid.estimation.parameter_vector import Point
from smsid.estimation.unknowns import sensor_unknowns, unknowns_of
from smsid.model import build_model
from smsid.sensing import observe
from smsid.simulate import Inputs, Sampled, simulate, truth_of
from smsid.simulate.fixed_step import simulate_closed_loop
from tests.identify.support import paper

DRAWS, SECONDS, RATE = 3, 60.0, 10.0
TURNS = 2 * np.pi * np.array([0.05, 0.07, 0.09])  # [rad/s] of the joints' courses


def flown(description, control_rate):
    """Return a flight under a controller that holds what it asks for until its next sample."""
    model = build_model(description)
    home, arm, wheels = model.joint_angles(model.home), model.arm_joints, model.wheels
    mass = pin.crba(model.pin, model.pin.createData(), model.home)
    mass = np.triu(mass) + np.triu(mass, 1).T

    def controller(t, q, v):
        tau = np.zeros(model.nv)
        burn = int(t // (SECONDS / 8))
        if burn < 6:
            tau[burn // 2] = 18.0 if burn % 2 == 0 else -18.0
        asked = mass[3:6, 3:6] @ (0.18 * np.sign(q[6]) * q[3:6] + 0.48 * v[3:6])
        tau[wheels.v] = np.clip(asked, -2.0, 2.0)
        begun = 0.3 * (1.0 - np.exp(-t / 5.0))
        off = home + begun * np.sin(TURNS * t) - q[arm.q]
        late = begun * TURNS * np.cos(TURNS * t) - v[arm.v]
        tau[arm.v] = mass[arm.v, arm.v] * (off + 1.6 * late)
        return tau

    step = 1.0 / control_rate
    run = simulate_closed_loop(
        model, controller, SECONDS, dt=min(0.01, step), control_rate=control_rate, audit=False
    )
    every = round(step / (run.time[1] - run.time[0]))
    time, tau = run.time[::every], run.tau[::every]
    named = {"force": slice(3), "wheel_torque": wheels.v, "joint_torque": arm.v}
    held = {n: Sampled.from_samples(time, tau[:, v], degree=0) for n, v in named.items()}
    return simulate(model, Inputs(**held), SECONDS)


@pytest.mark.parametrize(("control_rate", "hold"), [(10.0, "held"), (100.0, "jumps")])
def test_commands_act_as_they_do_and_the_score_at_the_truth_is_that_of_noise(control_rate, hold):
    """The torques' wide guess alone prefers lines where they are held, and chi-squared is twice as large."""
    description = paper()
    motion = flown(description, control_rate)
    point = Point.of(modal_panels(description)[0])
    sensors = [s.model_copy(update={"rate": RATE}) for s in description.effective_sensors()]
    exact = ["command.force", "command.wheel_torque", "command.joint_torque"]
    model, total, degrees, timing = motion.model, 0.0, 0.0, None
    for draw in range(DRAWS):
        recording = observe(
            truth_of(motion, sensors),
            sensors,
            start=0.0,
            stop=SECONDS,
            rng=np.random.default_rng(draw),
            exact=exact,
            rate=RATE,
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
