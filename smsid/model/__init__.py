"""The model: one Pinocchio model in which everything that moves is a joint."""

from smsid.model.build import build_model, rebuild
from smsid.model.spacecraft import JointGroup, SloshJoint, SpacecraftModel

__all__ = ["JointGroup", "SloshJoint", "SpacecraftModel", "build_model", "rebuild"]
