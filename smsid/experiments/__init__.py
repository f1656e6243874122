"""Experiments: what to fly so that the data identify the spacecraft."""

from smsid.experiments._named import named_experiment
from smsid.experiments.excitation import Excitation, fourier_experiment, momentum_condition, thrust_experiment
from smsid.experiments.fly import FlownExperiment, LimitUse, fly, limit_use
from smsid.experiments.schema import (
    ConstantProfile,
    Experiment,
    FourierProfile,
    StepProfile,
    load_experiment,
    save_experiment,
)

__all__ = [
    "ConstantProfile",
    "Excitation",
    "Experiment",
    "FlownExperiment",
    "FourierProfile",
    "LimitUse",
    "StepProfile",
    "fly",
    "fourier_experiment",
    "limit_use",
    "load_experiment",
    "momentum_condition",
    "named_experiment",
    "save_experiment",
    "thrust_experiment",
]
