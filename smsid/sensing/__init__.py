"""Sensors: what they measure, their errors, and what they make of a motion."""

from smsid.sensing.error_model import ErrorModel
from smsid.sensing.presets import preset, preset_names, preset_source
from smsid.sensing.sensor import MEASURES, Sensor

__all__ = [
    "MEASURES",
    "ErrorModel",
    "Sensor",
    "preset",
    "preset_names",
    "preset_source",
]
