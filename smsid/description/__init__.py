"""Describing a spacecraft: a URDF and the TOML beside it."""

from smsid.description.files import load_description, save_description
from smsid.description.schema import Arm, Description, Mount, Thrust, Thruster, Wheel

__all__ = [
    "Arm",
    "Description",
    "Mount",
    "Thrust",
    "Thruster",
    "Wheel",
    "load_description",
    "save_description",
]
