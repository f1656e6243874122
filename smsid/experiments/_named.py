"""Experiments by name, so that one word is enough on the command line."""

from __future__ import annotations

import hashlib
import logging
import os
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from smsid._files import atomic_write
from smsid.errors import ExperimentError, SmsidError
from smsid.experiments.excitation import fourier_experiment, thrust_experiment
from smsid.experiments.scaling import thrust_strength
from smsid.experiments.schema import Experiment, load_experiment
from smsid.model.spacecraft import SpacecraftModel

EXCITATION_SEED = 2026  # the excitation of the named Exp. 2 is part of its definition
FOLDER = "SMSID_CACHE"  # environment variable; empty asks for no cache
DECIDE = ("description", "effects", "experiments", "inputs", "model", "simulate")  # code of a search

logger = logging.getLogger(__name__)


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
        return load_or_search(model, name, lambda: fourier_experiment(model, rng, name=name).experiment)
    path = Path(name)
    if path.suffix == ".toml" or path.exists():
        return load_experiment(path)
    raise ExperimentError(
        f"There is no experiment '{name}'.",
        advice="Use exp1, exp1_x, exp1_z, exp1_xyz, exp2, exp2val, or the path of an experiment's TOML.",
    )


def _thrust(axes: str, model: SpacecraftModel) -> Experiment:
    force, limited_by = thrust_strength(model)
    return thrust_experiment(axes, force=force, limited_by=limited_by)


def load_or_search(model: SpacecraftModel, name: str, search: Callable[[], Experiment]) -> Experiment:
    """Return the experiment that an earlier search found for this very spacecraft, or search and keep it.

    What is kept is found by a digest of the model, its description, and the text of the code that searches:
    a change of any of them searches anew. Where it cannot be kept, the log says so.
    """
    folder = _folder()
    if folder is None:
        return search()
    file = folder / "experiments" / f"{_digest(model, name)}.json"
    try:
        return Experiment.model_validate_json(file.read_bytes())
    except (OSError, ValueError):  # not there, or not whole
        found = search()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(file, found.model_dump_json(by_alias=True))
    except (OSError, SmsidError) as error:
        logger.info("the experiment found is not kept for the next time: %s", error)
    return found


def _folder() -> Path | None:
    chosen = os.environ.get(FOLDER)
    if chosen is not None:
        return Path(chosen) if chosen else None
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "smsid"
    except RuntimeError:  # no home
        return None


def _digest(model: SpacecraftModel, name: str) -> str:
    found = hashlib.sha256(f"{name}\n{_code()}\n".encode())
    found.update(model.description.model_dump_json(exclude={"folder"}).encode())
    found.update(model.pin.saveToString().encode())
    return found.hexdigest()


@cache
def _code() -> str:
    root = Path(__file__).parent.parent
    found = hashlib.sha256(f"{np.__version__} {pin.__version__}".encode())
    for folder in DECIDE:
        for file in sorted((root / folder).rglob("*.py")):
            found.update(file.read_bytes())
    return found.hexdigest()
