"""The result of a diagnosis: verdict, causes, gain, what remains, and what could have been seen. JSON."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from smsid._files import atomic_write, json_ready
from smsid._listing import some_of
from smsid._reading import read_json
from smsid._short_repr import as_html, as_text
from smsid._statistics import NORMAL95
from smsid._version import __version__
from smsid.diagnose.validation import ChannelGain, Gain
from smsid.errors import SmsidError, require

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

SCHEMA_VERSION = 1
T = TypeVar("T")
Verdict = Literal["adequate", "explained", "unexplained", "not_evaluated"]


@dataclass(frozen=True)
class Value:
    """A parameter of a cause; for a nominal one that is wrong, ``nominal`` is what was believed."""

    name: str
    value: float
    sigma: float
    unit: str
    nominal: float | None = None
    profile: tuple[float, float] | None = None

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval: of the likelihood's ``profile`` where that is not Gaussian."""
        if self.profile is not None:
            return self.profile
        return self.value - NORMAL95 * self.sigma, self.value + NORMAL95 * self.sigma

    @property
    def spread(self) -> str:
        """The 95 % interval in words."""
        if self.profile is not None:
            return f"({self.profile[0]:.3g} to {self.profile[1]:.3g})"
        if not np.isfinite(self.sigma):
            return "(how well is not known)"
        return f"+- {NORMAL95 * self.sigma:.2g}"


def place_in_words(place: str, others: Sequence[str]) -> str:
    """Return a place in words, with others where the same error can do all that it does."""
    return place + (f" ({', '.join(others)} alike)" if others else "")


@dataclass(frozen=True)
class Alias:
    """Another effect that this experiment does not tell from the cause.

    ``correlation`` is that of their signatures, nominal parameters projected out; ``separate`` says which
    experiment would tell. ``also_at`` as in `FoundCause`.
    """

    effect: str
    location: str
    family: str
    shape: str
    correlation: float
    separate: str
    also_at: tuple[str, ...] = ()

    @property
    def places(self) -> str:
        """Where it is, and where it may be as well, in words."""
        return place_in_words(self.location, self.also_at)


@dataclass(frozen=True)
class FoundCause:
    """A named cause. ``shape`` is ``None`` when its siblings are not rejected: ``fitted`` says which of them
    the parameters are of. ``also_at`` are places where an error of the same kind can do all that it does to
    these readings: of base parameters, they are one with it. ``onset`` [s] if it began midway, and its
    standard deviation, which those of the parameters contain. ``evidence``: likelihood ratio, degrees of
    freedom, corrected p-value. ``recording``: where several were searched, the one it began in, or the only
    one it is in.
    """

    effect: str
    location: str
    family: str
    shape: str | None
    parameters: tuple[Value, ...]
    aliases: tuple[Alias, ...]
    evidence: Mapping[str, float]
    onset: float | None = None
    onset_sigma: float | None = None
    fitted: str = ""
    recording: str = ""
    also_at: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """The shape that is named; the family, and what was fitted, where none is."""
        return self.shape or (f"{self.family}, fitted as {self.fitted}" if self.fitted else self.family)

    @property
    def places(self) -> str:
        """Where it is, and where it may be as well, in words."""
        return place_in_words(self.location, self.also_at)


@dataclass(frozen=True)
class SignificantTest:
    """A significant generic test: equation or channel, what it depends on, corrected p-value."""

    where: str
    dependence: str
    ratio: float
    freedom: int
    p_value: float


@dataclass(frozen=True)
class Limit:
    """The least strength of a candidate that this recording would show with 95 % chance."""

    effect: str
    location: str
    shape: str
    parameter: str
    value: float
    unit: str


@dataclass(frozen=True, repr=False)
class Diagnosis:
    """What a recording says of a simulation.

    ``causes`` stand also where the verdict is ``unexplained``: they are proven where they show themselves,
    and something else is left. ``partial`` are candidates that explain a part where the whole stays
    unexplained: hints, no causes.
    ``tests`` are all generic tests by model, ``nominal`` before any cause and ``extended`` with the causes.
    """

    description: str
    recordings: tuple[str, ...]
    verdict: Verdict
    sentence: str
    priors: str = ""
    causes: tuple[FoundCause, ...] = ()
    partial: tuple[FoundCause, ...] = ()
    gain: Gain | None = None
    gain_reason: str = ""
    remaining: tuple[SignificantTest, ...] = ()
    limits: tuple[Limit, ...] = ()
    noise: Mapping[str, float] = field(default_factory=dict)
    whitened_rms: Mapping[str, float] = field(default_factory=dict)
    timing: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    tests: Mapping[str, tuple[SignificantTest, ...]] = field(default_factory=dict)

    @property
    def extends(self) -> bool:
        """Whether there is something to write into a description: all is explained, or a cause stands."""
        return self.verdict == "explained" or any("likelihood_ratio" in c.evidence for c in self.causes)

    def __repr__(self) -> str:
        return as_text(*self._title_and_rows())

    def _repr_html_(self) -> str:
        return as_html(*self._title_and_rows())

    def _title_and_rows(self) -> tuple[str, list[tuple[str, str]]]:
        rows = [("sentence", self.sentence)]
        for cause in self.causes:
            for p in cause.parameters:
                text = f"{p.name} = {p.value:.6g} {p.spread.replace('+-', '±')} {p.unit}"
                rows.append((f"{cause.label} at {cause.location}", text))
        if self.gain is not None:
            rows.append(("gain", self.gain.in_words(extends=bool(self.causes))))
        return f"diagnosis of '{self.description}' from {some_of(self.recordings)}: {self.verdict}", rows

    def to_dataframe(self) -> pd.DataFrame:
        """Return the causes' parameters as a table of pandas.

        Columns: cause, location, parameter, value, sigma, low, high (95 %), unit, nominal.

        Raises:
            MissingDependencyError: pandas is not installed (``smsid[pandas]``).
        """
        columns = ("cause", "location", "parameter", "value", "sigma", "low", "high", "unit", "nominal")
        rows = [
            (c.label, c.location, p.name, p.value, p.sigma, *p.interval, p.unit, p.nominal)
            for c in self.causes
            for p in c.parameters
        ]
        return require("pandas", "pandas").DataFrame(rows, columns=list(columns))

    def plot(self) -> Figure:
        """Return a figure: the maps of equation by dependence, before any cause and with the causes.

        Raises:
            MissingDependencyError: matplotlib is not installed (``smsid[plot]``).
            SmsidError: nothing was tested.
        """
        from smsid.figures.draw import diagnosis_figure

        return diagnosis_figure(self)

    def to_json(self) -> str:
        """Return the JSON text; not-a-number is written as null."""
        document = {
            "schema": SCHEMA_VERSION,
            "kind": "diagnosis",
            "smsid": __version__,
            "description": self.description,
            "recordings": list(self.recordings),
            "verdict": self.verdict,
            "sentence": self.sentence,
            "priors": self.priors,
            "causes": [_table(c) for c in self.causes],
            "partial": [_table(c) for c in self.partial],
            "gain": self._gain(),
            "remaining": [asdict(r) for r in self.remaining],
            "tests": {k: [asdict(t) for t in found] for k, found in self.tests.items()},
            "limits": [asdict(x) for x in self.limits],
            "noise": {k: {"value": v, "unit": "of the stated"} for k, v in self.noise.items()},
            "whitened_rms": {k: {"value": v, "unit": "1"} for k, v in self.whitened_rms.items()},
            "timing": {k: {"value": v, "unit": "s of CPU"} for k, v in self.timing.items()},
            "notes": list(self.notes),
        }
        return json.dumps(json_ready(document), indent=1, allow_nan=False) + "\n"

    def _gain(self) -> dict[str, Any]:
        if self.gain is None:
            return {"status": "not_evaluated", "reason": self.gain_reason}
        return {"status": "evaluated", **asdict(self.gain), "explained": self.gain.explained}


def _table(cause: FoundCause) -> dict[str, Any]:
    table = asdict(cause)
    for entry, value in zip(table["parameters"], cause.parameters, strict=True):
        entry["interval"], entry["interval_level"] = list(value.interval), 0.95
    return table


def save_diagnosis(diagnosis: Diagnosis, path: str | os.PathLike[str]) -> None:
    """Write the diagnosis as JSON, whole or not at all."""
    atomic_write(Path(path), diagnosis.to_json())


def load_diagnosis(path: str | os.PathLike[str]) -> Diagnosis:
    """Load a diagnosis that `save_diagnosis` wrote; raises `SmsidError` saying what is wrong with it."""
    file = Path(path)
    document = read_json(file)
    if not isinstance(document, dict) or document.get("kind") != "diagnosis":
        raise SmsidError(f"'{file}' is no diagnosis.", advice="Run `smsid diagnose` to make one.")
    try:
        return _diagnosis(document)
    except (KeyError, TypeError, AttributeError) as error:
        raise SmsidError(
            f"'{file}' is a diagnosis, but not whole: {error}.", advice="Run `smsid diagnose` again."
        ) from error


def _diagnosis(document: Mapping[str, Any]) -> Diagnosis:
    gain = document["gain"]
    channels = tuple(_from_table(ChannelGain, c) for c in gain.get("channels", ()))
    tests = document.get("tests") or {}
    return _from_table(
        Diagnosis,
        document,
        recordings=tuple(document["recordings"]),
        causes=tuple(map(_cause, document["causes"])),
        partial=tuple(map(_cause, document.get("partial", ()))),
        gain=_from_table(Gain, gain, channels=channels) if gain["status"] == "evaluated" else None,
        gain_reason=gain.get("reason", ""),
        remaining=tuple(_from_table(SignificantTest, r) for r in document["remaining"]),
        limits=tuple(_from_table(Limit, x) for x in document["limits"]),
        notes=tuple(document["notes"]),
        tests={k: tuple(_from_table(SignificantTest, t) for t in found) for k, found in tests.items()},
        **{k: {n: x["value"] for n, x in document[k].items()} for k in ("noise", "whitened_rms", "timing")},
    )


def _cause(table: Mapping[str, Any]) -> FoundCause:
    values = tuple(_value(p) for p in table["parameters"])
    aliases = tuple(_from_table(Alias, a, also_at=_also(a)) for a in table["aliases"])
    return _from_table(FoundCause, table, parameters=values, aliases=aliases, also_at=_also(table))


def _also(table: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(table.get("also_at", ()))


def _value(table: Mapping[str, Any]) -> Value:
    ends = table.get("profile")
    low, high = ends or (None, None)
    limits = (-np.inf if low is None else low, np.inf if high is None else high)
    return _from_table(Value, table, profile=limits if ends else None)


def _from_table(kind: type[T], table: Mapping[str, Any], **own: Any) -> T:
    """Return a dataclass from a table of JSON, where numbers that are not finite are null."""
    found = {
        f.name: float("nan") if table[f.name] is None and f.type == "float" else table[f.name]
        for f in fields(kind)  # type: ignore[arg-type]
        if f.name in table
    }
    return kind(**{**found, **own})
