"""What a recorded torque signal is worth: its size against the torques that the described links need.

For a drive that logs current, or torque of unknown gain. The described link inertias are taken as true, and
so is gravity; friction, rotors and offsets that the description lists are fitted beside the gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smsid.arm.identify import rigid_arm, torque_rows
from smsid.arm.motion import JointMotion, joint_motion, measured_states
from smsid.arm.regression import solve_joints
from smsid.description import Description
from smsid.effects import Gear
from smsid.errors import DescriptionError, NotIdentifiableError
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

SURE = 3.0
"""Standard deviations a scale must be away from zero to say anything."""


@dataclass(frozen=True)
class TorqueScale:
    """Signal per torque that the links of a joint need [signal per N m]: 1 for torque in N m.

    ``sigma`` is one standard deviation, errors of the described inertias not counted.
    """

    joint: str
    value: float
    sigma: float

    @property
    def sure(self) -> bool:
        """Whether it is significantly different from zero."""
        return bool(abs(self.value) > SURE * self.sigma)

    @property
    def gain(self) -> float:
        """Torque per signal [N m per signal]."""
        return 1.0 / self.value


def link_torques(
    description: Description, recording: Recording, cutoff: float | None
) -> tuple[SpacecraftModel, JointMotion, np.ndarray, np.ndarray]:
    """Return model, motion, the torques (N, joints) that the described links need, and the effects' columns.

    The columns (N, joints, columns) are those of friction, rotors and offsets.

    Raises:
        DescriptionError: not a welded arm, or links without inertia.
        RecordingError: as `joint_motion`.
    """
    model = rigid_arm(description)
    motion = joint_motion(model, recording, cutoff)
    rows, _, _ = torque_rows(model, measured_states(motion))
    theta = Regressor(model).parameters
    if not np.any(theta):
        raise DescriptionError(
            "The links have no inertia to compare torques with.", advice="Give the URDF inertias."
        )
    links, extra = rows[:, :, : theta.size] @ theta, rows[:, :, theta.size :]
    return model, motion, links, extra


def torque_scales(
    description: Description, recording: Recording, *, cutoff: float | None = None
) -> tuple[TorqueScale, ...]:
    """Return the scale of every joint's torque signal; infinite sigma where its links' torque does not show.

    Args:
        description: a welded arm whose link inertias are known; its effects are fitted.
        recording: joint angles and torque signals, see `joint_motion`.
        cutoff: of the low-pass [Hz].

    Raises:
        DescriptionError: not a welded arm, or links without inertia.
        RecordingError: as `joint_motion`.
    """
    model, motion, links, extra = link_torques(description, recording, cutoff)
    found = []
    for name, j in zip(model.arm_joints.names, model.arm_joints.v.tolist(), strict=True):
        own = extra[:, j]
        columns = np.column_stack([links[:, j], own[:, np.any(own != 0.0, axis=0)]])
        try:
            solved = solve_joints(columns[:, None, :], motion.torque[:, j : j + 1])
            found.append(TorqueScale(name, float(solved.x[0]), float(solved.sigma[0])))
        except NotIdentifiableError:
            found.append(TorqueScale(name, float("nan"), float("inf")))
    return tuple(found)


def with_torque_gains(description: Description, scales: Sequence[TorqueScale]) -> Description:
    """Return the description with the gains of its gears divided by scales found with them.

    Raises:
        DescriptionError: a scale is not significant, or its joint has no gear.
    """
    gears = {e.joint: e for e in description.effect if isinstance(e, Gear)}
    new = []
    for scale in scales:
        if scale.joint not in gears:
            raise DescriptionError(
                f"Joint '{scale.joint}' has no effect of kind 'gear' to carry the gain.", advice="Add one."
            )
        if not scale.sure:
            raise DescriptionError(
                f"The torque signal of '{scale.joint}' is {scale.value:.3g} +- {1.96 * scale.sigma:.2g} "
                "times what its links need: no gain can be told from it.",
                advice="Move the joint so that gravity or inertia shows.",
                joint=scale.joint,
            )
        gear = gears[scale.joint]
        new.append(gear.with_values({f"{gear.name}.torque_gain": gear.torque_gain * scale.gain}))
    return description.with_effects(*new)
