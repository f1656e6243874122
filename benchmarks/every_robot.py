"""Does every robot of example-robot-data load, fly, and leave as a model that moves alike elsewhere?

    python benchmarks/every_robot.py [--only ur5 panda]

Each robot is mounted on the bundled bus, inertias as they are; joints that move no mass are welded and named.
It flies 0.1 s from joint rates of 0.1, is exported, and the exported URDF (in Pinocchio) and MJCF (in MuJoCo)
are compared at random states: total mass, and accelerations under the same forces.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from _common import ROOT, environment, write_result

from smsid.description import Arm, Description, Mount, load_description
from smsid.description.robots import robot_files
from smsid.errors import DescriptionError, SmsidError
from smsid.export import export_folder
from smsid.export.regressor_check import mujoco_torques
from smsid.model import SpacecraftModel, build_model
from smsid.simulate import Inputs, Tolerance, simulate

SEED = 5
STATES = 10
FLOWN = 0.1  # [s]
ROUGH = Tolerance(1e-5, 1e-7)


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
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        export_folder(model.description, out)
        agreement = export_agreement(out, model.description.name)
    return {
        "joints": len(model.arm_joints),
        "welded": welded,
        "steps": flown.steps,
        **agreement,
        "seconds": time.perf_counter() - started,
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
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    found: dict[str, Any] = {}
    refused: dict[str, str] = {}
    files = robot_files()
    for name in arguments.only or sorted(files):
        try:
            found[name] = judged(name)
            print(f"{name}: {found[name]}", flush=True)
        except SmsidError as error:
            refused[name] = str(error).replace(f"{files[name].parent}/", "")
            print(f"{name}: refused: {refused[name]}", flush=True)
    worst = {
        key: max((r[key] for r in found.values()), default=float("nan"))
        for key in ("mass_difference", "acceleration_difference")
    }
    result = {
        "environment": environment("pin", "mujoco", "example-robot-data"),
        "seed": SEED,
        "states": STATES,
        "flown": len(found),
        "refused": refused,
        "worst": worst,
        "robots": found,
    }
    if arguments.only is None:
        print(write_result("every_robot", result))


if __name__ == "__main__":
    main()
