"""Conversion of stated units to those of the catalogue."""

from __future__ import annotations

import functools
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
    """Convert ``values`` from ``unit`` to ``to``; both any unit of pint.

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


def alike(unit: str, other: str, where: str) -> bool:
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
