"""Guesses from names and numbers of columns: what is a clock, which columns make a channel, in what unit."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

UNIT_IN_NAME = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]")
CLOCK = re.compile(
    r"(^|[^a-z])(t|time|times|timestamp|stamp|zeit|temps|tiempo|tempo|tid|secs?|seconds)($|[^a-z])"
)

QUANTITIES: tuple[tuple[str, str, str], ...] = (
    (r"quat|orientation|attitude|lage", "attitude", "1"),
    (r"current|strom|corriente|corrente|courant|\bcurr", "current", "A"),
    (r"torque|effort|tau|drehmoment|couple|coppia|\btrq", "joint_torque", "N m"),
    (r"joint.*(vel|speed)|(^|[^a-z])(dq|qd)[^a-z]*$", "joint_velocity", "rad/s"),
    (r"joint.*(pos|angle)|winkel|angle|encoder|(^|[^a-z])q[^a-z]*$", "joint_position", "rad"),
    (r"gyr|angular.?vel|angular.?rate|omega|drehrate", "angular_rate", "rad/s"),
    (r"acc|beschl|axis.*m/s2|linear.?acc", "acceleration", "m/s^2"),
    (r"force|kraft|forza|fuerza", "force", "N"),
    (r"vel|speed|geschw|vitesse", "velocity", "m/s"),
    (r"pos", "position", "m"),
)
"""Pattern in the name, quantity, unit expected. A current is no quantity of a recording: it needs a gear's
gain.
"""

WRITTEN_UNITS = {
    "m/s2": "m/s^2", "m/s²": "m/s^2", "m/s^2": "m/s^2", "m": "m", "mm": "mm", "m/s": "m/s",
    "s": "s", "ms": "ms", "us": "us", "ns": "ns", "rad": "rad", "rad/s": "rad/s", "rpm": "rpm",
    "deg": "degree", "°": "degree", "deg/s": "degree/s", "°/s": "degree/s", "g": "standard_gravity",
    "nm": "N m", "n m": "N m", "n": "N", "a": "A", "v": "V",
}  # fmt: skip


@dataclass(frozen=True)
class Group:
    """Columns that make one channel.

    ``quantity`` is None when the name says nothing; ``unit`` is as written in the name, or the usual one.
    """

    stem: str
    columns: tuple[str, ...]
    quantity: str | None
    unit: str
    unit_written: bool


def written_unit(name: str) -> str | None:
    """Return the unit in brackets of a column's name, in the words of a mapping file, or None."""
    found = UNIT_IN_NAME.search(name)
    text = found.group(1).lower() if found else ""
    return WRITTEN_UNITS.get(text)


def is_clock(name: str, values: NDArray[Any]) -> bool:
    """Tell whether a column looks like times: so named, or nearly always increasing by nearly the same."""
    if values.ndim != 1 or values.dtype.kind != "f" or values.size < 3:
        return False
    steps = np.diff(values[np.isfinite(values)])
    if steps.size < 2:
        return False
    rising = float(np.mean(steps > 0.0))
    bare = UNIT_IN_NAME.sub("", name).lower()
    if CLOCK.search(bare):
        return rising > 0.5
    middle = float(np.median(steps))
    return (
        rising > 0.999 and middle > 0.0 and float(np.percentile(np.abs(steps - middle), 90)) < 0.01 * middle
    )


def groups(columns: Mapping[str, NDArray[Any]], skip: set[str]) -> list[Group]:
    """Put columns whose names differ in an axis or a number only together, in order of the file."""
    stems: dict[str, list[str]] = {}
    for name, values in columns.items():
        if name in skip or values.dtype.kind != "f" or values.ndim not in (1, 2):
            continue
        bare = UNIT_IN_NAME.sub("", name).strip()
        axis = r"(?i)(?<![a-z])([wxyz])(?=$|[^a-z])|[ _.-]?\d+$"
        stem = re.sub(axis, "#", bare) if values.ndim == 1 else bare
        stems.setdefault(stem, []).append(name)
    found = []
    for stem, names in stems.items():
        text = " ".join(names).lower()
        quantity, usual = next(
            ((q, u) for pattern, q, u in QUANTITIES if re.search(pattern, text)), (None, "1")
        )
        if len(names) == 4 and re.search(r"(?i)q", stem) and _unit_norm(columns, names):
            quantity, usual = "attitude", "1"
        unit = written_unit(names[0])
        found.append(Group(stem, tuple(names), quantity, unit or usual, unit is not None))
    return found


def suspicion(group: Group, values: NDArray[Any]) -> str | None:
    """Say why the unit of a group may not be ``group.unit``, from the size of its values (N, k)."""
    finite = values[np.isfinite(values).all(axis=1)]
    if not finite.size:
        return None
    largest, middle = float(np.abs(finite).max()), float(np.median(np.linalg.norm(finite, axis=1)))
    name = group.stem
    if group.quantity == "joint_position" and group.unit == "rad" and largest > 4.0 * np.pi:
        return f"'{name}' reaches {largest:.4g}: degrees, or motor angles before a gear, rather than rad?"
    if group.quantity in ("angular_rate", "joint_velocity") and group.unit == "rad/s" and largest > 35.0:
        return f"'{name}' reaches {largest:.4g}: degrees per second or rpm rather than rad/s?"
    if group.quantity == "acceleration" and group.unit == "m/s^2" and finite.shape[1] == 3:
        if 0.9 < middle < 1.1:
            return f"'{name}' has a median size of {middle:.3g}: in units of gravity rather than m/s^2?"
        if 900.0 < middle < 1100.0:
            return f"'{name}' has a median size of {middle:.4g}: in thousandths of gravity rather than m/s^2?"
    if group.quantity == "attitude":
        norm = np.linalg.norm(finite, axis=1)
        if finite.shape[1] != 4 or np.abs(norm - 1.0).max() > 1e-3:
            return f"'{name}' is no unit quaternion: norms from {norm.min():.4g} to {norm.max():.4g}."
    if group.quantity == "current":
        return f"'{name}' looks like a current: it is a torque only through a gain (`torque_gain` of a gear)."
    return None


def _unit_norm(columns: Mapping[str, NDArray[Any]], names: list[str]) -> bool:
    norm = np.linalg.norm(np.stack([columns[n] for n in names], axis=1), axis=1)
    return bool(np.nanmax(np.abs(norm - 1.0)) < 0.05)
