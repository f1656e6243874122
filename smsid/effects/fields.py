"""Fields of an effect that are physical parameters: how they are declared, named and read."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from pydantic import Field

from smsid.effects.table import StrictTable

AXES = {3: ("x", "y", "z"), 6: ("xx", "xy", "yy", "xz", "yz", "zz")}
"""Names of the elements of a parameter, by how many it has."""


def physical(
    unit: str,
    *,
    lower: float = -math.inf,
    upper: float = math.inf,
    sparse: bool = False,
    may_vanish: bool = False,
    **kwargs: Any,
) -> Any:
    """Declare a field of an `Effect`, or of a table in it, as a physical parameter with unit and bounds.

    It is a scalar, a 3-vector, or the 6 elements of a symmetric matrix (xx, xy, yy, xz, yz, zz); ``None`` as
    value takes it out of the parameters, and zero does where it is ``sparse``. One that ``may_vanish`` is
    estimated down to zero, where the others keep their meaning; without a mass or a spring they have none.
    """
    extra: Any = {"unit": unit, "lower": lower, "upper": upper, "sparse": sparse, "may_vanish": may_vanish}
    return Field(json_schema_extra=extra, **kwargs)


def prefixes(key: str) -> set[str]:
    """Return a parameter's name and those of what it is part of, as ``mode1.rotation`` is of its ``.y``."""
    parts = key.split(".")
    return {".".join(parts[: k + 1]) for k in range(len(parts))}


@cache
def physical_fields(cls: type[StrictTable]) -> tuple[tuple[str, Mapping[str, Any] | None], ...]:
    """Return the fields of a table that are physical, with their declarations, and others (``None``)."""
    extras = {name: info.json_schema_extra for name, info in cls.model_fields.items()}
    return tuple((n, x if isinstance(x, dict) and "unit" in x else None) for n, x in extras.items())


def numbers_of(table: StrictTable) -> Iterator[tuple[str, float, Mapping[str, Any]]]:
    """Yield name, value and declaration of the physical parameters of a table and of those in it."""
    for entry, extra in physical_fields(type(table)):
        value = getattr(table, entry)
        if extra is not None and isinstance(value, tuple):
            for axis, number in zip(AXES[len(value)], value, strict=True):
                if number or not extra["sparse"]:
                    yield f"{entry}.{axis}", float(number), extra
        elif extra is not None and value is not None:
            yield entry, float(value), extra
        elif extra is None and isinstance(value, tuple) and value and isinstance(value[0], StrictTable):
            for k, part in enumerate(value, start=1):
                yield from ((f"{entry}{k}.{key}", number, own) for key, number, own in numbers_of(part))
