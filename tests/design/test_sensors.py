"""A design plans for the sensors that a craft has: a satellite whose position nothing measures."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.description import load_description
from smsid.design import design_experiment
from smsid.errors import ExperimentError

URDF = """<robot name="sat"><link name="bus"><inertial><origin xyz="{centre}"/><mass value="20"/>
<inertia ixx="0.30" ixy="0.01" ixz="0" iyy="0.36" iyz="0.005" izz="0.33"/></inertial></link></robot>"""
WHEEL = """[[wheel]]
name = "NAME"
axis = AXIS
inertia = 3e-5
max_torque = 0.01
max_rate = 700.0
"""
GYRO = """[[sensor]]
name = "gyro"
kind = "imu"
rate = 5
quantities = ["angular_rate"]
errors.angular_rate = { noise_sigma = 1e-4, bias_sigma = 1e-3 }
"""
TRACKER = """[[sensor]]
name = "st"
kind = "pose"
rate = 5
quantities = ["attitude"]
errors.attitude = { noise_sigma = 5e-5 }
"""
RATES = """[[sensor]]
name = "tach"
kind = "tachometer"
rate = 5
errors.wheel_rate = { noise_sigma = 0.1 }
"""
ABOUT_CENTRE = tuple(f"bus.Ic{x}" for x in ("xx", "xy", "yy", "xz", "yz", "zz"))


@pytest.fixture
def craft(tmp_path):
    def made(*sensors: str, centre: str = "0 0 0", noise: int = 1):
        axes = {"wx": "[1, 0, 0]", "wy": "[0, 1, 0]", "wz": "[0, 0, 1]"}
        wheels = "".join(WHEEL.replace("NAME", name).replace("AXIS", axis) for name, axis in axes.items())
        (tmp_path / "sat.urdf").write_text(URDF.replace("{centre}", centre))
        (tmp_path / "sat.toml").write_text(
            'schema = 1\nname = "sat"\nurdf = "sat.urdf"\n' + wheels + "".join(sensors)
        )
        return load_description(tmp_path / "sat.toml")

    return made


def designed(description):
    return design_experiment(description, ["inertia"], duration=20.0, effort=0.03)


@pytest.mark.parametrize("sensors", [(GYRO, RATES), (TRACKER, RATES), (GYRO, TRACKER, RATES)])
def test_what_shows_turning_tells_inertias_about_the_centre_of_mass(craft, sensors):
    """A free body turns about its centre of mass: where the frame's origin is makes no difference."""
    design, shifted = (designed(craft(*sensors, centre=c)) for c in ("0 0 0", "0.3 -0.2 0.1"))
    assert design.goal.names == shifted.goal.names == ABOUT_CENTRE
    np.testing.assert_allclose(shifted.goal.values, [0.30, 0.01, 0.36, 0.0, 0.005, 0.33], atol=1e-12)
    np.testing.assert_allclose(shifted.sigma, design.sigma, rtol=1e-3)
    assert design.sigma.max() < 0.5 * 0.30  # half of a moment is known beforehand


def test_more_sensors_tell_more(craft):
    alone, both = designed(craft(GYRO, RATES)), designed(craft(GYRO, TRACKER, RATES))
    assert both.sigma.max() < alone.sigma.max()


def test_a_sensor_that_is_missing_is_told_before_the_search(craft):
    with pytest.raises(ExperimentError, match="No tachometer of 'sat' measures wheel_rate of wx, wy, wz"):
        designed(craft(GYRO, TRACKER))
    with pytest.raises(ExperimentError, match="no sensor of its motion"):
        designed(craft(RATES))
