from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from smsid.description import Description, load_description
from smsid.model.build import build_model
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate import Fourier, Inputs, Trajectory, simulate

URDF = Path(__file__).parents[2] / "urdf"


def torques(size: int, amplitude: float) -> Fourier:
    harmonics = np.linspace(1.0, 0.4, 2 * size).reshape(size, 2)
    return Fourier(1 / 20, amplitude * harmonics, -amplitude * harmonics[:, ::-1], np.zeros(size))


def moving(model: SpacecraftModel, duration: float = 6.0) -> Trajectory:
    """A free-floating motion of everything that can move."""
    drive = Inputs(
        joint_torque=torques(len(model.arm_joints), 6.0),
        wheel_torque=torques(len(model.wheels), 1.0),
        force=Fourier(1 / 6, np.full((3, 1), 12.0), np.diag([8.0, -8.0, 4.0])[:, :1], np.zeros(3)),
    )
    return simulate(model, drive, duration)


@pytest.fixture(scope="session")
def description() -> Description:
    return load_description(URDF / "paper_sms.toml")


@pytest.fixture(scope="session")
def model(description: Description) -> SpacecraftModel:
    return build_model(description)


@pytest.fixture(scope="session")
def trajectory(model: SpacecraftModel) -> Trajectory:
    return moving(model)
