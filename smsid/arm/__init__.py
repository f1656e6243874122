"""Arms on the ground: identification of links, friction, motors and couplings from joint torques."""

from smsid.arm.columns import Column, JointStates, effect_columns
from smsid.arm.comparison import TorqueComparison, TorqueErrors, torque_errors
from smsid.arm.friction_shape import FrictionShape
from smsid.arm.identify import ArmIdentification, identify_arm
from smsid.arm.input_checks import JointDoubt, joint_doubts
from smsid.arm.joint_torques import JointTorques, joint_torques
from smsid.arm.motion import JointMotion, joint_motion
from smsid.arm.presets import with_friction_laws, with_joint_effects
from smsid.arm.servo import ServoIdentification, identify_servos
from smsid.arm.smooth_motion import SmoothMotion, smooth_motion
from smsid.arm.smoothing import SmoothJoint, smooth_joint
from smsid.arm.torque_calibration import TorqueScale, torque_scales, with_torque_gains

__all__ = [
    "ArmIdentification",
    "Column",
    "FrictionShape",
    "JointDoubt",
    "JointMotion",
    "JointStates",
    "JointTorques",
    "ServoIdentification",
    "SmoothJoint",
    "SmoothMotion",
    "TorqueComparison",
    "TorqueErrors",
    "TorqueScale",
    "effect_columns",
    "identify_arm",
    "identify_servos",
    "joint_doubts",
    "joint_motion",
    "joint_torques",
    "smooth_joint",
    "smooth_motion",
    "torque_errors",
    "torque_scales",
    "with_friction_laws",
    "with_joint_effects",
    "with_torque_gains",
]
