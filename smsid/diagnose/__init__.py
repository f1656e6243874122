"""Diagnosis: what the simulation gets wrong, the cause by name, the extended model and what it gains."""

from smsid._callable import make_callable
from smsid.diagnose.diagnose import DiagnosisRun, diagnose
from smsid.diagnose.result import (
    Alias,
    Diagnosis,
    FoundCause,
    Limit,
    SignificantTest,
    Value,
    load_diagnosis,
    save_diagnosis,
)
from smsid.diagnose.score_test import Candidate
from smsid.diagnose.thresholds import DetectionThresholds
from smsid.diagnose.validation import ChannelGain, Gain
from smsid.estimation.problem import ProcessNoise

__all__ = [
    "Alias",
    "Candidate",
    "ChannelGain",
    "DetectionThresholds",
    "Diagnosis",
    "DiagnosisRun",
    "FoundCause",
    "Gain",
    "Limit",
    "ProcessNoise",
    "SignificantTest",
    "Value",
    "diagnose",
    "load_diagnosis",
    "save_diagnosis",
]

make_callable(__name__)  # smsid.diagnose(...) is that of smsid.api
