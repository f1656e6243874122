"""What drives a hidden world: multisine torques and thrust, held between samples, the same for every run.

The joint torques of a free-flyer come from the nominal world under feedback, flown once; afterwards they are
a plain sequence of commands, so that a run's commands do not depend on what it hides or on its noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from .numbers import JOINTS, WHEELS, WORLDS, Numbers

Array = np.ndarray
RATE = 20.0  # [Hz]


@dataclass(frozen=True)
class Commands:
    """Commands held from each sample to the next: `values` (N + 1, columns) at `time` (N + 1,) [s]."""

    time: Array
    values: Array
    columns: tuple[str, ...]

    def columns_of(self, prefix: str) -> list[int]:
        """Indices of the columns called so or beginning with `prefix` and a dot."""
        return [i for i, c in enumerate(self.columns) if c == prefix or c.startswith(f"{prefix}.")]


def column_names(n: Numbers) -> tuple[str, ...]:
    """Names of the commands of a world, in the order of its actuators."""
    thrust = tuple(f"thruster.{a}" for a in "xyz") if n.free else ()
    return (*thrust, *(WHEELS if n.wheel_inertia is not None else ()), *JOINTS)


@dataclass(frozen=True)
class Multisine:
    """Sum of sines with zero start, (columns, harmonics) amplitudes, frequencies [Hz] and phases."""

    amplitude: Array
    frequency: Array
    phase: Array

    @classmethod
    def drawn(
        cls, rng: np.random.Generator, sizes: Array, low: float, high: float, count: int = 6
    ) -> Multisine:
        """Sines spread over a band, each column of rms `sizes` (columns,)."""
        edges = np.geomspace(low, high, count + 1)
        shape = (len(sizes), count)
        frequency = edges[:-1] * (edges[1:] / edges[:-1]) ** rng.uniform(0, 1, shape)
        share = rng.uniform(0.6, 1.4, shape)
        share *= np.sqrt(2) / np.sqrt((share**2).sum(axis=1, keepdims=True))
        return cls(np.asarray(sizes)[:, None] * share, frequency, rng.uniform(0, 2 * np.pi, shape))

    def __call__(self, t: Array, derivative: int = 0) -> Array:
        """Values (N, columns) or their derivative."""
        w = 2 * np.pi * self.frequency
        angle = np.multiply.outer(t, w) + self.phase + derivative * np.pi / 2
        return (self.amplitude * w**derivative * np.sin(angle)).sum(axis=-1)


def smooth_start(t: Array, rise: float = 8.0) -> tuple[Array, Array]:
    """A window that rises from 0 to 1 in `rise` [s], and its derivative, (N, 1)."""
    x = np.clip(t / rise, 0, 1)
    window = x**3 * (10 - 15 * x + 6 * x**2)
    slope = 30 * x**2 * (1 - x) ** 2 / rise
    return window[:, None], slope[:, None]


@cache
def commands(world: str, experiment: int = 0, duration: float = 80.0) -> Commands:
    """The commands of experiment number `experiment` of a world (0: estimation, 1: validation, ...)."""
    n = WORLDS[world]
    rng = np.random.default_rng([7919, sorted(WORLDS).index(world), experiment])
    time = np.arange(round(duration * RATE) + 1) / RATE
    columns = column_names(n)
    values = np.zeros((len(time), len(columns)))
    window, _ = smooth_start(time, 1.0)
    if not n.free:
        design_joints(n, time, values, Multisine.drawn(rng, np.array([0.25, 0.2, 0.25]), 0.03, 0.4))
        values.setflags(write=False)
        return Commands(time, values, columns)
    thrust = Multisine.drawn(rng, np.array([6.0, 6.0, 6.0]), 0.02, 0.3)
    wheels = Multisine.drawn(rng, np.array([0.4, 0.4, 0.4]), 0.02, 0.5)
    arm = Multisine.drawn(rng, np.array([0.35, 0.3, 0.4]), 0.015, 0.15)
    values[:, :3] = window * thrust(time)
    values[:, 3:6] = window * wheels(time)
    design_joints(n, time, values, arm)
    values.setflags(write=False)
    return Commands(time, values, columns)


def design_joints(n: Numbers, time: Array, values: Array, arm: Multisine) -> None:
    """Fill in the joint torques: computed torque along `arm` in the nominal world."""
    from .plant import Plant

    window, slope = smooth_start(time)
    start = np.array(n.start)
    target = start + window * (arm(time) - arm(np.zeros(1)))
    rate = window * arm(time, 1) + slope * (arm(time) - arm(np.zeros(1)))
    plant = Plant(n)
    plant.reset()
    period = float(time[1] - time[0])
    for k in range(len(time)):
        q, v = plant.joints()
        wanted = (rate[min(k + 1, len(time) - 1)] - rate[k]) / period
        wanted = wanted + 1.0 * (target[k] - q) + 1.6 * (rate[k] - v)
        values[k, -3:] = plant.torque_for(wanted, values[k])
        if k + 1 < len(time):
            plant.advance(values[k], period)
