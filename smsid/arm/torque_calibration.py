"""What a recorded torque signal is worth: its size against the torques that the described links need.

For a drive that logs current, or torque of unknown gain. The described link inertias are taken as true, and
so is gravity; friction, rotors and offsets that the description lists are fitted beside the gain, and with
them what they are not linear in, as `smsid.arm.identify` finds it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.arm._smooth_motion import SmoothMotion, smooth_motion
from smsid.arm._solve import solve_equations
from smsid.arm.identify import rigid_arm
from smsid.arm.joint_torques import JointTorques, block_length, joint_torques
from smsid.arm.readings import MOTOR, measured_channel, with_joint_torque
from smsid.description import Description
from smsid.effects import Gear
from smsid.effects.gear import gears_of
from smsid.errors import DescriptionError, NotIdentifiableError
from smsid.model.identifiable import base_parameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

SURE = 3.0
"""Standard deviations a scale must be away from zero to say anything."""

SCALE = "torque of the described links"
"""Name of the column that the scale multiplies."""


@dataclass(frozen=True)
class TorqueScale:
    """Signal per torque that the links of a joint need [signal per N m]: 1 for torque in N m.

    ``sigma`` is one standard deviation, errors of the described inertias not counted.
    """

    joint: str
    value: float
    sigma: float

    @property
    def is_significant(self) -> bool:
        """Whether it is significantly different from zero."""
        return bool(abs(self.value) > SURE * self.sigma)

    @property
    def gain(self) -> float:
        """Torque per signal [N m per signal]."""
        return 1.0 / self.value


def known_links(model: SpacecraftModel) -> np.ndarray:
    """Return the inertial parameters (n,) of the described links, as in `Regressor` [SI].

    Raises:
        DescriptionError: the links have no inertia.
    """
    theta = Regressor(model).parameters
    if not np.any(theta):
        raise DescriptionError(
            "The links have no inertia to compare torques with.", advice="Give the URDF inertias."
        )
    return theta


def torque_scales(
    description: Description,
    recording: Recording,
    *,
    cutoff: float | None = None,
    hold: Mapping[str, float] | None = None,
) -> tuple[TorqueScale, ...]:
    """Return the scale of every joint's torque signal; infinite sigma where its links' torque does not show.

    Args:
        description: a welded arm whose link inertias are known; its effects are fitted.
        recording: joint angles and torque signals, see `smooth_motion`.
        cutoff: up to where torques are compared [Hz]; by default as `identify_arm`.
        hold: joints that did not move and were not measured, with their positions [rad | m].

    Raises:
        DescriptionError: not a welded arm, or links without inertia.
        RecordingError: as `smooth_motion`.
        NotIdentifiableError: no joint moves.
    """
    model = rigid_arm(description, hold)
    theta = known_links(model)
    motion = smooth_motion(model, recording)
    torques = joint_torques(model, motion, block_length(motion, cutoff))
    return tuple(
        _torque_scale(model, motion, _with_links_as_one(torques, theta), name, j)
        for name, j in zip(model.arm_joints.names, model.arm_joints.v.tolist(), strict=True)
    )


def _with_links_as_one(torques: JointTorques, theta: np.ndarray) -> JointTorques:
    """Return equations whose first column is the torque that links of inertia ``theta`` (n,) need."""
    count = theta.size
    links = torques.rows[:, :, :count] @ theta
    return replace(
        torques,
        rows=np.concatenate([links[:, :, None], torques.rows[:, :, count:]], axis=2),
        names=(SCALE, *torques.names[count:]),
        units=("1", *torques.units[count:]),
    )


def _torque_scale(
    model: SpacecraftModel, motion: SmoothMotion, torques: JointTorques, name: str, joint: int
) -> TorqueScale:
    """Return the scale of one joint, from its equation alone: units of signals differ.

    Found as `identify_arm` finds all else, with the shapes of its friction and its delay.
    """
    untold = TorqueScale(name, float("nan"), float("inf"))
    used = np.zeros(torques.torque.shape, dtype=bool)
    used[:, joint] = True
    own = torques.only(used)
    try:
        base = base_parameters(own.rows[:, joint], own.names, own.units)
        if base.names[0] != SCALE:  # none, or one with a rotor's inertia
            return untold
        solved = solve_equations(model, motion, own, base).regression
    except NotIdentifiableError:
        return untold
    return TorqueScale(name, float(solved.x[0]), float(solved.sigma[0]))


def with_signal_gears(
    description: Description, recordings: Sequence[Recording], joints: Sequence[str]
) -> tuple[Description, list[Recording]]:
    """Return description and recordings in which gears carry the gain of every torque signal.

    Where no joint has a gear, each gets one of ratio 1 to hold the gain, and the signals, recorded at the
    joints, become those of their motors.
    """
    if gears_of(description.effect):
        return description, list(recordings)
    gears = [Gear(name=f"gear_{j.replace('/', '-')}", joint=j, ratio=1.0) for j in joints]
    renamed = []
    for one in recordings:
        channel = measured_channel(one, "joint_torque")
        own = one.labels.get(f"{channel.partition('.')[0]}.joint")
        renamed.append(with_joint_torque(one, np.asarray(one[channel]), MOTOR, own))
    return description.with_effects(*gears), renamed


def with_torque_gains(description: Description, scales: Sequence[TorqueScale]) -> Description:
    """Return the description with the gains of its gears divided by scales found with them.

    Raises:
        DescriptionError: a scale is not significant, or its joint has no gear.
    """
    gears = {e.joint: e for e in gears_of(description.effect)}
    new = []
    for scale in scales:
        if scale.joint not in gears:
            raise DescriptionError(
                f"Joint '{scale.joint}' has no effect of kind 'gear' to carry the gain.", advice="Add one."
            )
        if not scale.is_significant:
            raise DescriptionError(
                f"The torque signal of '{scale.joint}' is {scale.value:.3g} +- {1.96 * scale.sigma:.2g} "
                "times what its links need: no gain can be told from it.",
                advice="Move the joint so that gravity or inertia shows.",
                joint=scale.joint,
            )
        gear = gears[scale.joint]
        new.append(gear.with_values({f"{gear.name}.torque_gain": gear.torque_gain * scale.gain}))
    return description.with_effects(*new)
