"""A rigid satellite with star tracker, gyro and four wheels in a pyramid; nothing measures where it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from smsid.description import Description, load_description

AXES = np.array([[1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1]]).T / np.sqrt(3.0)
"""Axes of the wheels (3, 4)."""
WHEEL = 3e-5  # [kg m^2] about its axis
SENSORS = """
[[sensor]]
name = "tracker"
kind = "pose"
rate = 5
quantities = ["attitude"]
errors.attitude = { noise_sigma = 5e-5 }
[[sensor]]
name = "gyro"
kind = "imu"
rate = 5
quantities = ["angular_rate"]
errors.angular_rate = { noise_sigma = 1e-4, bias_sigma = 1e-3 }
[[sensor]]
name = "tachometer"
kind = "tachometer"
rate = 5
errors.wheel_rate = { noise_sigma = 0.1 }
"""


def cube(folder: Path, moments: tuple[float, float, float]) -> Description:
    """Return the satellite with moments of inertia about its centre of mass, its origin [kg m^2]."""
    inertia = " ".join(f'{n}="{x}"' for n, x in zip(("ixx", "iyy", "izz"), moments, strict=True))
    (folder / "cube.urdf").write_text(
        '<robot name="cube"><link name="bus"><inertial><mass value="20"/>'
        f'<inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
    )
    wheels = "".join(
        f'[[wheel]]\nname = "w{k}"\naxis = {a.tolist()}\ninertia = {WHEEL}\nmax_torque = 0.01\n'
        for k, a in enumerate(AXES.T)
    )
    text = 'schema = 1\nname = "cube"\nurdf = "cube.urdf"\n' + wheels + SENSORS
    (folder / "cube.toml").write_text(text)
    return load_description(folder / "cube.toml")
