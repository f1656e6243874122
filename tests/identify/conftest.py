"""Fixtures that several modules of these tests share."""

from __future__ import annotations

import numpy as np
import pytest
from twins.mujoco_twin import Drive, MujocoTwin
from twins.recordings import Q0_ARM
from twins.state import State

from smsid.model import SpacecraftModel, build_model
from smsid.recording import Recording

from .support import from_twin, paper


@pytest.fixture(scope="session")
def model() -> SpacecraftModel:
    """The paper's spacecraft."""
    return build_model(paper())


@pytest.fixture(scope="session")
def twin_flight() -> Recording:
    """40 s in MuJoCo with body rates up to 0.08 rad/s, five times those of the reference recordings."""
    phase = np.random.default_rng(3).uniform(0, 6, (2, 3))
    turn = 2 * np.pi

    def wheels(t: float) -> np.ndarray:
        return 2.0 * np.sin(turn * np.array([0.04, 0.06, 0.05]) * t + phase[0]) * min(t, 1.0)

    def arm(t: float) -> np.ndarray:
        swing = np.sin(turn * np.array([0.1, 0.13, 0.17]) * t + phase[1])
        return np.array([20.0, 25.0, 10.0]) * swing * min(t, 1.0)

    drive, start = Drive(wheel_torque=wheels, joint_torque=arm), State(q=Q0_ARM.copy())
    return from_twin(MujocoTwin().simulate(drive, 40.0, initial=start, dt=1e-2))
