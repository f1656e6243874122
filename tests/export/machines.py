"""Descriptions to export, and states of their models in MuJoCo's order."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin

from smsid.description import Arm, Description, Mount, load_description
from smsid.effects import JointFriction, MotorInertia, TorqueOffset
from smsid.model import SpacecraftModel

URDF = Path(__file__).parents[2] / "urdf"


def welded_arm() -> Description:
    """The paper's arm on the ground: gravity, viscous friction, rotors and a torque offset."""
    return Description(
        name="bench", urdf="arm3.urdf", root="fixed", gravity=(0.0, 1.0, -9.7), folder=URDF,
        effect=(
            JointFriction(name="friction", joint="joint2", viscous=1.3),
            MotorInertia(name="rotor", joint="joint1", inertia=0.8),
            TorqueOffset(name="bias", joint="joint3", torque=0.7),
        ),
    )  # fmt: skip


def mixed() -> Description:
    """A bus that carries an arm and, on that arm's tool, another."""
    return Description(
        name="mixed", urdf="paper_sms.urdf", folder=URDF,
        arm=(
            Arm(name="own", joints=("joint1", "joint2", "joint3")),
            Arm(name="second", urdf="arm3.urdf", mount=Mount(frame="tool", rpy=(0.3, 0.0, 0.1))),
        ),
    )  # fmt: skip


MACHINES = {
    "paper_sms": lambda: load_description(URDF / "paper_sms.toml"),
    "two_arm_sms": lambda: load_description(URDF / "two_arm_sms.toml"),
    "mixed": mixed,
    "bench": welded_arm,
}


def random_state(model: SpacecraftModel, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Angles within limits, modest slosh and bending; any attitude."""
    q, v = model.home.copy(), rng.normal(size=model.nv)
    q = model.set_joint_angles(q, rng.uniform(-3.0, 3.0, len(model.arm_joints)))
    for j in range(1, model.pin.njoints):
        joint = model.pin.joints[j]
        at = slice(joint.idx_q, joint.idx_q + joint.nq)
        if joint.nq == 7:
            turn = pin.Quaternion(*rng.normal(size=4)).normalized()
            q[at] = np.concatenate([rng.normal(size=3), turn.coeffs()])
        elif j not in model.arm_joints.joints:
            q[at] = 0.3 * rng.normal(size=joint.nq)
    return q, v


def to_mujoco(
    model: SpacecraftModel, mj: mujoco.MjModel, q: np.ndarray, v: np.ndarray, a: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return qpos and qvel of a state; with ``a`` = vdot, qpos and qacc instead. Joints go by name."""
    qpos, out = np.zeros(mj.nq), np.zeros(mj.nv)
    for j in range(1, model.pin.njoints):
        joint, name = model.pin.joints[j], model.pin.names[j]
        rates = (v if a is None else a)[joint.idx_v : joint.idx_v + joint.nv]
        at = q[joint.idx_q : joint.idx_q + joint.nq]
        names = [name] if joint.nv in (1, 6) else [f"{name}.{x}" for x in "xyz"]
        first = mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_JOINT, names[0])
        k, d = mj.jnt_qposadr[first], mj.jnt_dofadr[first]
        if joint.nq == 7:
            turn = pin.Quaternion(*at[[6, 3, 4, 5]]).toRotationMatrix()
            qpos[k : k + 7] = *at[:3], at[6], *at[3:6]
            linear = rates[:3] if a is None else rates[:3] + np.cross(v[3:6], v[:3])
            out[d : d + 6] = np.concatenate([turn @ linear, rates[3:6]])
        else:
            qpos[k : k + joint.nq] = at
            out[d : d + joint.nv] = rates
    return qpos, out
