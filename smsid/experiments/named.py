"""Experiments by name, so that one word is enough on the command line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from smsid.errors import ExperimentError
from smsid.experiments.excitation import fourier_experiment, thrust_experiment
from smsid.experiments.remembered import remembered
from smsid.experiments.scaling import thrust_strength
from smsid.experiments.schema import Experiment, load_experiment
from smsid.model.spacecraft import SpacecraftModel

EXCITATION_SEED = 2026  # the excitation of the named Exp. 2 is part of its definition


def named_experiment(name: str, model: SpacecraftModel) -> Experiment:
    """Return ``exp1`` (thrust along x, y, z), ``exp1_<axes>``, ``exp2`` or ``exp2val``, or load a TOML.

    Their strength fits the craft: thrust keeps to its limit and to an acceleration of 0.02 m/s^2, wheels keep
    to their limits and the bus to 0.2 rad/s, the arm to its limits about home; the note says what limits.
    ``exp2`` and ``exp2val`` draw their Fourier series for this spacecraft from fixed, different seeds; what
    is found is kept in the user's cache (`SMSID_CACHE` names another folder, empty none).
    Raises `ExperimentError` for any other name.
    """
    if name == "exp1":
        return _thrust("xyz", model)
    if match := re.fullmatch(r"exp1_([xyz]{1,3})", name):
        return _thrust(match[1], model)
    if name in ("exp2", "exp2val"):
        rng = np.random.default_rng(EXCITATION_SEED + (name == "exp2val"))
        return remembered(model, name, lambda: fourier_experiment(model, rng, name=name).experiment)
    path = Path(name)
    if path.suffix == ".toml" or path.exists():
        return load_experiment(path)
    raise ExperimentError(
        f"There is no experiment '{name}'.",
        advice="Use exp1, exp1_x, exp1_z, exp1_xyz, exp2, exp2val, or the path of an experiment's TOML.",
    )


def _thrust(axes: str, model: SpacecraftModel) -> Experiment:
    strength = thrust_strength(model)
    return thrust_experiment(axes, force=strength.value, limited_by=strength.by)
