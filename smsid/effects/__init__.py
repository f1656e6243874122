"""Effects: what a spacecraft has beyond rigid links. One file per family, one catalogue."""

from smsid.effects.appendage import Appendage, BeamAppendage, ModalAppendage, Mode
from smsid.effects.base import Effect, Vector3, catalogue, parse_effect, physical, register
from smsid.effects.friction import JointFriction
from smsid.effects.slosh import Slosh

__all__ = [
    "Appendage",
    "BeamAppendage",
    "Effect",
    "JointFriction",
    "ModalAppendage",
    "Mode",
    "Slosh",
    "Vector3",
    "catalogue",
    "parse_effect",
    "physical",
    "register",
]
