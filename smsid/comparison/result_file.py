"""Comparisons as JSON."""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

from smsid._files import atomic_write, json_ready
from smsid._reading import read_json
from smsid._version import __version__
from smsid.comparison.result import Comparison, Finding, NotComparable, ParameterChange, Quantity
from smsid.errors import SmsidError

SCHEMA_VERSION = 1


def comparison_json(found: Comparison) -> str:
    """Return a comparison as JSON text; not-a-number is written as null."""
    document = {
        "schema": SCHEMA_VERSION,
        "kind": "comparison",
        "smsid": __version__,
        "first": found.first,
        "second": found.second,
        "changed": found.changed,
        "sentence": found.sentence,
        "chi_squared": {"value": found.statistic, "freedom": found.freedom, "p_value": found.p_value},
        "findings": [
            {**asdict(f), "quantities": [{**asdict(q), "interval": list(q.interval)} for q in f.quantities]}
            for f in found.findings
        ],
        "left_p_value": found.left,
        "parameters": [
            {**asdict(p), "change": p.change, "interval": list(p.interval), "interval_level": 0.95}
            for p in found.parameters
        ],
        "not_comparable": [asdict(n) for n in found.not_comparable],
        "notes": list(found.notes),
    }
    return json.dumps(json_ready(document), indent=1, allow_nan=False) + "\n"


def save_comparison(found: Comparison, path: str | os.PathLike[str]) -> None:
    """Write a comparison as JSON, whole or not at all."""
    atomic_write(Path(path), found.to_json())


def load_comparison(path: str | os.PathLike[str]) -> Comparison:
    """Load a comparison; raises `SmsidError` naming what is wrong with the file."""
    file = Path(path)
    if not file.is_file():
        raise SmsidError(f"The file '{file}' does not exist.", advice="Run `smsid compare` to make it.")
    try:
        document = read_json(file)
        if document.get("kind") != "comparison" or document.get("schema") != SCHEMA_VERSION:
            raise SmsidError(
                f"'{file}' is no comparison of schema {SCHEMA_VERSION}.", advice="Check the path."
            )
        overall = document["chi_squared"]
        return Comparison(
            first=document["first"],
            second=document["second"],
            parameters=tuple(ParameterChange(**_own(ParameterChange, x)) for x in document["parameters"]),
            not_comparable=tuple(NotComparable(**x) for x in document["not_comparable"]),
            statistic=overall["value"],
            freedom=overall["freedom"],
            p_value=overall["p_value"],
            findings=tuple(_finding(x) for x in document["findings"]),
            left=document["left_p_value"],
            notes=tuple(document["notes"]),
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SmsidError(
            f"'{file}' cannot be read as a comparison: {error}.", advice="Is it cut short?"
        ) from error


def _own(kind: type, table: dict[str, Any]) -> dict[str, Any]:
    """Return a table's entries that are fields; a number written as null is not a number again."""
    numbers = ("before", "after", "sigma", "p_value", "value")
    own = {k: v for k, v in table.items() if k in kind.__dataclass_fields__}  # type: ignore[attr-defined]
    return {k: math.nan if v is None and k in numbers else v for k, v in own.items()}


def _finding(table: dict[str, Any]) -> Finding:
    quantities = tuple(Quantity(**_own(Quantity, q)) for q in table["quantities"])
    return Finding(**{**_own(Finding, table), "quantities": quantities, "others": tuple(table["others"])})
