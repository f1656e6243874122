"""Sensors: what they measure, their errors, what they make of a motion, and filters for what they record."""

from smsid.sensing.error_model import ErrorModel
from smsid.sensing.filters import (
    differentiate,
    settling_time,
    uniform_rate,
    zero_phase,
    zero_phase_transposed,
)
from smsid.sensing.observe import add_noise, observe, sample_times
from smsid.sensing.sensor import MEASURES, Sensor, preset, preset_names

__all__ = [
    "MEASURES",
    "ErrorModel",
    "Sensor",
    "add_noise",
    "differentiate",
    "observe",
    "preset",
    "preset_names",
    "sample_times",
    "settling_time",
    "uniform_rate",
    "zero_phase",
    "zero_phase_transposed",
]
