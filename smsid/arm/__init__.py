"""Arms on the ground: identification of links, friction, motors and couplings from joint torques."""

from smsid.arm._smooth_motion import smooth_motion
from smsid.arm.columns import JointStates, effect_columns
from smsid.arm.comparison import torque_errors
from smsid.arm.identify import ArmIdentification, identify_arm
from smsid.arm.input_checks import joint_doubts
from smsid.arm.joint_torques import joint_torques
from smsid.arm.motion import ArmMotion, joint_motion
from smsid.arm.presets import with_friction_laws, with_joint_effects
from smsid.arm.servo import identify_servos
from smsid.arm.torque_calibration import torque_scales, with_torque_gains

__all__ = [
    "ArmIdentification",
    "ArmMotion",
    "JointStates",
    "effect_columns",
    "identify_arm",
    "identify_servos",
    "joint_doubts",
    "joint_motion",
    "joint_torques",
    "smooth_motion",
    "torque_errors",
    "torque_scales",
    "with_friction_laws",
    "with_joint_effects",
    "with_torque_gains",
]
