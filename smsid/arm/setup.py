"""An arm to identify without a TOML: from its URDF, with the usual effects, and joints that are held."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from smsid.description import Description
from smsid.description.robots import robot_urdf
from smsid.description.urdf_reading import Mimic
from smsid.errors import DescriptionError
from smsid.model.followers import Followers
from smsid.model.spacecraft import JointGroup, SpacecraftModel, set_group_angles
from smsid.recording import Recording

GRAVITY = (0.0, 0.0, -9.80665)
BASE = ("pose.", "imu.", "gyro", "star_tracker.", "thrust", "wheel")
"""How channels begin that a log of a spacecraft has and one of an arm on the ground has not."""
OF_A_BASE = (".wheel_torque", ".wheel_rate", ".thruster", ".thruster_force", ".force", ".torque")
"""How they end."""


def arm_description(urdf: Path | None = None, *, robot: str | None = None) -> Description:
    """Return the description of an arm that is welded to level ground, from its URDF.

    Args:
        urdf: its file.
        robot: its name in example-robot-data, instead.

    Raises:
        DescriptionError: no such robot.
        MissingDependencyError: example-robot-data is not installed.
    """
    folders: list[Path] = []
    if robot is not None:
        urdf, folders = robot_urdf(robot)
    assert urdf is not None
    return Description(
        name=robot or urdf.stem,
        urdf=urdf.name,
        folder=urdf.parent,
        root="fixed",
        gravity=GRAVITY,
        meshes="ignored",
        inertias="trusted",  # they take no part in what torques identify
        package_dirs=tuple(str(f) for f in folders),
    )


def is_of_an_arm(recordings: Sequence[Recording]) -> bool:
    """Return whether recordings hold joint angles and torques, and nothing of a base that moves."""
    names = [n for r in recordings for n in r.channels if not n.startswith("truth.")]
    base = any(n.startswith(BASE) or n.endswith(OF_A_BASE) for n in names)
    angles = any(n.endswith(".joint_position") and not n.startswith("command.") for n in names)
    return any(n.endswith(".joint_torque") for n in names) and angles and not base


def held_joints(
    joints: Sequence[str], patterns: Sequence[str], *, option: str = "--hold"
) -> dict[str, float]:
    """Return the joints that are held, with their positions [rad | m].

    Patterns are ``name``, ``hand_*`` or ``lift=0.1``; ``option`` is what messages call them.

    Raises:
        DescriptionError: a pattern fits no joint, or its position is no number.
    """
    held: dict[str, float] = {}
    for pattern in patterns:
        name, given, value = pattern.partition("=")
        try:
            position = float(value) if given else 0.0
        except ValueError:
            raise DescriptionError(
                f"'{pattern}' holds no position.", advice=f"Write {option} joint or {option} joint=0.3."
            ) from None
        fitting = fnmatch.filter(joints, name)
        if not fitting:
            raise DescriptionError(
                f"{option} '{name}' fits no joint.", advice=f"Joints of the model: {', '.join(joints)}."
            )
        held |= dict.fromkeys(fitting, position)
    return held


def with_held_joints(model: SpacecraftModel, held: Mapping[str, float]) -> SpacecraftModel:
    """Return the model of an arm with joints welded at their positions [rad | m], and what follows them.

    Raises:
        DescriptionError: a joint does not exist or follows one that moves, or all are held.
    """
    if not held:
        return model
    unknown = [n for n in held if not model.pin.existJointName(n)]
    held, mimics = dict(held), {}
    if model.followers is not None and not unknown:
        f = model.followers
        for name, leader, ratio, offset in zip(f.names, f.leaders, f.ratio, f.offset, strict=True):
            if name in held and leader not in held:
                raise DescriptionError(
                    f"Cannot hold '{name}': it follows '{leader}' by {ratio:g} and {offset:g}.",
                    advice=f"Hold '{leader}' as well if neither moves.",
                    joint=name,
                    leader=leader,
                )
            if leader in held:
                held.setdefault(name, float(ratio * held[leader] + offset))
            elif name not in held:
                mimics[name] = Mimic(leader, float(ratio), float(offset))
    if unknown or len(held) >= len(model.arm_joints):
        raise DescriptionError(
            f"Cannot hold {', '.join(unknown or held)}: "
            + ("no such joint." if unknown else "nothing is left that moves."),
            advice=f"Joints of the model: {', '.join(model.arm_joints.names)}.",
        )
    joints = [int(model.pin.getJointId(n)) for n in held]
    q = set_group_angles(JointGroup.of(model.pin, joints), model.home, np.array(list(held.values())))
    reduced = pin.buildReducedModel(model.pin, joints, q)
    reduced.armature[:] = 0.0
    arms = {
        name: JointGroup.of(reduced, [reduced.getJointId(n) for n in group.names if n not in held])
        for name, group in model.arms.items()
    }
    every = JointGroup.of(reduced, [int(j) for group in arms.values() for j in group.joints])
    angles = [float(model.joint_angles(model.home)[model.arm_joints.names.index(n)]) for n in every.names]
    home = set_group_angles(every, pin.neutral(reduced), np.array(angles))
    return replace(
        model,
        pin=reduced,
        visual=None,
        data=reduced.createData(),
        arms={n: g for n, g in arms.items() if len(g)},
        arm_joints=every,
        home=home,
        source=None,
        followers=Followers.of(reduced, mimics),
    )
