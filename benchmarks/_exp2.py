"""The Exp. 2 case of the speed benchmark: the paper spacecraft under Fourier torques on wheels and arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from smsid.description.files import load_description
from smsid.model.build import build_model
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate import Fourier, Inputs

DURATION = 80.0  # [s]
RATE = 100.0  # [Hz]
FREQUENCY = 1 / 40  # [Hz]
URDF = Path(__file__).resolve().parent.parent / "urdf"

# cos and sin coefficients of harmonics 1 to 5, one row per axis [N m]: the series of the reference recording
# of Exp. 2, rounded. Peaks: wheels 0.74, 1.37, 1.12 N m; joints 30.6, 21.6, 5.0 N m.
WHEEL_COS = [
    [0.2167, -0.0563, -0.1796, 0.0930, 0.1732],
    [0.1026, 0.0731, 0.3243, -0.3792, -0.1953],
    [0.2974, 0.1764, 0.1347, 0.0862, 0.2051],
]
WHEEL_SIN = [
    [-0.0725, 0.1315, 0.2518, -0.0500, -0.1965],
    [-0.2474, -0.5118, 0.0373, 0.1558, -0.2181],
    [-0.2859, 0.1318, 0.1294, -0.3795, 0.0745],
]
JOINT_COS = [
    [1.2309, -4.2414, -6.5054, 5.0738, 5.9987],
    [1.0779, -1.1264, -0.4638, -3.6429, 14.7415],
    [0.3731, -0.7229, -0.2492, -1.4449, 1.8751],
]
JOINT_SIN = [
    [-0.9939, -4.3173, 5.3775, 6.1946, -4.5277],
    [3.0639, -2.1717, -0.8646, -1.1323, -5.2294],
    [0.8715, -0.9298, 0.1934, -1.6903, 0.0866],
]


def paper_model() -> SpacecraftModel:
    """Return the paper's spacecraft: 3 wheels, 3 joints, slosh, three panel modes (18 degrees of freedom)."""
    return build_model(load_description(URDF / "paper_sms.toml"))


def smooth_inputs() -> Inputs:
    """Return the Fourier torques."""
    return Inputs(
        wheel_torque=Fourier(FREQUENCY, np.array(WHEEL_COS), np.array(WHEEL_SIN), np.zeros(3)),
        joint_torque=Fourier(FREQUENCY, np.array(JOINT_COS), np.array(JOINT_SIN), np.zeros(3)),
    )


def moving_start(model: SpacecraftModel) -> np.ndarray:
    """Return velocities (nv,) for the free motion: everything moves."""
    v = np.zeros(model.nv)
    v[0:6] = 0.02, -0.01, 0.015, 0.02, -0.03, 0.025  # [m/s, rad/s]
    v[model.wheels.v] = 20.0, -30.0, 15.0  # [rad/s]
    v[model.arm_joints.v] = 0.03, -0.02, 0.04  # [rad/s]
    v[model.slosh[0].v] = 0.01, 0.02, -0.01  # [m/s]
    v[model.modes.v] = 0.02, -0.01, 0.005  # [m/s]
    return v
