"""The two ways to a likelihood: batch prediction without process noise, and the filter with next to none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from smsid.estimation.kalman import run_filter
from smsid.estimation.measurements import measurements_of
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Belief, CommandTiming, Problem, ProcessNoise
from smsid.likelihood._switch_times import on_found_times, switch_times, with_switch_times
from smsid.likelihood.fit import minimise
from smsid.likelihood.nuisance_parameters import Nuisance
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import SearchPoint
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import piece_of
from tests.likelihood import twin

BUS_INERTIA, HELD = (4, 6, 9), 1e9  # places of Ixx, Iyy, Izz, and what no thrust turns [kg m^2]
CHANGES = {
    "tank.mass": 0.95,
    "tank.stiffness.x": 1.05,
    "panel.mode1.frequency": 1.0005,
    "panel.mode2.damping": 1.05,
}


@pytest.fixture(scope="module", params=[24.0, 25.0])
def recording(request):
    """Thrust for a third of some seconds, the attitude held, read with noise but no biases: it switches at
    samples, or, of 25 s, between.
    """
    return twin.noisy(twin.exp1((1, 1, 1), request.param), 4, biased=False)


def between(recording) -> bool:
    return recording.time()[-1] == 25.0


def by_batch(recording, changes: dict[str, float]) -> float:
    """Return the sum of squares at some parameters; pose at first and times of switching are estimated."""
    piece, local = piece_of(twin.model(), recording, Nuisance(biases=False), described_noise=True)
    if between(recording):
        piece = with_switch_times(piece)
        local = replace(local, switch=switch_times(piece))
    described = Parameters.of(twin.model())
    at = described.with_scalars({n: described.scalar(n) * x for n, x in changes.items()})
    while True:
        found = minimise(
            [piece], SearchPoint(at, (local,)), Prior(described, None), np.arange(described.size)
        )
        (began,) = found.point.locals
        moved = on_found_times(piece, began)
        if moved is None:
            break
        piece, local = moved, began
    return piece.cost(piece.residuals(at, began, piece.predict(at, began))) + piece.known_cost(began)


def by_filter(recording, changes: dict[str, float]) -> float:
    """Return minus twice the log-likelihood: the first pose is a belief, about as wide as the batch's. A bus
    that no thrust turns stands for an attitude that is held.
    """
    described = Parameters.of(twin.model())
    changed = Point.of(
        described.with_scalars({n: described.scalar(n) * x for n, x in changes.items()}).description()
    )
    model = replace(changed, inertial=dict.fromkeys(BUS_INERTIA, HELD)).model()
    sensors = twin.description().effective_sensors()
    seen = ("pose.position", "pose.velocity", "pose.attitude", "imu.acceleration", "imu.angular_rate")
    kept = recording.without(*(c for c in recording.channels if c.startswith(("encoder.", "tachometer."))))
    data = measurements_of(model, kept, sensors)
    assert {b.channel for b in data.blocks} == {*seen, "panel.acceleration"}
    locked = np.array([*model.arm_joints.v, *model.wheels.v], dtype=int)
    home, sigma = model.home.copy(), np.full(2 * model.nv, 1e-9)
    for i, joint in enumerate(model.arm_joints.q):
        home[joint] = np.asarray(recording["encoder.joint_position"])[:, i].mean()
    home[3:7] = np.asarray(recording["pose.attitude"])[0]
    sigma[:3], sigma[3:6] = 100.0, 1.0
    begin = Belief(home, np.zeros(model.nv), np.diag(sigma**2))
    noise = ProcessNoise(force=1e-9, torque=1e-9, joint=1e-9, wheel=1e-9)
    timing = CommandTiming("held", "right", anywhere=between(recording))
    problem = Problem(kept, data, locked, timing, noise, begin=begin)
    return -2.0 * run_filter(model, problem).log_likelihood


@pytest.mark.parametrize("name", CHANGES)
def test_a_parameter_costs_the_same_either_way(recording, name):
    """Between samples the filter knows of a switch's time to first order about the middle of its interval:
    what a mode does of it, 0.3 samples later, is off by a part of what it costs.
    """
    changed, none = {name: CHANGES[name]}, {"tank.mass": 1.0}
    batch = by_batch(recording, changed) - by_batch(recording, none)
    filtered = by_filter(recording, changed) - by_filter(recording, none)
    assert abs(batch) > 4.0
    assert filtered == pytest.approx(batch, rel=0.05 if between(recording) else 0.01, abs=0.05)
