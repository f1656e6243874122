"""Tests in the laboratory: a tank that is moved, a structure that vibrates, an oscillator that is driven."""

from smsid.lab.modal import AmbientMode, AmbientModes, ambient_modes, band_kurtosis
from smsid.lab.oscillator import Oscillator, OscillatorFit, fit_oscillator
from smsid.lab.tank import TankFit, TankTest, cylinder_slosh, fit_tank, tank_test
from smsid.lab.tank_models import TankComparison, compare_tank_models

__all__ = [
    "AmbientMode",
    "AmbientModes",
    "Oscillator",
    "OscillatorFit",
    "TankComparison",
    "TankFit",
    "TankTest",
    "ambient_modes",
    "band_kurtosis",
    "compare_tank_models",
    "cylinder_slosh",
    "fit_oscillator",
    "fit_tank",
    "tank_test",
]
