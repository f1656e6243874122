"""What a campaign says about a method: bias, spread, and whether its intervals hold."""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace

import numpy as np
from pydantic import TypeAdapter
from scipy import stats

from smsid._by_name import ByName, no_such_name
from smsid._files import atomic_write
from smsid._reading import reading_document
from smsid._short_repr import short_repr
from smsid._statistics import NORMAL95
from smsid.campaign.outcome import Outcome, RunRecord
from smsid.errors import ExperimentError

Band = tuple[float, float]


@dataclass(frozen=True)
class ParameterSummary:
    """One parameter over all runs that have it.

    ``runs`` have it finite, in ``not_finite`` more it was not (or its sigma), in ``missing`` the method did
    not give it. ``truth`` is the mean true value and ``truth_spread`` its standard deviation over runs.
    ``mean_error`` and ``spread`` are mean and standard deviation (n - 1) of value minus truth; without a
    truth, ``spread`` is that of the value. ``mean_sigma`` is the mean predicted standard deviation, ``ratio``
    is ``spread / mean_sigma`` and ``ratio_band`` where it lies when both agree (chi-squared). ``bias`` is
    ``mean_error / spread``. ``covered`` counts truths inside the 95 % interval, ``coverage_band`` is where
    the fraction lies when intervals hold (binomial). Both bands hold for all parameters at once, at the
    family-wise level of the summary. What cannot be told is ``None``.
    """

    name: str
    unit: str
    group: str
    runs: int
    not_finite: int
    missing: int
    identifiable: int
    mean: float | None
    truth: float | None
    truth_spread: float | None
    mean_error: float | None
    spread: float | None
    bias: float | None
    mean_sigma: float | None
    ratio: float | None
    ratio_band: Band | None
    covered: int | None
    coverage: float | None
    coverage_band: Band | None

    @property
    def coverage_holds(self) -> bool | None:
        """Whether the coverage is within its band; ``None`` when it was not evaluated."""
        return _inside(self.coverage, self.coverage_band)

    @property
    def ratio_holds(self) -> bool | None:
        """Whether spread and prediction agree within the band; ``None`` when it was not evaluated."""
        return _inside(self.ratio, self.ratio_band)


@dataclass(frozen=True)
class Failure:
    """How many runs ended in one kind of error, the first of them and its message."""

    type: str
    count: int
    run: int
    message: str


@short_repr
@dataclass(frozen=True)
class Summary(ByName[ParameterSummary]):
    """A campaign in figures. ``level`` is the family-wise probability that a band is left by chance."""

    runs: int
    failures: tuple[Failure, ...]
    parameters: tuple[ParameterSummary, ...]
    level: float
    seconds: float

    @property
    def failed(self) -> int:
        """Number of runs that ended in an error."""
        return sum(f.count for f in self.failures)

    def keys(self) -> tuple[str, ...]:
        """Return the names of the parameters."""
        return tuple(p.name for p in self.parameters)

    def __getitem__(self, name: str) -> ParameterSummary:
        """Give the parameter of a name; raise `KeyError` where there is none."""
        for p in self.parameters:
            if p.name == name:
                return p
        no_such_name(name, self.keys())

    def to_json(self) -> str:
        """Return the JSON text, with whether the bands hold; what cannot be told is null."""
        tables = [
            {**asdict(p), "coverage_holds": p.coverage_holds, "ratio_holds": p.ratio_holds}
            for p in self.parameters
        ]
        document = {"schema": 1, "kind": "campaign_summary", **asdict(self), "parameters": tables}
        return json.dumps(document, indent=1, allow_nan=False) + "\n"


_SUMMARY = TypeAdapter(Summary)


def summarise(records: Iterable[RunRecord], *, level: float = 0.01) -> Summary:
    """Summarise runs; the order they come in does not matter, to the last bit.

    ``level`` [1]: family-wise level of the bands, shared out equally among parameters (Bonferroni), for
    coverage and ratio each. Holds four numbers per run and parameter. Raises `ExperimentError` for a level
    outside (0, 1).
    """
    if not 0.0 < level < 1.0:
        raise ExperimentError(f"The family-wise level is {level}.", advice="Give one between 0 and 1.")
    columns: dict[tuple[str, str], _Column] = {}  # Steps of one method may use a name twice
    failures: dict[str, list[tuple[int, str]]] = {}
    good, seconds = 0, []
    for record in records:
        seconds.append(record.seconds)
        if not record.ok:
            error = record.error
            kind, message = (error.type, error.message) if error else ("unknown", "")
            failures.setdefault(kind, []).append((record.run, message))
            continue
        good += 1
        for place, outcome in enumerate(record.outcomes):
            column = columns.setdefault((outcome.group, outcome.name), _Column(outcome))
            column.add(record.run, place, outcome)
    columns = dict(sorted(columns.items(), key=lambda item: item[1].place))
    tested = {kind: max(1, sum(c.testable(kind) for c in columns.values())) for kind in ("coverage", "ratio")}
    parameters = tuple(
        c.summary(good, level / tested["coverage"], level / tested["ratio"]) for c in columns.values()
    )
    # stores of earlier versions hold a name in two groups; in a summary it is one parameter's
    owner = {p.name: p.group for p in reversed(parameters)}
    parameters = tuple(
        p if owner[p.name] == p.group else replace(p, name=f"{p.group}: {p.name}") for p in parameters
    )
    told = [Failure(kind, len(found), *min(found)) for kind, found in sorted(failures.items())]
    runs = good + sum(f.count for f in told)
    return Summary(runs, tuple(told), parameters, level, math.fsum(seconds))


def save_summary(summary: Summary, path: str | os.PathLike[str]) -> None:
    """Write the summary as JSON, whole or not at all."""
    atomic_write(path, summary.to_json())


def load_summary(path: str | os.PathLike[str]) -> Summary:
    """Load a summary; raises `SmsidError` for a file that is none."""
    with reading_document(path, "campaign_summary", "campaign") as document:
        return _SUMMARY.validate_python(document)


def coverage_band(runs: int, level: float) -> Band:
    """Return what a coverage of 95 % lies between (low, high) [1], with probability 1 - ``level`` or more."""
    low, high = stats.binom.ppf([level / 2, 1 - level / 2], runs, 0.95)
    return float(low) / runs, float(high) / runs


def ratio_band(runs: int, level: float) -> Band:
    """Return where a sample standard deviation of ``runs`` normal errors over the true one lies [1]."""
    low, high = np.sqrt(stats.chi2.ppf([level / 2, 1 - level / 2], runs - 1) / (runs - 1))
    return float(low), float(high)


class _Column:
    """The outcomes of one parameter."""

    def __init__(self, first: Outcome) -> None:
        self.name, self.unit, self.group = first.name, first.unit, first.group
        self.rows: list[tuple[int, float, float, float]] = []  # run, value, truth, sigma; NaN: none
        self.covered: Counter[bool] = Counter()
        self.not_finite = 0
        self.identifiable = 0
        self.place: tuple[float, int] = (math.inf, 0)

    def add(self, run: int, place: int, outcome: Outcome) -> None:
        self.place = min(self.place, (run, place))
        self.identifiable += outcome.status == "identifiable"
        sigma = math.nan if outcome.sigma is None else outcome.sigma
        truth = math.nan if outcome.truth is None else outcome.truth
        if not math.isfinite(outcome.value) or (outcome.sigma is not None and not math.isfinite(sigma)):
            self.not_finite += 1
            return
        self.rows.append((run, outcome.value, truth, sigma))
        interval = outcome.interval
        if interval is None and outcome.sigma is not None:
            interval = outcome.value - NORMAL95 * sigma, outcome.value + NORMAL95 * sigma
        if interval is not None and math.isfinite(truth):
            self.covered[interval[0] <= truth <= interval[1]] += 1

    def testable(self, kind: str) -> bool:
        if kind == "coverage":
            return self.covered.total() > 0
        _, truth, sigma = self._arrays()
        return len(truth) > 1 and bool(np.isfinite(truth).all() and np.mean(sigma) > 0.0)

    def summary(self, good: int, coverage_level: float, ratio_level: float) -> ParameterSummary:
        value, truth, sigma = self._arrays()
        n, tested = len(value), self.covered.total()
        known = n > 0 and bool(np.isfinite(truth).all())
        error = value - truth if known else value
        spread = _number(np.std(error, ddof=1)) if n > 1 else None
        mean_error = _number(np.mean(error)) if known else None
        mean_sigma = _number(np.mean(sigma)) if n else None
        ratio = self.testable("ratio") and spread is not None and mean_sigma is not None
        return ParameterSummary(
            name=self.name,
            unit=self.unit,
            group=self.group,
            runs=n,
            not_finite=self.not_finite,
            missing=good - n - self.not_finite,
            identifiable=self.identifiable,
            mean=_number(np.mean(value)) if n else None,
            truth=_number(np.mean(truth)) if known else None,
            truth_spread=_number(np.std(truth, ddof=1)) if known and n > 1 else None,
            mean_error=mean_error,
            spread=spread,
            bias=mean_error / spread if mean_error is not None and spread else None,
            mean_sigma=mean_sigma,
            ratio=spread / mean_sigma if ratio and spread is not None and mean_sigma else None,
            ratio_band=ratio_band(n, ratio_level) if ratio else None,
            covered=self.covered[True] if tested else None,
            coverage=self.covered[True] / tested if tested else None,
            coverage_band=coverage_band(tested, coverage_level) if tested else None,
        )

    def _arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        table = np.array(sorted(self.rows, key=lambda row: row[0]), dtype=float).reshape(-1, 4)
        return table[:, 1], table[:, 2], table[:, 3]


def _number(x: float | np.floating) -> float | None:
    return float(x) if math.isfinite(x) else None


def _inside(value: float | None, band: Band | None) -> bool | None:
    return None if value is None or band is None else band[0] <= value <= band[1]
