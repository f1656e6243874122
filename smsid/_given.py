"""What is given to functions of `smsid`: a spacecraft, recordings, an estimate, or paths of their files."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import numpy as np

from smsid.description import Description, load_description
from smsid.errors import (
    DescriptionError,
    EstimateError,
    ExperimentError,
    OutputError,
    RecordingError,
    SmsidError,
)
from smsid.experiments import Experiment, load_experiment
from smsid.identify.estimate import Estimate, load_estimate
from smsid.recording import Recording, load_recording

PathLike = str | os.PathLike[str]
T = TypeVar("T")

SPACECRAFT = "a spacecraft", "smsid.load_spacecraft loads one"
ESTIMATE = "an estimate", "smsid.load_estimate loads one"
RECORDING = "a recording", "smsid.load_recording loads one, smsid.import_recording a log"
EXPERIMENT = "an experiment", "smsid.experiments.load_experiment loads one"


def given_spacecraft(given: Description | PathLike) -> Description:
    """Return the description that is given, or that of a path.

    Raises:
        DescriptionError: it is neither, or there is no such file.
    """
    return _loaded(given, Description, load_description, DescriptionError, SPACECRAFT)


def given_recordings(given: Recording | PathLike | Iterable[Recording | PathLike]) -> list[Recording]:
    """Return the recordings that are given, one or several, each a recording or the path of one.

    Raises:
        RecordingError: one is neither, or there is no such file.
    """
    single = isinstance(given, Recording | str | os.PathLike | Mapping) or not isinstance(given, Iterable)
    every: Any = (given,) if single else given
    return [_loaded(x, Recording, load_recording, RecordingError, RECORDING) for x in every]


def given_estimate(given: Estimate | PathLike) -> Estimate:
    """Return the estimate that is given, or that of a path.

    Raises:
        SmsidError: it is neither, or no estimate is in the file.
    """
    return _loaded(given, Estimate, load_estimate, EstimateError, ESTIMATE)


def estimate_if_given(given: Estimate | PathLike | None) -> Estimate | None:
    """Return the estimate that is given, if any, or that of a path; raises as `given_estimate`."""
    return None if given is None else given_estimate(given)


def given_experiment(given: Experiment | PathLike) -> Experiment:
    """Return the experiment that is given, or that of a path.

    Raises:
        ExperimentError: it is neither, or there is no such file.
    """
    return _loaded(given, Experiment, load_experiment, ExperimentError, EXPERIMENT)


def given_path(given: PathLike, error: type[SmsidError] = OutputError) -> str:
    """Return a path as text; raises an ``error`` where none is given."""
    if isinstance(given, str | os.PathLike):
        return os.fspath(given)
    raise error(f"{_told(given)} is no path.", advice="Give the path of a file as text or a pathlib.Path.")


def given_generator(seed: int) -> np.random.Generator:
    """Return the generator of a seed; raises `SmsidError` where it is no whole number of zero or more."""
    if isinstance(seed, int | np.integer) and not isinstance(seed, bool) and seed >= 0:
        return np.random.default_rng(seed)
    raise SmsidError(f"{_told(seed)} is no seed.", advice="Give a whole number, zero or more.")


def _loaded(
    given: Any,
    kind: type[T],
    load: Callable[[PathLike], T],
    error: type[SmsidError],
    called: tuple[str, str],
) -> T:
    if isinstance(given, kind):
        return given
    if isinstance(given, str | os.PathLike):
        return load(given)
    thing, how = called
    raise error(f"{_told(given)} is not {thing}.", advice=f"Give the path of its file, or an object: {how}.")


def _told(given: Any) -> str:
    """Return what is given in a few words: its text where that is short, else its type."""
    text = repr(given)
    plain = given is None or isinstance(given, bool | int | float | str)
    return text if plain and len(text) < 40 else f"An object of type {type(given).__name__}"
