"""Is every robot of example-robot-data flown, identified, viewed, and exported as a model that moves alike?

    python benchmarks/every_robot.py [--only ur5 panda] [--fresh]

Each robot is mounted on the bundled bus, inertias as they are; joints that move no mass are welded and named.
It flies 0.1 s from joint rates of 0.1, is shown on a page with its meshes, is exported, and the exported URDF
(in Pinocchio) and MJCF (in MuJoCo) are compared at random states: total mass, and accelerations under the
same forces.

Then it stands on the ground, and what its joints' torques tell is identified from 10 s at 50 Hz (three sines
a joint within its limits, torques with noise of 0.1 %, angles of 1e-6 rad): how many combinations, how many
95 % intervals hold the true value. Leaders of other joints are held, as the refusal advises. Rows are kept in
``build/``, so that it can be stopped.
"""

from __future__ import annotations

import argparse
import json
import logging
import tempfile
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from _common import ROOT, environment, write_result

from smsid.arm import identify_arm
from smsid.arm.identify import rigid_arm
from smsid.arm.setup import arm_description
from smsid.description import Arm, Description, Mount, load_description
from smsid.description.robots import robot_files
from smsid.errors import DescriptionError, SmsidError
from smsid.export import export_folder
from smsid.export.regressor_check import mujoco_torques
from smsid.model import SpacecraftModel, build_model
from smsid.recording import Recording
from smsid.simulate import Inputs, Tolerance, simulate
from smsid.view._export import export_html
from smsid.view._scene import build_scene

SEED = 5
STATES = 10
FLOWN = 0.1  # [s]
ROUGH = Tolerance(1e-5, 1e-7)
TORQUE_NOISE, ANGLE_NOISE = 1e-3, 1e-6  # of the root mean square of a joint's torque; [rad | m]


def mounted(name: str) -> tuple[SpacecraftModel, list[str]]:
    """Return the robot on the bundled bus, and its joints that were welded: they move nothing."""
    fixed: list[str] = []
    while True:
        arm = Arm(
            name="robot",
            robot=name,
            mount=Mount(frame="left_base"),
            inertias="trusted",
            fixed=tuple(fixed),
        )
        described = Description(
            name="craft",
            urdf="bus.urdf",
            folder=ROOT / "urdf",
            meshes="ignored",
            inertias="trusted",
            arm=(arm,),
        )
        try:
            return build_model(described), fixed
        except DescriptionError as error:
            joint = str(error.evidence.get("joint", "")).removeprefix("robot/")
            if "takes no inertia" not in error.message or joint in fixed:
                raise
            fixed.append(joint)


def judged(name: str) -> dict[str, Any]:
    """Return what became of one robot."""
    started = time.perf_counter()
    model, welded = mounted(name)
    v0 = np.zeros(model.nv)
    v0[6:] = 0.1
    flown = simulate(model, Inputs(), FLOWN, v0=v0, tolerance=ROUGH)
    row: dict[str, Any] = {"joints": len(model.arm_joints), "welded": welded, "steps": flown.steps}
    with tempfile.TemporaryDirectory() as folder:
        try:
            shown = build_model(model.description.model_copy(update={"meshes": "required"}))
        except DescriptionError as error:
            row["without meshes"] = str(error).replace(f"{robot_files()[name].parent}/", "")
            shown = model
        page = export_html(build_scene(shown), Path(folder) / "page.html")
        row["page [kB]"] = page.stat().st_size // 1000
        out = Path(folder) / "out"
        try:
            export_folder(model.description, out)
            row |= export_agreement(out, model.description.name)
        except SmsidError as error:
            row["MuJoCo refused"] = str(error)
            export_folder(model.description, out, mujoco=False)  # as the refusal advises
            again = build_model(load_description(out / f"{model.description.name}.toml"))
            row["mass_difference"] = abs(again.mass - model.mass) / model.mass
    try:
        row["identified"] = identified(name)
    except SmsidError as error:
        row["identified"] = {"refused": str(error)}
    return row | {"seconds": round(time.perf_counter() - started, 2)}


def identified(name: str) -> dict[str, Any]:
    """Return what the torques of a robot's joints on the ground tell, against what it was described as."""
    described = arm_description(robot=name)
    model = rigid_arm(described)
    held = dict.fromkeys(model.followers.leaders, 0.0) if model.followers is not None else {}
    model = rigid_arm(described, held)
    p, rng = model.pin, np.random.default_rng(SEED)
    t = np.arange(0.0, 10.0, 0.02)
    angle, rate, change = np.zeros((3, t.size, p.nv))
    for joint in p.joints[1:]:
        if joint.nv != 1:
            raise DescriptionError(f"A {joint.shortname()} is no joint of an arm.", advice="Weld it.")
        low, high = -1.0, 1.0
        if joint.nq == 1 and p.lowerPositionLimit[joint.idx_q] < p.upperPositionLimit[joint.idx_q]:
            low = max(float(p.lowerPositionLimit[joint.idx_q]), -4.0)
            high = min(float(p.upperPositionLimit[joint.idx_q]), 4.0)
        k = joint.idx_v
        angle[:, k] = 0.5 * (low + high)
        for w, phase in zip(2.0 * np.pi * rng.uniform(0.2, 1.0, 3), rng.uniform(0.0, 6.0, 3), strict=True):
            size = min(0.5 * (high - low), 0.8) / 3.0
            angle[:, k] += size * np.sin(w * t + phase)
            rate[:, k] += size * w * np.cos(w * t + phase)
            change[:, k] -= size * w**2 * np.sin(w * t + phase)
    q = np.array([pin.integrate(p, pin.neutral(p), a) for a in angle])
    torque = np.array([pin.rnea(p, model.data, *x) for x in zip(q, rate, change, strict=True)])
    torque += TORQUE_NOISE * np.sqrt(np.mean(torque**2, axis=0)) * rng.normal(size=torque.shape)
    channels = {
        "encoder.joint_position": angle + ANGLE_NOISE * rng.normal(size=angle.shape),
        "drive.joint_torque": torque,
    }
    labels = {"joint": list(p.names)[1:]}
    recording = Recording.from_arrays(t, channels, labels=labels, role="estimation", name="ground")
    begun = time.process_time()
    found = identify_arm(described, recording, hold=held).estimate
    rows = [x for x in found.parameters if x.status == "identifiable" and x.nominal is not None]
    z = np.array([(x.value - x.nominal) / x.sigma for x in rows])
    return {
        "held": sorted(held),
        "combinations": len(found.parameters),
        "identifiable": len(rows),
        "inside 95 %": sum(x.interval[0] <= x.nominal <= x.interval[1] for x in rows),
        "rms [sigma]": float(np.sqrt(np.mean(z**2))) if rows else None,
        "CPU [s]": round(time.process_time() - begun, 1),
    }


def export_agreement(folder: Path, name: str) -> dict[str, float]:
    """Compare an exported TOML with its URDF (in Pinocchio) with the MJCF beside it (in MuJoCo).

    Returns the largest differences of mass and accelerations, relative to the largest of either.
    """
    again = build_model(load_description(folder / f"{name}.toml"))
    xml = (folder / f"{name}.xml").read_text(encoding="utf-8")
    rng = np.random.default_rng(SEED)
    rest = pin.neutral(again.pin)
    q = np.array([pin.integrate(again.pin, rest, rng.uniform(-1, 1, again.nv)) for _ in range(STATES)])
    v, a = rng.normal(size=(2, STATES, again.nv))
    tau = mujoco_torques(again, xml, q, v, a)
    found = np.array([pin.aba(again.pin, again.data, *x) for x in zip(q, v, tau, strict=True)])
    mass = float(mujoco.MjModel.from_xml_string(xml).body_mass.sum())
    return {
        "mass_difference": abs(mass - again.mass) / again.mass,
        "acceleration_difference": float(np.abs(found - a).max() / np.abs(a).max()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="*", help="names of robots; default: all")
    parser.add_argument("--fresh", action="store_true", help="forget the rows that are kept")
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    kept = ROOT / "build" / "every_robot.jsonl"
    kept.parent.mkdir(exist_ok=True)
    if arguments.fresh:
        kept.unlink(missing_ok=True)
    rows = dict(map(json.loads, kept.read_text(encoding="utf-8").splitlines())) if kept.is_file() else {}
    files = robot_files()
    for name in arguments.only or sorted(files):
        if name in rows:
            continue
        try:
            rows[name] = judged(name)
        except SmsidError as error:
            rows[name] = {"refused": str(error).replace(f"{files[name].parent}/", "")}
        print(f"{name}: {rows[name]}", flush=True)
        with kept.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps([name, rows[name]]) + "\n")
    if arguments.only is None:
        print(write_result("every_robot", summary(rows)))


def summary(rows: dict[str, Any]) -> dict[str, Any]:
    """Return the document of the result."""
    found = {name: row for name, row in sorted(rows.items()) if "refused" not in row}
    told = [r["identified"] for r in found.values() if "refused" not in r["identified"]]
    return {
        "environment": environment("pin", "mujoco", "example-robot-data"),
        "seed": SEED,
        "states": STATES,
        "not run": sorted(set(robot_files()) - set(rows)),
        "flown": len(found),
        "refused": {name: row["refused"] for name, row in sorted(rows.items()) if "refused" in row},
        "viewed": sum("page [kB]" in r for r in found.values()),
        "viewed without meshes": {n: r["without meshes"] for n, r in found.items() if "without meshes" in r},
        "exported to MuJoCo": sum("MuJoCo refused" not in r for r in found.values()),
        "MuJoCo refused": {n: r["MuJoCo refused"] for n, r in found.items() if "MuJoCo refused" in r},
        "worst": {
            key: max((r[key] for r in found.values() if key in r), default=float("nan"))
            for key in ("mass_difference", "acceleration_difference")
        },
        "identified": len(told),
        "identification refused": {
            n: r["identified"]["refused"] for n, r in found.items() if "refused" in r["identified"]
        },
        "identifiable": sum(r["identifiable"] for r in told),
        "inside 95 %": sum(r["inside 95 %"] for r in told),
        "robots": found,
    }


if __name__ == "__main__":
    main()
