"""Tests in the laboratory: a tank that is moved, a structure that vibrates, an oscillator that is driven."""

from smsid.lab.modal import AmbientMode, ambient_modes, band_kurtosis
from smsid.lab.oscillator import Oscillator, fit_oscillator
from smsid.lab.tank import cylinder_slosh, fit_tank, tank_test
from smsid.lab.tank_models import compare_tank_models

__all__ = [
    "AmbientMode",
    "Oscillator",
    "ambient_modes",
    "band_kurtosis",
    "compare_tank_models",
    "cylinder_slosh",
    "fit_oscillator",
    "fit_tank",
    "tank_test",
]
