"""The result of a comparison: every parameter's change, the joint test, findings; and its JSON."""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import TypeAdapter

from smsid._by_name import ByName, no_such_name
from smsid._files import atomic_write, json_ready
from smsid._reading import SCHEMA_VERSION, reading_document
from smsid._short_repr import ShortRepr
from smsid._statistics import NORMAL95
from smsid._version import __version__
from smsid.errors import require

if TYPE_CHECKING:
    import pandas as pd

LEVEL = 1e-4
"""Probability below which a difference is called a change: one false change in ten thousand pairs of
estimates of the same craft, at the most two with the single parameters' own test."""

FindingKind = Literal[
    "body_grasped", "body_released", "mass_left", "body_changed", "effect_changed", "unexplained"
]


@dataclass(frozen=True)
class ParameterChange:
    """One parameter in both estimates: ``after`` less ``before`` with its standard deviation [``unit``].

    ``p_value`` is the probability of so large a difference by chance, of this parameter by itself; not a
    number where a standard deviation is not known. ``changed``: it is too small for chance, all parameters
    compared considered. ``derived`` says that one of the estimates does not name this combination: it was
    made of those that it names.
    """

    name: str
    unit: str
    before: float
    after: float
    sigma: float
    p_value: float
    changed: bool
    derived: bool = False

    @property
    def change(self) -> float:
        """After less before [``unit``]."""
        return self.after - self.before

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the change [``unit``]."""
        return self.change - NORMAL95 * self.sigma, self.change + NORMAL95 * self.sigma

    @property
    def deviations(self) -> float:
        """The change in standard deviations."""
        return self.change / self.sigma if self.sigma > 0.0 else float("nan")


@dataclass(frozen=True)
class NotComparable:
    """A parameter of one estimate that the other does not tell, and why."""

    name: str
    estimate: Literal["first", "second"]
    reason: str


@dataclass(frozen=True)
class FindingQuantity:
    """A number of a finding with its standard deviation [``unit``]; ``told``: whether the data tell it."""

    name: str
    unit: str
    value: float
    sigma: float
    told: bool = True

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval [``unit``]."""
        return self.value - NORMAL95 * self.sigma, self.value + NORMAL95 * self.sigma


@dataclass(frozen=True)
class Finding(ByName[FindingQuantity]):
    """What explains differences, in words and numbers.

    ``subject`` is the link, body or effect it is at. ``p_value``: of the differences it explains, by chance
    and given the other findings. ``others`` are subjects that explain them nearly as well: the data do not
    tell which it is.
    """

    kind: FindingKind
    subject: str
    sentence: str
    quantities: tuple[FindingQuantity, ...] = ()
    p_value: float = 0.0
    others: tuple[str, ...] = ()

    def keys(self) -> tuple[str, ...]:
        """Return the names of the quantities."""
        return tuple(q.name for q in self.quantities)

    def __getitem__(self, name: str) -> FindingQuantity:
        """Give the quantity of a name; raise `KeyError` where there is none."""
        for q in self.quantities:
            if q.name == name:
                return q
        no_such_name(name, self.keys())


@dataclass(frozen=True, repr=False)
class Comparison(ByName[ParameterChange], ShortRepr):
    """What changed from the ``first`` to the ``second`` estimate.

    ``statistic`` is the chi-squared of all differences together with ``freedom`` degrees of freedom, by both
    covariances; ``None`` where an estimate has none, and then nothing is said of all together. ``left`` is
    the probability of what the findings leave of the differences. ``conclusive`` is False where the
    comparison cannot say that nothing has changed.
    """

    first: str
    second: str
    parameters: tuple[ParameterChange, ...]
    not_comparable: tuple[NotComparable, ...]
    statistic: float | None
    freedom: int
    p_value: float | None
    findings: tuple[Finding, ...]
    left: float | None = None
    notes: tuple[str, ...] = ()

    def keys(self) -> tuple[str, ...]:
        """Return the names of the parameters that are compared."""
        return tuple(p.name for p in self.parameters)

    def __getitem__(self, name: str) -> ParameterChange:
        """Give the change of the parameter of a name; raise `KeyError` where there is none."""
        for p in self.parameters:
            if p.name == name:
                return p
        no_such_name(name, self.keys())

    @property
    def changed(self) -> bool:
        """Whether anything has changed, beyond what chance does."""
        jointly = self.p_value is not None and self.p_value < LEVEL
        return jointly or any(p.changed for p in self.parameters)

    @property
    def sentence(self) -> str:
        """The result in a sentence."""
        told = f"{len(self.parameters)} parameters compared"
        if self.statistic is not None:
            told += f"; chi-squared {self.statistic:.4g} of {self.freedom}, p = {self.p_value:.2g}"
        if not self.parameters:
            return "Nothing can be compared: the estimates have no parameter in common."
        if not self.changed:
            jointly = "" if self.statistic is not None else ", each by itself"
            return f"No change beyond chance{jointly} ({told})."
        return f"Something has changed ({told})."

    def _title_and_rows(self) -> tuple[str, list[tuple[str, str]]]:
        rows = [("result", self.sentence), *(("finding", f.sentence) for f in self.findings)]
        for p in sorted(self.parameters, key=lambda p: not p.changed):
            half = NORMAL95 * p.sigma
            mark = ", changed" if p.changed else ""
            rows.append((p.name, f"{p.before:.6g} to {p.after:.6g} {p.unit} (± {half:.2g}{mark})"))
        return f"comparison of '{self.first}' and '{self.second}'", rows

    def to_dataframe(self) -> pd.DataFrame:
        """Return the parameters' changes as a table of pandas, by name.

        Columns: before, after, change, sigma, p_value, changed, unit.

        Raises:
            MissingDependencyError: pandas is not installed (``smsid[pandas]``).
        """
        columns = ("before", "after", "change", "sigma", "p_value", "changed", "unit")
        rows = [[getattr(p, c) for c in columns] for p in self.parameters]
        names = [p.name for p in self.parameters]
        return require("pandas", "pandas").DataFrame(rows, columns=list(columns), index=names)

    def to_json(self) -> str:
        """Return the JSON text; not-a-number is written as null."""
        document = {
            "schema": SCHEMA_VERSION,
            "kind": "comparison",
            "smsid": __version__,
            "first": self.first,
            "second": self.second,
            "changed": self.changed,
            "sentence": self.sentence,
            "chi_squared": {"value": self.statistic, "freedom": self.freedom, "p_value": self.p_value},
            "findings": [
                {
                    **asdict(f),
                    "quantities": [{**asdict(q), "interval": list(q.interval)} for q in f.quantities],
                }
                for f in self.findings
            ],
            "left_p_value": self.left,
            "parameters": [
                {**asdict(p), "change": p.change, "interval": list(p.interval), "interval_level": 0.95}
                for p in self.parameters
            ],
            "not_comparable": [asdict(n) for n in self.not_comparable],
            "notes": list(self.notes),
        }
        return json.dumps(json_ready(document), indent=1, allow_nan=False) + "\n"


NUMBERS = {"before", "after", "sigma", "p_value", "value"}
COMPARISON = TypeAdapter(Comparison)


def save_comparison(found: Comparison, path: str | os.PathLike[str]) -> None:
    """Write a comparison as JSON, whole or not at all."""
    atomic_write(Path(path), found.to_json())


def load_comparison(path: str | os.PathLike[str]) -> Comparison:
    """Load a comparison; raises `SmsidError` naming what is wrong with the file."""
    with reading_document(path, "comparison", "compare") as document:
        overall = document["chi_squared"]
        findings = document["findings"]
        quantities = [q for f in findings for q in f["quantities"]]
        for table in (*document["parameters"], *findings, *quantities):
            # a number that was written as null is not a number again
            table |= {k: math.nan for k in NUMBERS & table.keys() if table[k] is None}
        known = {"statistic": overall["value"], "freedom": overall["freedom"], "p_value": overall["p_value"]}
        return COMPARISON.validate_python({**document, **known, "left": document["left_p_value"]})
