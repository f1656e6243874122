"""Comparisons as JSON."""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict
from pathlib import Path

from pydantic import TypeAdapter

from smsid._files import atomic_write, json_ready
from smsid._reading import read_json
from smsid._version import __version__
from smsid.comparison.result import Comparison
from smsid.errors import SmsidError

SCHEMA_VERSION = 1
NUMBERS = {"before", "after", "sigma", "p_value", "value"}
COMPARISON = TypeAdapter(Comparison)


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
        findings = document["findings"]
        quantities = [q for f in findings for q in f["quantities"]]
        for table in (*document["parameters"], *findings, *quantities):
            # a number that was written as null is not a number again
            table |= {k: math.nan for k in NUMBERS & table.keys() if table[k] is None}
        known = {"statistic": overall["value"], "freedom": overall["freedom"], "p_value": overall["p_value"]}
        return COMPARISON.validate_python({**document, **known, "left": document["left_p_value"]})
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SmsidError(
            f"'{file}' cannot be read as a comparison: {error}.", advice="Is it cut short?"
        ) from error
