"""Effects: what a spacecraft has beyond rigid links. One file per family, one catalogue."""

from smsid.effects.appendage import Appendage, BeamAppendage, ModalAppendage, Mode
from smsid.effects.base import Effect, Vector3, catalogue, parse_effect, physical, register
from smsid.effects.friction import JointFriction
from smsid.effects.gear import Gear
from smsid.effects.joint_bias import JointOffset, TorqueOffset
from smsid.effects.motor import MotorCoupling, MotorInertia
from smsid.effects.slosh import Slosh

__all__ = [
    "Appendage",
    "BeamAppendage",
    "Effect",
    "Gear",
    "JointFriction",
    "JointOffset",
    "ModalAppendage",
    "Mode",
    "MotorCoupling",
    "MotorInertia",
    "Slosh",
    "TorqueOffset",
    "Vector3",
    "catalogue",
    "parse_effect",
    "physical",
    "register",
]
