# /// script
# dependencies = ["smsid[robots,plot]"]
# ///
"""Mount one robot after another of example-robot-data on a 2000 kg bus and let it move in free floating.

Joint torques are small random Fourier series. Nothing pushes the spacecraft from outside, so its momentum
must stay zero: the last but one column says how well it does, relative to the momentum of the moving parts.

python examples/02_mount_any_arm.py [folder [robot ...]]
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import matplotlib
import numpy as np
import pinocchio as pin

from smsid.description import Arm, Description, Mount
from smsid.model import SpacecraftModel, build_model
from smsid.simulate import Fourier, Inputs, simulate

matplotlib.use("Agg")
from matplotlib import pyplot as plt

URDF = Path(__file__).resolve().parent.parent / "urdf"
DURATION = 3.0  # [s]
TRUSTED = ("pr2", "tiago_no_hand")  # their URDFs have links whose inertia no rigid body can have
ROBOTS = (
    "ur3", "ur5", "ur10", "panda", "xarm7", "kinova", "z1", "talos_left_arm", "baxter", "icub_reduced",
    "tiago_no_hand", "tiago_pro", "pr2", "centauro", "talos_reduced", "talos_full_v2",
)  # fmt: skip


def mount(robot: str) -> SpacecraftModel:
    """Return the bus with the robot on its left mount, turned by 0.3 rad about the mount's z axis."""
    arm = Arm(
        name="arm",
        robot=robot,
        mount=Mount(frame="left_base", xyz=(0.0, 0.0, 0.05), rpy=(0.0, 0.0, 0.3)),
        inertias="trusted" if robot in TRUSTED else "checked",
    )
    return build_model(Description(name=robot, urdf="bus.urdf", folder=URDF, arm=(arm,)))


def joint_inertia(model: SpacecraftModel) -> np.ndarray:
    """Return the inertia the joint torques of the free-floating spacecraft feel at home, (joints, joints)."""
    mass = pin.crba(model.pin, model.data, model.home)
    mass = np.triu(mass) + np.triu(mass, 1).T
    joints, base = model.arm_joints.v, np.arange(6)
    coupling = mass[np.ix_(base, joints)]
    return mass[np.ix_(joints, joints)] - coupling.T @ np.linalg.solve(mass[:6, :6], coupling)


def random_torques(model: SpacecraftModel, rng: np.random.Generator, size: float = 0.1) -> Fourier:
    """Return joint torques [N m] whose joint accelerations at home are of ``size`` [rad/s^2 | m/s^2]."""
    n = len(model.arm_joints)
    acceleration = Fourier(
        0.5, size * rng.standard_normal((n, 3)), size * rng.standard_normal((n, 3)), np.zeros(n)
    )
    return acceleration.mapped(joint_inertia(model))


def draw(drifts: dict[str, float], file: Path) -> None:
    """Draw how well momentum was kept, robot by robot."""
    figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
    axes.bar(list(drifts), list(drifts.values()), color="tab:blue")
    axes.set_yscale("log")
    axes.set_ylabel("momentum drift over momentum of the parts")
    axes.tick_params(axis="x", rotation=60)
    figure.savefig(file, dpi=120)


def main(folder: Path, robots: tuple[str, ...] = ROBOTS) -> None:
    """Print a line per robot, and draw the drifts."""
    print(
        f"{'robot':20s} {'joints':>6s} {'mass [kg]':>10s} {'momentum drift':>15s} {'s per simulated s':>18s}"
    )
    drifts = {}
    for robot in robots:
        model = mount(robot)
        torque = random_torques(model, np.random.default_rng(0))
        start = time.perf_counter()
        trajectory = simulate(model, Inputs(joint_torque=torque), DURATION)
        seconds = (time.perf_counter() - start) / DURATION
        audit = trajectory.audit()
        drifts[robot] = audit.momentum_drift / audit.momentum_scale
        joints = len(model.arm_joints)
        print(f"{robot:20s} {joints:6d} {model.mass:10.2f} {drifts[robot]:15.1e} {seconds:18.4f}")
    draw(drifts, folder / "momentum.png")


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    target.mkdir(parents=True, exist_ok=True)
    main(target, tuple(sys.argv[2:]) or ROBOTS)
