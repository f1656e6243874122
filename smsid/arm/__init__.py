"""Arms on the ground: identification of links, friction, motors and couplings from joint torques."""

from smsid.arm.columns import Column, torque_columns
from smsid.arm.identify import ArmIdentification, TorqueErrors, identify_arm, torque_errors
from smsid.arm.motion import JointMotion, joint_motion
from smsid.arm.presets import with_joint_effects

__all__ = [
    "ArmIdentification",
    "Column",
    "JointMotion",
    "TorqueErrors",
    "identify_arm",
    "joint_motion",
    "torque_columns",
    "torque_errors",
    "with_joint_effects",
]
