"""A rigid satellite turned by its wheels, in the numpy world."""

import numpy as np

from smsid.recording import Recording
from tests.estimation.satellite import Satellite, guess, recorded

RIGID = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6), centre=(0.0, 0.0, 0.0))
INERTIA = [f"bus.I{a}" for a in ("xx", "xy", "yy", "xz", "yz", "zz")]
STEP = 0.02  # [s] of the world's integration


def wheels(t):
    """Return the torques of the wheels (3,)."""
    return 0.3 * np.sin(2 * np.pi * np.array([0.1, 0.14, 0.18]) * t)


def mean_over_step(t):
    """Return what is held over a step: torques in its middle, straight between samples."""
    k, share = divmod(10.0 * (t + 0.5 * STEP), 1.0)
    wheel = (1.0 - share) * wheels(0.1 * k) + share * wheels(0.1 * (k + 1.0))
    return np.zeros(3), np.zeros(3), wheel


def flight(seconds, seed=1, truth=RIGID, name="flight"):
    """Return a recording of attitude, rates and wheel speeds at 10 Hz, torques as they are at the samples."""
    flown = truth.fly(seconds, mean_over_step, step=STEP)
    found = recorded(RIGID, flown, np.random.default_rng(seed), without=("gyro.acceleration",))
    channels = {c: found[c] for c in found.channels}
    # torques of motors as they are at the samples, jumps of the world's own held steps left out
    body = np.linalg.solve(np.array(truth.inertia), -np.array([wheels(t) for t in found.time()]).T).T
    channels["command.wheel_torque"] = np.array([wheels(t) for t in found.time()]) + truth.wheel * body
    return Recording.from_arrays(found.time(), channels, labels=found.labels, name=name)


def craft(folder, off=0.05):
    """Return a description whose inertia is off."""
    return guess(folder, RIGID, off=off, tank=False, panel=False)


def true_inertia():
    j = np.array(RIGID.inertia)
    return np.array([j[0, 0], j[0, 1], j[1, 1], j[0, 2], j[1, 2], j[2, 2]])
