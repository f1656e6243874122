"""Cases that the twins' own tests and the tests of the model share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .numbers import LINKS, PAPER
from .state import Inputs, State

# Nothing symmetric, nothing zero: finds exchanged axes that Table 1 hides (Iyy = Izz, mount along body axes).
SKEWED = replace(
    PAPER,
    base_inertia=(1500.0, 1320.0, 1710.0, 35.0, -52.0, 18.0),
    wheel_inertia=(0.159, 0.21, 0.33),
    arm_mount=(-0.8, 1.1, 0.9),
    arm_rpy=(0.3, -0.5, 1.1),
    links=(
        replace(LINKS[0], centre=(0.02, -0.05, 0.25), inertia=(0.21, 0.25, 0.11, 0.01, 0.02, -0.015)),
        replace(LINKS[1], centre=(1.0, 0.1, -0.05), inertia=(1.05, 16.69, 16.1, 0.3, -0.2, 0.1)),
        replace(
            LINKS[2],
            tip=(1.8, 0.1, 0.2),
            centre=(0.9, -0.1, 0.07),
            inertia=(2.05, 15.0, 16.69, -0.4, 0.3, 0.2),
        ),
    ),
    slosh_stiffness=(0.41, 0.5, 0.33),
    slosh_damping=(0.02, 0.03, 0.01),
    panel_root=(1.5, 0.2, -0.3),
)


def relative(a: np.ndarray | float, b: np.ndarray | float) -> float:
    """Largest difference relative to the largest entry of b."""
    return float(np.abs(np.subtract(a, b)).max() / np.abs(b).max())


def random_pairs(count: int, seed: int = 7) -> list[tuple[State, Inputs]]:
    """`count` random states, each with random inputs."""
    rng = np.random.default_rng(seed)
    return [(State.random(rng), Inputs.random(rng)) for _ in range(count)]
