"""Sound files of every kind that a command reads, small: what `_fuzz` mutates."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path
from typing import Any

import tomli_w

URDF = """<?xml version="1.0"?>
<robot name="small">
 <link name="bus"><inertial><origin xyz="0 0 0.1"/><mass value="100"/>
  <inertia ixx="20" iyy="20" izz="15" ixy="0.5" ixz="0" iyz="0"/></inertial>
  <visual><geometry><box size="1 1 1"/></geometry></visual></link>
 <link name="link1"><inertial><origin xyz="0.5 0 0"/><mass value="5"/>
  <inertia ixx="0.02" iyy="0.4" izz="0.4" ixy="0" ixz="0" iyz="0"/></inertial></link>
 <joint name="joint1" type="revolute"><parent link="bus"/><child link="link1"/><origin xyz="0 0 0.5"/>
  <axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="1" effort="20"/></joint>
</robot>
"""
DESCRIPTION: dict[str, Any] = tomllib.loads("""
schema = 1
name = "small"
urdf = "small.urdf"
[[arm]]
name = "arm"
joints = ["joint1"]
home = { joint1 = 0.3 }
[thrust]
point = [0.0, 0.0, 0.0]
max_force = 20.0
[[wheel]]
name = "wheel_x"
axis = [1.0, 0.0, 0.0]
position = [0.0, 0.0, -0.2]
inertia = 0.05
max_torque = 1.0
max_rate = 400.0
[[wheel]]
name = "wheel_y"
axis = [0.0, 1.0, 0.0]
position = [0.0, 0.0, -0.2]
inertia = 0.05
[[wheel]]
name = "wheel_z"
axis = [0.0, 0.0, 1.0]
position = [0.0, 0.0, -0.2]
inertia = 0.05
[[effect]]
kind = "slosh"
name = "tank"
position = [0.0, 0.0, 0.1]
mass = 5.0
stiffness = [1.0, 1.0, 1.0]
damping = [0.05, 0.05, 0.05]
[[sensor]]
name = "imu"
kind = "imu"
position = [0.1, 0.2, 0.3]
preset = "reference"
[[sensor]]
name = "encoder"
kind = "encoder"
preset = "reference"
""")
EXPERIMENT: dict[str, Any] = {
    "schema": 1,
    "name": "short",
    "duration": 0.4,
    "hold_attitude": False,
    "lock_joints": False,
    "force": {"kind": "steps", "times": [0.0, 0.2], "values": [[5.0, 0.0, 0.0], [0.0, 0.0, 0.0]]},
    "joints": [0.1],
}
MAPPING: dict[str, Any] = {
    "recording": {"name": "r", "role": "estimation"},
    "time": {"column": "t", "unit": "s"},
    "channel": {
        "imu.angular_rate": {"columns": ["wx", "wy", "wz"], "unit": "rad/s", "frame": "body"},
        "encoder.joint_position": {"columns": ["q"], "unit": "rad", "labels": ["joint1"]},
    },
}
PARAMETER: dict[str, Any] = {
    "name": "total.mass",
    "value": 105.0,
    "unit": "kg",
    "sigma": 0.5,
    "status": "identified",
    "source": "r",
    "nominal": 100.0,
}
PLAN: dict[str, Any] = {
    "schema": 1,
    "name": "few",
    "description": "d.toml",
    "experiments": ["s.toml"],
    "runs": 1,
    "seed": 3,
    "method": "paper",
    "truth": [{"parameters": ["tank.mass"], "relative": 0.1}, {"links": ["*"], "relative": 0.02}],
    "noise": {"scale": 1.0, "sensors": {"imu": [0.5, 2.0]}, "known": False},
}


def write_base(folder: Path) -> None:
    """Write sound files of every kind."""
    (folder / "small.urdf").write_text(URDF, encoding="utf-8")
    write_toml(folder / "d.toml", DESCRIPTION)
    write_toml(folder / "s.toml", EXPERIMENT)
    write_toml(folder / "m.toml", MAPPING)
    (folder / "e.json").write_text(json.dumps(estimate()), encoding="utf-8")
    (folder / "l.csv").write_text(log(), encoding="utf-8")
    (folder / "p.jsonl").write_text(samples(), encoding="utf-8")
    write_toml(folder / "c.toml", PLAN)
    write_recording(folder)


def write_recording(folder: Path) -> Path:
    """Write the log as a recording, ``r.nc``."""
    from smsid.recording import import_recording, save_recording

    return save_recording(import_recording(folder / "l.csv", folder / "m.toml", check=False), folder / "r.nc")


def estimate() -> dict[str, Any]:
    """Return the document of a sound estimate."""
    from smsid.identify.estimate import Estimate, classify

    known = (
        classify("total.mass", 105.0, "kg", 0.5, "r", nominal=100.0),
        classify("tank.mass", 5.0, "kg", 0.1, "r", nominal=5.0),
    )
    return json.loads(Estimate("small", "paper", known).to_json())


def log(n: int = 40) -> str:
    """Return a sound log as CSV."""
    rows = [f"{k / 100},{math.sin(k / 9):.6f},0.01,{k / 1e3},{math.cos(k / 20):.6f}" for k in range(n)]
    return "t,wx,wy,wz,q\n" + "\n".join(rows) + "\n"


def samples(n: int = 40) -> str:
    """Return the same log as JSON lines, as ``smsid play`` gives it."""
    lines = []
    for k in range(n):
        lines.append({"time": k / 100, "imu.angular_rate": [round(math.sin(k / 9), 6), 0.01, k / 1e3]})
        lines.append({"time": k / 100, "encoder.joint_position": [math.cos(k / 20)]})
    return "".join(json.dumps(x) + "\n" for x in lines)


def write_toml(path: Path, tables: Any) -> None:
    """Write tables as TOML."""
    path.write_text(tomli_w.dumps(tables), encoding="utf-8")
