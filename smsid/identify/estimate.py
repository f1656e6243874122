"""The result of an identification: every parameter with value, unit, interval and status. Saved as JSON."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import TypeAdapter

import smsid
from smsid._files import atomic_write, json_ready
from smsid._reading import read_json
from smsid.errors import SmsidError

SCHEMA_VERSION = 1
IDENTIFIABLE_BELOW = 0.10
"""A parameter is identifiable when its predicted relative standard deviation is below this."""

Status = Literal["identifiable", "not_identifiable", "known", "by_product"]


@dataclass(frozen=True)
class ParameterEstimate:
    """One estimated parameter.

    ``sigma`` is one predicted standard deviation; ``reference`` what it is judged against: the value itself,
    or for a parameter near zero the largest of its kind on the same body (then ``small`` is true).
    ``nominal`` is the description's value. ``group`` names the step it comes from. ``profile``: the 95 %
    interval of the profile likelihood, where the Gaussian one does not hold.
    """

    name: str
    value: float
    unit: str
    sigma: float
    status: Status
    group: str
    nominal: float | None = None
    reference: float | None = None
    small: bool = False
    note: str = ""
    profile: tuple[float, float] | None = None

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval: that of the profile likelihood if there is one, else Gaussian."""
        if self.profile is not None:
            return self.profile
        return self.value - 1.959964 * self.sigma, self.value + 1.959964 * self.sigma

    @property
    def relative_sigma(self) -> float:
        """Standard deviation relative to the reference."""
        scale = abs(self.reference if self.reference is not None else self.value)
        return self.sigma / scale if scale > 0.0 else math.inf

    def relative_error(self, truth: float, reference: float | None = None) -> float:
        """Return |value - truth| relative to the truth, or to ``reference`` for a small parameter."""
        scale = abs(truth if reference is None else reference)
        return abs(self.value - truth) / scale if scale > 0.0 else math.inf


def judged(
    name: str,
    value: float,
    unit: str,
    sigma: float,
    group: str,
    *,
    nominal: float | None = None,
    reference: float | None = None,
    note: str = "",
) -> ParameterEstimate:
    """Return a parameter with its status from the predicted relative standard deviation."""
    scale = abs(value if reference is None else reference)
    good = bool(math.isfinite(value) and math.isfinite(sigma) and sigma < IDENTIFIABLE_BELOW * scale)
    if not good and not note:
        share = 100 * sigma / scale if scale > 0 else math.inf
        note = (
            f"predicted standard deviation {share:.0f} % of its size: fly a richer or longer experiment"
            if math.isfinite(sigma)
            else "its standard deviation cannot be told"
        )
    return ParameterEstimate(
        name,
        float(value),
        unit,
        float(sigma),
        "identifiable" if good else "not_identifiable",
        group,
        nominal,
        reference,
        reference is not None,
        note,
    )


@dataclass(frozen=True)
class Iteration:
    """One iteration of a search: ``cost`` is the sum of squares per sample, by the noise found at its end.

    ``step`` is the step that led there: of all parameters the largest, in standard deviations of the
    estimate; ``None`` where a search starts.
    """

    cost: float
    step: float | None


@dataclass(frozen=True)
class Estimate:
    """An identified spacecraft.

    ``parameters`` in the order they were found; ``timing`` [s] by step; ``notes`` say what was refused and
    why; ``history`` tells how a method that iterates got there.
    """

    description: str
    method: str
    parameters: tuple[ParameterEstimate, ...]
    recordings: tuple[str, ...] = ()
    timing: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    conditions: Mapping[str, float] = field(default_factory=dict)
    history: tuple[Iteration, ...] = ()

    def __getitem__(self, name: str) -> ParameterEstimate:
        for p in self.parameters:
            if p.name == name:
                return p
        raise KeyError(name)

    def __contains__(self, name: object) -> bool:
        return any(p.name == name for p in self.parameters)

    def group(self, name: str) -> tuple[ParameterEstimate, ...]:
        """Return the parameters of one group."""
        return tuple(p for p in self.parameters if p.group == name)

    def to_json(self) -> str:
        """Return the JSON text; not-a-number is written as null."""
        tables = []
        for p in self.parameters:
            low, high = p.interval
            tables.append({**asdict(p), "interval": [low, high], "interval_level": 0.95})
        document = {
            "schema": SCHEMA_VERSION,
            "kind": "estimate",
            "smsid": smsid.__version__,
            "description": self.description,
            "method": self.method,
            "recordings": list(self.recordings),
            "parameters": tables,
            "timing": {k: {"value": v, "unit": "s"} for k, v in self.timing.items()},
            "conditions": {k: {"value": v, "unit": "1"} for k, v in self.conditions.items()},
            "notes": list(self.notes),
            "history": [{k: {"value": v, "unit": "1"} for k, v in asdict(x).items()} for x in self.history],
        }
        return json.dumps(json_ready(document), indent=1, allow_nan=False) + "\n"


def save_estimate(estimate: Estimate, path: str | os.PathLike[str]) -> None:
    """Write the estimate as JSON, whole or not at all."""
    atomic_write(Path(path), estimate.to_json())


_CHECKED = TypeAdapter(ParameterEstimate)  # a field of another type is an error of the file


def load_estimate(path: str | os.PathLike[str]) -> Estimate:
    """Load an estimate; raises `SmsidError` naming what is wrong with the file."""
    file = Path(path)
    if not file.is_file():
        raise SmsidError(f"The file '{file}' does not exist.", advice="Run `smsid identify` to make it.")
    try:
        document = read_json(file)
        known = isinstance(document, dict) and document.get("kind") == "estimate"
        if not known or document.get("schema") != SCHEMA_VERSION:
            raise SmsidError(
                f"'{file}' is no estimate of schema {SCHEMA_VERSION}.",
                advice="Was it made by another version?",
            )
        fields = ParameterEstimate.__dataclass_fields__
        parameters = []
        for table in document["parameters"]:
            values = {k: v for k, v in table.items() if k in fields}
            for key in ("value", "sigma"):
                values[key] = math.nan if values[key] is None else values[key]
            if values.get("profile") is not None:
                low, high = values["profile"]
                values["profile"] = (-math.inf if low is None else low, math.inf if high is None else high)
            parameters.append(_CHECKED.validate_python(values))
        return Estimate(
            description=document["description"],
            method=document["method"],
            parameters=tuple(parameters),
            recordings=tuple(document["recordings"]),
            timing={k: v["value"] for k, v in document["timing"].items()},
            notes=tuple(document["notes"]),
            conditions={k: v["value"] for k, v in document["conditions"].items()},
            # files of earlier versions have none
            history=tuple(
                Iteration(x["cost"]["value"], x["step"]["value"]) for x in document.get("history", ())
            ),
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SmsidError(
            f"'{file}' cannot be read as an estimate: {error}.", advice="Is it cut short?"
        ) from error
