"""Modal data in plain tables: a CSV with a mode a row, or a JSON with the keys of a modal appendage."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from smsid._reading import read_json
from smsid.errors import DescriptionError


def read_modal_json(path: Path) -> dict[str, Any]:
    """Return the keys of a JSON; raises `DescriptionError` for one that is none or has other keys."""
    found = read_json(path, DescriptionError)
    known = {"mass", "center_of_mass", "inertia", "stations", "mode"}
    if not isinstance(found, dict) or set(found) - known:
        extra = sorted(set(found) - known) if isinstance(found, dict) else ["no table"]
        raise DescriptionError(
            f"'{path}' has {', '.join(extra)}.", advice=f"Keys: {', '.join(sorted(known))}."
        )
    return found


def read_modal_csv(path: Path) -> dict[str, Any]:
    """Read a mode a row: frequency, damping, tx ty tz, rx ry rz, and of each station s1x s1y s1z, ...

    Raises `DescriptionError` for columns that are missing or unknown.
    """
    with path.open(encoding="utf-8-sig", newline="") as stream:
        rows = [{k.strip(): v for k, v in row.items() if k} for row in csv.DictReader(stream)]
    names = list(rows[0]) if rows else []
    stations = sum(1 for name in names if re.fullmatch(r"s\d+x", name))
    wanted = ["frequency", *(f"{k}{a}" for k in "tr" for a in "xyz")]
    wanted += [f"s{k}{a}" for k in range(1, stations + 1) for a in "xyz"]
    missing = [name for name in wanted if name not in names]
    unknown = [name for name in names if name not in (*wanted, "damping")]
    if missing or unknown:
        raise DescriptionError(
            f"'{path}' has {f'no column {missing}' if missing else f'the unknown column {unknown}'}.",
            advice="Columns: frequency [Hz], damping, tx ty tz [kg^.5], rx ry rz [kg^.5 m], s1x s1y s1z ... "
            "[kg^-.5].",
        )
    try:
        numbers = [{k: float(v) for k, v in row.items()} for row in rows]
    except (TypeError, ValueError) as error:
        raise DescriptionError(
            f"'{path}' holds a cell that is no number: {error}.", advice="Mend it."
        ) from error
    return {
        "mode": [
            {
                "frequency": row["frequency"],
                **({"damping": row["damping"]} if "damping" in row else {}),
                "translation": _vector(row, "t"),
                "rotation": _vector(row, "r"),
                "shape": tuple(_vector(row, f"s{k}") for k in range(1, stations + 1)),
            }
            for row in numbers
        ]
    }


def _vector(row: Mapping[str, float], what: str) -> tuple[float, ...]:
    return tuple(row[f"{what}{axis}"] for axis in "xyz")
