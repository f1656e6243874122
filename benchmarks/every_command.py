"""Does every command work on robots as people publish them?

    python benchmarks/every_command.py [--only cube servicer gantry] [--folder FOLDER]

Three crafts, written after public reports: a free-flyer of 8 kg whose wheel's link has no inertia and whose
arm's home is outside its limits; a servicer read from MJCF, with a tank; a bus of xacro with an arm on a
rail, a welded joint and frames without mass. Every command of `smsid` is called in turn on what the ones
before it wrote. A folder is gone on with: commands that ended are not called again.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import os
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from _common import environment, write_result
from every_robot import export_agreement
from typer.testing import CliRunner

from smsid.cli.app import app

SENSORS = """
[[sensor]]
name = "pose"
kind = "pose"
quantities = ["position", "attitude", "velocity"]
rate = 50.0
errors.position = { noise_sigma = 1e-4 }
errors.attitude = { noise_sigma = 1e-5 }
errors.velocity = { noise_sigma = 1e-4 }
[[sensor]]
name = "imu"
kind = "imu"
rate = 50.0
errors.angular_rate = { noise_sigma = 1e-5 }
errors.acceleration = { noise_sigma = 1e-4 }
[[sensor]]
name = "encoder"
kind = "encoder"
rate = 50.0
errors.joint_position = { noise_sigma = 1e-5 }
errors.joint_velocity = { noise_sigma = 1e-4 }
[[sensor]]
name = "tacho"
kind = "tachometer"
rate = 50.0
errors.wheel_rate = { noise_sigma = 0.01 }
"""


def link(name: str, mass: float, moments: tuple[float, float, float], at: str = "0 0 0") -> str:
    ixx, iyy, izz = moments
    return (
        f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/>'
        f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(name: str, kind: str, parent: str, child: str, at: str, axis: str, limits: str = "") -> str:
    limit = f"<limit {limits}/>" if limits else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


CUBE = f"""<?xml version="1.0" encoding="iso-8859-1"?><robot name="cube"><!-- Luftkissentisch, 8 kg -->
{link("body", 7.1, (0.094, 0.09, 0.076), "0.002 0.02 0.1")}<link name="wheel"/><link name="camera"/>
{joint("wheel_joint", "continuous", "body", "wheel", "0.06 0 0.04", "0 0 1")}
{joint("camera_mount", "fixed", "body", "camera", "0.1 0 0.2", "1 0 0")}
{link("upper", 0.4, (0.0004, 0.002, 0.002), "0.09 0 0")}
{link("lower", 0.3, (0.0003, 0.0015, 0.0015), "0.07 0 0.01")}
{joint("shoulder", "revolute", "body", "upper", "0.17 0.09 0.06", "0 0 1",
       'lower="0.3" upper="2.5" effort="2" velocity="3"')}
{joint("elbow", "revolute", "upper", "lower", "0.18 0 0", "0 1 0",
       'lower="-2" upper="1.5" effort="2" velocity="3"')}</robot>"""  # fmt: skip
CUBE_TOML = """schema = 1
name = "craft"
urdf = "robot.urdf"
[thrust]
max_force = 1.0
[[wheel]]
name = "rw"
joint = "wheel_joint"
inertia = 0.002
max_torque = 0.02
max_rate = 400.0
[[arm]]
name = "arm"
"""

SERVICER = """<mujoco model="servicer"><compiler angle="degree"/><worldbody><body name="bus"><freejoint/>
<inertial pos="0.02 0 0.1" mass="180" diaginertia="24 26 21"/>
<body name="boom" pos="0.6 0 0.2"><joint name="yaw" axis="0 0 1" range="-120 120" damping="0.4"/>
<inertial pos="0.4 0 0" mass="9" diaginertia="0.05 0.6 0.6"/>
<body name="tool" pos="0.8 0 0"><joint name="pitch" axis="0 1 0" range="-100 100" damping="0.4"/>
<inertial pos="0.3 0.02 0" mass="6" diaginertia="0.04 0.25 0.25"/></body></body></body></worldbody>
</mujoco>"""
WHEELS = "".join(
    f'[[wheel]]\nname = "w{k}"\naxis = {np.eye(3)[k].tolist()}\ninertia = 0.05\nmax_torque = 0.4\n'
    "max_rate = 300.0\n"
    for k in range(3)
)
SERVICER_TOML = f"""schema = 1
name = "craft"
urdf = "robot.xml"
[thrust]
max_force = 20.0
{WHEELS}
[[effect]]
kind = "slosh"
name = "tank"
position = [0.0, 0.1, -0.3]
mass = 9.0
stiffness = [3.0, 3.0, 3.0]
damping = [0.3, 0.3, 0.3]
[[arm]]
name = "arm"
"""

GANTRY = f"""<robot name="gantry" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="reach" default="0.5"/><xacro:property name="half" value="${{$(arg reach) / 2}}"/>
{link("bus", 60, (5, 6, 5.5), "0 0.02 0.1")}<link name="star_tracker"/>
{joint("st_mount", "fixed", "bus", "star_tracker", "0 0 0.5", "1 0 0")}
{link("carriage", 5, (0.05, 0.06, 0.07))}{link("arm", 4, (0.02, 0.1, 0.1), "${half} 0 0")}
{link("hand", 1.5, (0.004, 0.006, 0.006), "0.05 0.01 0")}
{joint("rail", "prismatic", "bus", "carriage", "0 0 0.4", "1 0 0",
       'lower="-0.3" upper="0.3" effort="40" velocity="0.4"')}
{joint("swing", "revolute", "carriage", "arm", "0 0.1 0.1", "0 0 1",
       'lower="-2" upper="2" effort="20" velocity="1"')}
{joint("wrist", "revolute", "arm", "hand", "$(arg reach) 0 0", "0 1 0",
       'lower="-1" upper="1" effort="5" velocity="1"')}</robot>"""  # fmt: skip
GANTRY_TOML = f"""schema = 1
name = "craft"
urdf = "robot.urdf.xacro"
arguments = {{ reach = "0.6" }}
[thrust]
max_force = 10.0
{WHEELS}
[[arm]]
name = "arm"
fixed = ["wrist"]
"""

CRAFTS = {
    "cube": {"robot.urdf": CUBE, "craft.toml": CUBE_TOML + SENSORS},
    "servicer": {"robot.xml": SERVICER, "craft.toml": SERVICER_TOML + SENSORS},
    "gantry": {"robot.urdf.xacro": GANTRY, "craft.toml": GANTRY_TOML + SENSORS},
}
PLAN = """schema = 1
name = "plan"
description = "craft.toml"
experiments = ["exp1_x"]
runs = 2
seed = 1
method = "paper"
[[truth]]
links = ["*"]
relative = 0.02
"""
COMMANDS = {
    "check": "check craft.toml",
    "show a description": "show craft.toml",
    "regressor": "regressor craft.toml --states 10",
    "simulate exp1": "simulate craft.toml exp1 -o exp1.nc",
    "simulate exp2": "simulate craft.toml exp2 -o exp2.nc",
    "cut": "cut exp2.nc --from 0 --to 20 -o cut.nc",
    "resample": "resample cut.nc --rate 10 -o slow.nc",
    "convert to CSV": "convert exp2.nc -o log.csv",
    "convert to Parquet": "convert exp2.nc -o table.parquet",
    "convert to MCAP": "convert exp2.nc -o bag.mcap",
    "inspect": "inspect log.csv --map draft.toml",
    "import by the draft": "import log.csv --map draft.toml -o drafted.nc",
    "import": "import log.csv --map log.toml -o again.nc",
    "identify": "identify craft.toml exp1.nc exp2.nc -o estimate.json --report report.html",
    "identify what was imported": "identify craft.toml exp1.nc again.nc -o second.json --method paper",
    "show an estimate": "show estimate.json",
    "compare": "compare estimate.json estimate.json -o comparison.json",
    "diagnose": "diagnose craft.toml cut.nc --estimate estimate.json -o diagnosis.json",
    "track": "track craft.toml slow.nc --estimate estimate.json -o track.nc",
    "play": "play slow.nc",
    "stream": "stream craft.toml play.jsonl --estimate estimate.json --begin 5",
    "design": "design craft.toml --for mass --effort 0.02 -o experiment.toml",
    "control": "control craft.toml estimate.json --samples 50 -o controller.json",
    "export": "export craft.toml estimate.json -o out",
    "export a plant": "export craft.toml estimate.json --linear plant.json",
    "export an FMU": "export craft.toml estimate.json --fmu craft.fmu",
    "view": "view craft.toml exp2.nc -o view.html",
    "plot": "plot recording exp2.nc -o figure.png",
    "campaign": "campaign plan.toml -o campaign.jsonl --backend serial",
}
REFUSED = {("cube", "control"): "cannot turn the base about body axis"}
"""What has to be refused, and the words: one wheel holds no attitude."""


def deviations(estimate: Path) -> dict[str, float]:
    """Compare an estimate with what it was described as, which flew: [sigma], and intervals that hold it."""
    rows = [row for row in json.loads(estimate.read_text())["parameters"]
            if row["status"] == "identifiable" and row["nominal"] is not None and row["sigma"]]  # fmt: skip
    z = np.array([(row["value"] - row["nominal"]) / row["sigma"] for row in rows])
    held = [low <= row["nominal"] <= high for row in rows for low, high in [row["interval"]]]
    return {
        "parameters": len(rows),
        "inside 95 %": sum(held),
        "largest [sigma]": float(np.abs(z).max()),
        "rms [sigma]": float(np.sqrt(np.mean(z**2))),
    }


def called(words: str, refused: str = "") -> dict[str, Any]:
    """Call a command in this folder; what it prints is kept where it fails, or refuses with other words."""
    begin, cpu = time.perf_counter(), time.process_time()
    done = CliRunner().invoke(app, words.split())
    if words.startswith("play"):
        Path("play.jsonl").write_text(done.stdout, encoding="utf-8")
    row: dict[str, Any] = {
        "exit code": done.exit_code,
        "seconds": round(time.perf_counter() - begin, 1),
        "CPU [s]": round(time.process_time() - cpu, 1),
    }
    row["said"] = f"{done.output[-1500:]}{done.exception or ''}"
    well = done.exit_code == 0 or (words.startswith("diagnose") and done.exit_code == 3)  # 3: unexplained
    row["well"] = refused in row["said"] and done.exit_code != 0 if refused else well
    if row["well"] and not refused:
        del row["said"]
    return row


def walked(name: str, folder: Path) -> dict[str, Any]:
    """Call every command on one craft; go on with what is in the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in (CRAFTS[name] | {"plan.toml": PLAN}).items():
        (folder / file).write_bytes(text.encode("iso-8859-1"))
    kept = folder / "rows.json"
    rows: dict[str, Any] = json.loads(kept.read_text()) if kept.is_file() else {}
    with contextlib.chdir(folder):
        for what, words in COMMANDS.items():
            if rows.get(what, {}).get("well"):
                continue
            if words.startswith("export") and " -o out" in words:
                shutil.rmtree("out", ignore_errors=True)
            rows[what] = called(words, REFUSED.get((name, what), ""))
            print(f"{name}: {what}: {rows[what]}", flush=True)
            kept.write_text(json.dumps(rows, indent=1))
        agreement = export_agreement(Path("out"), "craft") if Path("out/craft.xml").is_file() else None
        found = deviations(Path("estimate.json")) if Path("estimate.json").is_file() else None
    return {"commands": rows, "exports": agreement, "estimate": found}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="*", choices=list(CRAFTS), help="crafts; default: all")
    parser.add_argument("--folder", type=Path, help="where the files go, to go on later")
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    with tempfile.TemporaryDirectory() as scratch:
        place = arguments.folder or Path(scratch)
        found = {name: walked(name, place / name) for name in arguments.only or CRAFTS}
    failed = {
        f"{name}: {what}": row["said"]
        for name, one in found.items()
        for what, row in one["commands"].items()
        if not row["well"]
    }
    result = {
        "environment": environment("pin", "mujoco", "numpy"),
        "load of the machine": round(os.getloadavg()[0], 1),
        "called": sum(len(one["commands"]) for one in found.values()),
        "failed": failed,
        "crafts": found,
    }
    print(f"{result['called']} called, {len(failed)} failed")
    if arguments.only is None:
        print(write_result("every_command", result))


if __name__ == "__main__":
    main()
