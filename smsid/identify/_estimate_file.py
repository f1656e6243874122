"""Estimates as JSON, of this version and of earlier ones."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from smsid._files import json_ready
from smsid._reading import SCHEMA_VERSION, reading_document
from smsid._version import __version__
from smsid.identify.estimate import Estimate, Iteration, ParameterEstimate, with_distinct_names

_PLACE = "@covariance@"
_CHECKED = TypeAdapter(ParameterEstimate)  # a field of another type is an error of the file


def estimate_json(estimate: Estimate) -> str:
    """Return an estimate as JSON text; not-a-number is written as null.

    The covariance, where there is one, stands as its lower triangle: a row of k numbers for the k-th
    parameter.
    """
    tables = []
    for p in estimate.parameters:
        low, high = p.interval
        tables.append({**asdict(p), "interval": [low, high], "interval_level": 0.95})
    document: dict[str, Any] = {
        "schema": SCHEMA_VERSION,
        "kind": "estimate",
        "smsid": __version__,
        "description": estimate.description,
        "method": estimate.method,
        "recordings": list(estimate.recordings),
        "parameters": tables,
        "timing": {k: {"value": v, "unit": "s"} for k, v in estimate.timing.items()},
        "conditions": {k: {"value": v, "unit": "1"} for k, v in estimate.conditions.items()},
        "notes": list(estimate.notes),
        "history": [{k: {"value": v, "unit": "1"} for k, v in asdict(x).items()} for x in estimate.history],
    }
    if estimate.covariance is not None:
        document["covariance"] = {
            "unit": "product of the two parameters' units",
            "order": "that of the parameters",
            "lower_triangle": _PLACE,
        }
    text = json.dumps(json_ready(document), indent=1, allow_nan=False) + "\n"
    if estimate.covariance is None:
        return text
    rows = [json_ready(row[: k + 1].tolist()) for k, row in enumerate(estimate.covariance)]
    lines = ",\n".join(json.dumps(row, allow_nan=False) for row in rows)  # a row a line, not a number a line
    return text.replace(f'"{_PLACE}"', f"[\n{lines}\n]")


def read_estimate(file: Path) -> Estimate:
    """Read an estimate; raises `SmsidError` naming what is wrong with the file.

    In files of earlier versions parameters of two groups may share a name; the later are renamed by group.
    """
    with reading_document(file, "estimate", "identify") as document:
        return Estimate(
            description=document["description"],
            method=document["method"],
            parameters=with_distinct_names(_parameter(table) for table in document["parameters"]),
            recordings=tuple(document["recordings"]),
            timing={k: v["value"] for k, v in document["timing"].items()},
            notes=tuple(document["notes"]),
            conditions={k: v["value"] for k, v in document["conditions"].items()},
            # files of earlier versions have neither history nor covariance
            history=tuple(
                Iteration(x["cost"]["value"], x["step"]["value"]) for x in document.get("history", ())
            ),
            covariance=_covariance(document.get("covariance")),
        )


def _parameter(table: dict[str, Any]) -> ParameterEstimate:
    values = {k: v for k, v in table.items() if k in ParameterEstimate.__dataclass_fields__}
    for key in ("value", "sigma"):
        values[key] = math.nan if values[key] is None else values[key]
    if values.get("profile") is not None:
        low, high = values["profile"]
        values["profile"] = (-math.inf if low is None else low, math.inf if high is None else high)
    return _CHECKED.validate_python(values)


def _covariance(table: dict[str, Any] | None) -> np.ndarray | None:
    if table is None:
        return None
    rows = table["lower_triangle"]
    out = np.full((len(rows), len(rows)), math.nan)
    for k, row in enumerate(rows):
        if len(row) != k + 1:
            raise ValueError(f"row {k + 1} of the covariance has {len(row)} numbers")
        out[k, : k + 1] = out[: k + 1, k] = [math.nan if x is None else x for x in row]
    return out
