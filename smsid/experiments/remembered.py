"""Experiments that took a search, kept in the user's cache folder for the next time they are asked for."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from smsid._files import atomic_write
from smsid.errors import SmsidError
from smsid.experiments.schema import Experiment
from smsid.model.spacecraft import SpacecraftModel

FOLDER = "SMSID_CACHE"  # environment variable; empty asks for no cache
DECIDE = ("description", "effects", "experiments", "inputs", "model", "simulate")  # code of a search

logger = logging.getLogger(__name__)


def remembered(model: SpacecraftModel, name: str, search: Callable[[], Experiment]) -> Experiment:
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
