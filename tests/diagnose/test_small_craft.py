"""A light spacecraft turns a lot under its arm: what is integrated coarsely shows as a torque."""

import numpy as np

from smsid.description import load_description
from smsid.diagnose import diagnose
from smsid.experiments import fly, named_experiment
from smsid.model import build_model
from tests.cube_satellite import cube

URDF = """
<robot name="small">
  <link name="bus"><inertial><mass value="60"/>
    <inertia ixx="1.5" iyy="2" izz="1.8" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="boom"><inertial><origin xyz="1 0 0"/><mass value="4"/>
    <inertia ixx="0.02" iyy="1.35" izz="1.35" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="bus"/><child link="boom"/>
    <origin xyz="0 0.6 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="30" velocity="0.3"/></joint>
</robot>
"""
SENSORS = "".join(
    f'[[sensor]]\nname = "{s}"\nkind = "{s}"\npreset = "reference"\n'
    for s in ("pose", "imu", "encoder", "tachometer")
)
TOML = f"""
schema = 1
name = "small"
urdf = "small.urdf"
[[arm]]
name = "boom"
joints = ["shoulder"]
home = {{ shoulder = 0.3 }}
[[wheel]]
name = "wheel_z"
axis = [0.0, 0.0, 1.0]
inertia = 0.05
max_torque = 0.5
[thrust]
point = [0.0, 0.0, 0.0]
max_force = 1.0
[[effect]]
kind = "beam_appendage"
name = "panel"
position = [0.4, 0.0, 0.0]
length = 1.5
width = 0.5
thickness = 0.001
density = 2000.0
youngs_modulus = 2e9
damping = 0.005
modes = 2
stations = [0.75, 1.5]
{SENSORS}
"""


def test_nothing_is_found_where_nothing_is(tmp_path):
    (tmp_path / "small.urdf").write_text(URDF)
    (tmp_path / "small.toml").write_text(TOML)
    description = load_description(tmp_path / "small.toml")
    model = build_model(description)
    plan = named_experiment("exp2", model).model_copy(update={"duration": 80.0})
    recording = fly(model, plan, np.random.default_rng(0)).recording
    assert np.abs(recording["imu.angular_rate"]).max() > 0.2  # [rad/s]
    found = diagnose(description, [recording]).diagnosis
    assert found.verdict == "adequate", found.sentence


def test_what_a_satellite_cannot_show_ends_nothing(tmp_path):
    """Attitude, gyro and wheels about a centre of mass at the origin: a leak there is not seen."""
    description = cube(tmp_path, (0.35, 0.42, 0.29))
    model = build_model(description)
    plan = named_experiment("exp2", model).model_copy(update={"duration": 60.0})
    recording = fly(model, plan, np.random.default_rng(0)).recording
    found = diagnose(description, [recording]).diagnosis
    assert found.verdict == "adequate", found.sentence
    assert not found.notes or all("failed" not in note for note in found.notes)
