"""All that is wrong or doubtful in a description, at once."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from smsid.description.files import load_description
from smsid.description.schema import Description
from smsid.description.urdf_check import check_inertias, check_meshes, package_folders, read_urdf
from smsid.description.urdf_reading import parse_urdf
from smsid.errors import DescriptionError, SmsidError
from smsid.sensing.error_model import ErrorModel


@dataclass(frozen=True)
class Review:
    """What is ``wrong`` (it does not load or build) and what is ``doubtful``; ``description`` if it loads."""

    wrong: tuple[str, ...]
    doubtful: tuple[str, ...]
    description: Description | None = None


def review_description(path: str | os.PathLike[str]) -> Review:
    """Return all findings about a description: its TOML, every URDF it names, the model, limits and sensors.

    A fault in one part does not hide those of the others. Raises nothing that a description can cause.
    """
    from smsid.model.build import build_model
    from smsid.model.load import urdf_of

    wrong: list[str] = []
    doubtful: list[str] = []
    try:
        d = load_description(path)
    except SmsidError as error:
        return Review((str(error),), ())
    files = [(*urdf_of(d), d.inertias, "the TOML (before its tables)", d.arguments)]
    for arm in d.arm:
        where = f"[[arm]] '{arm.name}'"
        try:
            if arm.mounted:
                files.append((*urdf_of(d, arm), arm.inertias, where, arm.arguments))
        except SmsidError as error:
            wrong.append(f"{where}: {error}")
    for file, folders, inertias, where, arguments in files:
        wrong += _wrong_in_urdf(d, file, folders, inertias == "trusted", where, arguments)
    with _warnings() as told:
        try:
            build_model(d)
        except SmsidError as error:
            if not wrong:  # otherwise it says one of them again
                wrong.append(str(error))
    doubtful += told
    doubtful += _unsaid(d)
    for sensor in d.effective_sensors():
        for quantity, errors in sensor.errors.items():
            place = f"[[sensor]] '{sensor.name}': errors.{quantity}"
            doubtful += [f"{place}: {text}" for text in errors_doubts(errors, sensor.rate)]
    return Review(tuple(dict.fromkeys(wrong)), tuple(dict.fromkeys(doubtful)), d)


def _wrong_in_urdf(
    d: Description, file: Path, folders: list[Path], trusted: bool, where: str, arguments: Mapping[str, str]
) -> list[str]:
    try:
        text = read_urdf(file, arguments, folders)
        reading = parse_urdf(text, str(file))
    except DescriptionError as error:
        return [str(error)]
    found = []
    try:
        check_inertias(reading, trusted=trusted, where=where)
    except DescriptionError as error:
        found.append(str(error))
    if d.meshes == "required":
        try:
            check_meshes(text, str(file), [*folders, *package_folders(text, file)])
        except DescriptionError as error:
            found.append(str(error))
    return found


def _unsaid(d: Description) -> list[str]:
    """What is not stated and makes experiments, limits or results a guess."""
    found = []
    if d.root == "free" and d.thrust.max_force is None:
        found.append("[thrust] max_force is not given: no experiment keeps to it")
    for wheel in d.wheel:
        for key in ("max_torque", "max_rate"):
            if getattr(wheel, key) is None:
                found.append(f"[[wheel]] '{wheel.name}': {key} is not given")
    kinds = {s.kind for s in d.sensor}
    if not d.sensor:
        found.append("there is no [[sensor]]: nothing would be recorded")
    elif d.root == "free" and "pose" not in kinds:
        found.append("there is no [[sensor]] of kind 'pose', which Exp. 2 needs")
    if d.sensor and d.wheel and "tachometer" not in kinds:
        found.append("there are wheels and no [[sensor]] of kind 'tachometer'")
    watched = {s.appendage for s in d.sensor}
    for effect in d.effect:
        if effect.as_appendage() is not None and effect.name not in watched:
            found.append(f"[[effect]] '{effect.name}' has no accelerometers: its bending is not measured")
    return found


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """Collect what the library warns of meanwhile."""
    told: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            told.append(record.getMessage())

    logger, handler = logging.getLogger("smsid"), Collector(logging.WARNING)
    propagate = logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield told
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagate


SCALE = 0.05
"""Scale error [1] beyond those of data sheets, 1 % and less."""
TURN = 0.1
"""Misalignment [rad] from which axes are turned on purpose, which ``orientation`` says."""
LATE = 1.0
"""Age of a sample [s] beyond that of any sensor aboard."""

SHARE = "a share, 0.01 is 1 %"
RADIANS = "in rad; axes that are turned on purpose are the sensor's `orientation`"


def errors_doubts(errors: ErrorModel, rate: float | None) -> Iterator[str]:
    """Yield what is doubtful in the stated errors of one quantity, sampled at ``rate`` [Hz], in words."""
    if errors.noise_density is None or rate is not None:
        noise = float(np.max(errors.white_sigma(rate or 1.0)))
        for what, size in (
            ("noise of one sigma", noise),
            ("bias_sigma", float(np.max(errors.bias_sigma))),
            ("quantisation", errors.quantisation),
        ):
            if errors.saturation is not None and size >= errors.saturation:
                yield (
                    f"saturation {errors.saturation:g} is no more than its {what}, {size:.3g}: nothing else "
                    "would be read"
                )
    for key, limit, told in (
        ("scale_error", SCALE, SHARE),
        ("scale_sigma", SCALE, SHARE),
        ("misalignment", TURN, RADIANS),
        ("misalignment_sigma", TURN, RADIANS),
        ("delay", LATE, "in s"),
        ("time_offset", LATE, "in s"),
    ):
        size = float(np.max(np.abs(getattr(errors, key))))
        if size >= limit:
            yield f"{key} of {size:g} is more than sensors have ({limit:g}): it is {told}"
