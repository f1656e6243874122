"""Diagnosis: what the simulation gets wrong, the cause by name, the extended model and what it gains."""

from smsid._callable import make_callable
from smsid.diagnose.accept import Levels
from smsid.diagnose.candidates import Candidate
from smsid.diagnose.diagnose import Diagnosed, diagnose
from smsid.diagnose.gain import ChannelGain, Gain
from smsid.diagnose.result import (
    Alias,
    Diagnosis,
    FoundCause,
    Limit,
    Remaining,
    Value,
    load_diagnosis,
    save_diagnosis,
)
from smsid.estimation.kalman import Noise

__all__ = [
    "Alias",
    "Candidate",
    "ChannelGain",
    "Diagnosed",
    "Diagnosis",
    "FoundCause",
    "Gain",
    "Levels",
    "Limit",
    "Noise",
    "Remaining",
    "Value",
    "diagnose",
    "load_diagnosis",
    "save_diagnosis",
]

make_callable(__name__)  # smsid.diagnose(...) is that of smsid.api
