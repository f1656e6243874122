"""Arms on the ground: identification of links, friction, motors and couplings from joint torques."""

from smsid.arm.columns import Column, torque_columns
from smsid.arm.doubts import JointDoubt, joint_doubts
from smsid.arm.identify import ArmIdentification, TorqueErrors, identify_arm, torque_errors
from smsid.arm.motion import JointMotion, joint_motion
from smsid.arm.presets import with_joint_effects
from smsid.arm.scales import TorqueScale, torque_scales, with_torque_gains

__all__ = [
    "ArmIdentification",
    "Column",
    "JointDoubt",
    "JointMotion",
    "TorqueErrors",
    "TorqueScale",
    "identify_arm",
    "joint_doubts",
    "joint_motion",
    "torque_columns",
    "torque_errors",
    "torque_scales",
    "with_joint_effects",
    "with_torque_gains",
]
