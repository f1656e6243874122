"""Objects in MATLAB files: what they are called and what writes them so that they can be read.

How timeseries, timetables and datasets are stored is not public; only their names and classes can be told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

OPAQUE = ("s0", "s1", "s2", "arr")  # fields of what scipy makes of an object: name, system, class, reference
BUILT_IN = {"char", "logical", "cell", "struct", "single", "double", "canonical empty", ""}
BUILT_IN |= {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}

MENDS = {
    "timeseries": "log = struct('time', {0}.Time, 'data', {0}.Data); save('log.mat', 'log', '-v7')",
    "timetable": "log = struct('time', seconds({0}.Properties.RowTimes), 'data', {0}.Variables); "
    "save('log.mat', 'log', '-v7')",
    "Dataset": "for k = 1:numElements({0}), e = {0}.getElement(k); log.(matlab.lang.makeValidName(e.Name)) = "
    "struct('time', e.Values.Time, 'data', e.Values.Data); end, save('log.mat', 'log', '-v7')",
    "": "log = struct('time', t, 'data', x); save('log.mat', 'log', '-v7')",
}
"""By class, the line of MATLAB that writes an object, {0}, as a structure of arrays."""


@dataclass(frozen=True)
class MatlabObject:
    """An object of a MATLAB file: its variable or field, and its class."""

    name: str
    kind: str

    def __str__(self) -> str:
        return f"'{self.name}' ({self.kind})"


def opaque_class(value: Any) -> tuple[str, str] | None:
    """Return name (empty in a structure) and class of an object as scipy reads it; None of anything else."""
    if not isinstance(value, np.ndarray) or value.dtype.names != OPAQUE or not value.size:
        return None
    row = value.ravel()[0]
    name, kind = (
        x.decode(errors="replace") if isinstance(x, bytes) else str(x) for x in (row["s0"], row["s2"])
    )
    return name, kind


def mend(objects: Sequence[MatlabObject]) -> str:
    """Return what to do about objects: the lines of MATLAB that write each kind of them."""
    lines = {}
    for one in objects:
        key = next((k for k in MENDS if k and one.kind.endswith(k)), "")
        lines.setdefault(key, MENDS[key].format(one.name or "x"))
    return "In MATLAB: " + "; or: ".join(lines.values()) + "."
