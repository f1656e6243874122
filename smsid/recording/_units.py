"""Units: those in names of columns, and conversion of stated ones to those of the catalogue."""

from __future__ import annotations

import functools
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smsid.errors import RecordingError

FloatArray = NDArray[np.float64]

_ANGLES = frozenset(
    {
        "radian",
        "degree",
        "turn",
        "grade",
        "arcminute",
        "arcsecond",
        "milliarcsecond",
        "revolutions_per_minute",
        "revolutions_per_second",
    }
)
_ADVICE = "Products take a space or *, as in 'N m'; gravity is 'g_0', revolutions are 'turn' or 'rpm'."


@functools.cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


def convert(values: FloatArray, unit: str, to: str, where: str) -> FloatArray:
    """Convert ``values``, of any shape, from ``unit`` to ``to``; both any unit of pint.

    Angles count as a dimension here, unlike in pint: Hz is no rad/s, and a pure number is no angle.

    Raises:
        RecordingError: ``unit`` is unknown or of another dimension; ``where`` says what it belongs to.
    """
    registry = _registry()
    source = _parse(unit, where)
    target = registry.Unit(to)
    if source.dimensionality != target.dimensionality or _angles(source) != _angles(target):
        raise RecordingError(
            f"{where} is said to be in '{unit}' ({_kind(source)}), which cannot become "
            f"'{to}' ({_kind(target)}).",
            advice=f"State the unit that the file holds. {_ADVICE}",
            unit=unit,
            expected=to,
        )
    if source == target:
        return values
    return np.asarray(registry.Quantity(values, source).to(target).magnitude, dtype=np.float64)


def same_dimension(unit: str, other: str, where: str) -> bool:
    """Return whether two units are of one dimension, angles counted as one.

    Raises:
        RecordingError: a unit is unknown.
    """
    first, second = _parse(unit, where), _parse(other, where)
    return bool(first.dimensionality == second.dimensionality and _angles(first) == _angles(second))


def check_unit(unit: str, where: str) -> None:
    """Raise `RecordingError` unless pint knows the unit."""
    _parse(unit, where)


def _parse(unit: str, where: str) -> Any:
    try:
        return _registry().Unit(unit)
    except Exception as error:  # pint raises its own, AttributeError, TypeError, tokenize errors, ...
        raise RecordingError(
            f"{where}: '{unit}' is not a unit: {error}.", advice=_ADVICE, unit=unit
        ) from error


def _angles(unit: Any) -> float:
    registry = _registry()
    exponent = 0.0
    for name, power in registry.Quantity(1.0, unit).unit_items():
        base = {candidate[1] for candidate in registry.parse_unit_name(name)}
        if base & _ANGLES:
            exponent += float(power)
    return exponent


def _kind(unit: Any) -> str:
    angle = _angles(unit)
    dimension = str(unit.dimensionality)
    return f"[angle] {dimension}" if angle else dimension


UNIT_IN_NAME = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]")

WORDS = {
    "m/s2": "m/s^2", "m/s²": "m/s^2", "m/s^2": "m/s^2", "m/s/s": "m/s^2", "m": "m", "mm": "mm", "cm": "cm",
    "m/s": "m/s", "mm/s": "mm/s", "s": "s", "sec": "s", "seconds": "s", "ms": "ms", "us": "us", "µs": "us",
    "ns": "ns", "rad": "rad", "mrad": "mrad", "rad/s": "rad/s", "rad/s2": "rad/s^2", "rad/s^2": "rad/s^2",
    "rpm": "rpm", "1/min": "rpm", "deg": "degree", "°": "degree", "degree": "degree", "degrees": "degree",
    "grad": "degree",
    "deg/s": "degree/s", "°/s": "degree/s", "dps": "degree/s", "deg/s2": "degree/s^2",
    "deg/s^2": "degree/s^2", "g": "standard_gravity", "mg": "millistandard_gravity", "nm": "N m",
    "n m": "N m", "n·m": "N m", "n*m": "N m", "mnm": "mN m", "n": "N", "kn": "kN", "a": "A", "ma": "mA",
    "v": "V", "mv": "mV", "hz": "Hz", "k": "K", "%": "percent", "w": "W", "bar": "bar",
    "degc": "degC", "°c": "degC", "c": "degC", "-": "1", "1": "1",
}  # fmt: skip
"""Units as people write them, in lower case, and in the words of a mapping file."""

SUFFIXES = {
    "N": "N", "Nm": "N m", "mNm": "mN m", "rad": "rad", "mrad": "mrad", "deg": "degree", "degs": "degree/s",
    "deg_s": "degree/s", "degps": "degree/s", "dps": "degree/s", "rads": "rad/s", "rad_s": "rad/s",
    "radps": "rad/s", "rpm": "rpm", "RPM": "rpm", "mps": "m/s", "m_s": "m/s", "mps2": "m/s^2", "ms2": "m/s^2",
    "m_s2": "m/s^2", "m": "m", "mm": "mm", "s": "s", "sec": "s", "ms": "ms", "msec": "ms", "us": "us",
    "usec": "us", "ns": "ns", "nsec": "ns", "A": "A", "mA": "mA", "V": "V", "g": "standard_gravity",
}  # fmt: skip
"""Units at the end of a name, after an underscore. Of one letter, they count only where they fit."""
_ENDINGS = "|".join(sorted(SUFFIXES, key=len, reverse=True))
_SUFFIX = re.compile(rf"(?<=[A-Za-z0-9\])])_({_ENDINGS})(?=$|_?[xyzXYZ\d]{{1,2}}$)")


_BEHIND = re.compile(r"\s*(?:,\s|\s/\s|\s(?i:in)\s)\s*\(?([^\s()]+|N m)\)?$")
"""A unit behind the name: ``Force, N``, ``phi / deg``, ``omega / (deg/s)``, ``Zeit in s``."""


def unit_word(text: str) -> str | None:
    """Give the unit that a text such as ``deg/s`` means, in the words of a mapping file, or None."""
    return WORDS.get(text.strip().strip("[]()").strip().lower())


def written_unit(name: str) -> str | None:
    """Give the unit in brackets in a column's name, or at its end as in ``force_x_N``, or None."""
    for found in UNIT_IN_NAME.finditer(name):
        unit = WORDS.get(found.group(1).lower())
        if unit is not None and unit != "1":
            return unit
    behind = _BEHIND.search(name)
    if behind and (unit := unit_word(behind.group(1))) not in (None, "1"):
        return unit
    match = _SUFFIX.search(UNIT_IN_NAME.sub("", name).strip())
    return SUFFIXES[match.group(1)] if match else None


def bare(name: str) -> str:
    """Give the name of a column without its unit."""
    behind = _BEHIND.search(name)
    text = name[: behind.start()] if behind and unit_word(behind.group(1)) not in (None, "1") else name
    for found in reversed(list(UNIT_IN_NAME.finditer(text))):
        if not found.group(1).strip().isdigit():
            text = text[: found.start()] + text[found.end() :]
    return _SUFFIX.sub("", text.strip()).strip()
