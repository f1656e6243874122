"""The result of an identification: every parameter with value, unit, interval and status."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from smsid._by_name import ByName, no_such_name
from smsid._files import atomic_write
from smsid.errors import EstimateError
from smsid.identify.parameter_estimate import (
    IDENTIFIABLE_BELOW,
    ParameterEstimate,
    Status,
    classify,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = [
    "IDENTIFIABLE_BELOW",
    "Estimate",
    "Iteration",
    "ParameterEstimate",
    "Status",
    "classify",
    "distinct",
    "load_estimate",
    "save_estimate",
]

BY_PRODUCT_GROUPS = ("nuisance", "exp2.step_a", "exp2.step_b_printed", "exp2.pose_point")
"""Groups that are by-products, or other views of what another group holds."""
AS_PRINTED = "as printed: "  # leads the names of the paper's pi_m, whose combinations are another step's too
CONSISTENT = 1e-6  # relative: how far the covariance's diagonal may be from the squared standard deviations


@dataclass(frozen=True)
class Iteration:
    """One iteration of a search: ``cost`` is the sum of squares per sample, by the noise found at its end.

    ``step`` is the step that led there: of all parameters the largest, in standard deviations of the
    estimate; ``None`` where a search starts.
    """

    cost: float
    step: float | None


HELD = "held joint "
"""How the name of a condition begins that is the position of a held joint."""

SHAPE = "shape "
"""The same of a rate [rad/s | m/s] that an effect's torque is not linear in: ``shape <effect>.<field>``."""


@dataclass(frozen=True, repr=False)
class Estimate(ByName[ParameterEstimate]):
    """An identified spacecraft, arm or structure; its parameters have names of their own.

    ``parameters`` in the order they were found; ``timing`` [s] by step; ``notes`` say what was refused and
    why; ``history`` tells how a method that iterates got there. ``covariance`` (n, n) is that of the n
    parameters, in order, in products of their units, read-only; not-a-number where a parameter has none, and
    ``None`` where the method does not know how errors go together.

    Raises:
        EstimateError: two parameters share a name, or the covariance is not that of the parameters.
    """

    description: str
    method: str
    parameters: tuple[ParameterEstimate, ...]
    recordings: tuple[str, ...] = ()
    timing: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    conditions: Mapping[str, float] = field(default_factory=dict)
    history: tuple[Iteration, ...] = ()
    covariance: np.ndarray | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        for name in ("parameters", "recordings", "notes", "history"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for name in ("timing", "conditions"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        groups: dict[str, list[str]] = {}
        for p in self.parameters:
            groups.setdefault(p.name, []).append(p.group)
        shared = {name: tuple(found) for name, found in groups.items() if len(found) > 1}
        if shared:
            name, found = next(iter(shared.items()))
            raise EstimateError(
                f"{len(found)} parameters of the estimate are called '{name}' (groups {', '.join(found)}).",
                advice="Give every parameter a name of its own; rename an effect that is named like another.",
                shared=shared,
            )
        if self.covariance is not None:
            object.__setattr__(self, "covariance", _check_covariance(self.covariance, self.parameters))

    def __reduce__(self) -> tuple[Any, ...]:
        own = (self.description, self.method, self.parameters, self.recordings, dict(self.timing))
        return (Estimate, (*own, self.notes, dict(self.conditions), self.history, self.covariance))

    def __getitem__(self, name: str) -> ParameterEstimate:
        """Give the parameter of a name; raise `KeyError` naming the nearest where there is none."""
        for p in self.parameters:
            if p.name == name:
                return p
        no_such_name(name, self.names)

    def keys(self) -> tuple[str, ...]:
        """Return the names of the parameters, which ``for`` gives; their objects are in ``parameters``."""
        return self.names

    @property
    def held(self) -> dict[str, float]:
        """Return the positions [rad | m] of joints that were held: what is beyond them is part of links."""
        return {k.removeprefix(HELD): x for k, x in self.conditions.items() if k.startswith(HELD)}

    @property
    def shapes(self) -> dict[str, float]:
        """Return the rates [rad/s | m/s] ``<effect>.<field>`` found beside parameters: widths of a sign."""
        return {k.removeprefix(SHAPE): x for k, x in self.conditions.items() if k.startswith(SHAPE)}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters (n,), each once."""
        return tuple(p.name for p in self.parameters)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the parameters (n,)."""
        return tuple(p.unit for p in self.parameters)

    @property
    def values(self) -> np.ndarray:
        """Values of the parameters (n,), each in its unit."""
        return np.array([p.value for p in self.parameters], dtype=float)

    @property
    def sigmas(self) -> np.ndarray:
        """Standard deviations of the parameters (n,), each in its unit."""
        return np.array([p.sigma for p in self.parameters], dtype=float)

    @property
    def intervals(self) -> np.ndarray:
        """Ends of the 95 % intervals (n, 2), each in its parameter's unit."""
        return np.array([p.interval for p in self.parameters], dtype=float).reshape(-1, 2)

    def correlation(self, first: str, second: str) -> float:
        """Return the correlation of two parameters' errors.

        Raises:
            KeyError: there is no such parameter.
            EstimateError: the estimate has no covariance.
        """
        if self.covariance is None:
            raise EstimateError(
                f"The estimate by {self.method} has no covariance.",
                advice="Identify by maximum likelihood; files of earlier versions have none either.",
            )
        i, j = self.names.index(self[first].name), self.names.index(self[second].name)
        return float(self.covariance[i, j] / np.sqrt(self.covariance[i, i] * self.covariance[j, j]))

    def group(self, name: str) -> tuple[ParameterEstimate, ...]:
        """Return the parameters of one group."""
        return tuple(p for p in self.parameters if p.group == name)

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the groups, in the order of the parameters."""
        return tuple(dict.fromkeys(p.group for p in self.parameters))

    def to_json(self) -> str:
        """Return the JSON text; not-a-number is written as null."""
        from smsid.identify._estimate_file import estimate_json

        return estimate_json(self)

    def to_dataframe(self) -> pd.DataFrame:
        """Return the parameters as a table of pandas, by name.

        Columns: value, sigma, low, high (95 %), unit, status, described, group, note.

        Raises:
            MissingDependencyError: pandas is not installed (``smsid[pandas]``).
        """
        from smsid.identify.estimate_text import dataframe

        return dataframe(self)

    def plot(self, truth: Estimate | None = None) -> Figure:
        """Return a figure of the parameters with their intervals, beside true values where given.

        Raises:
            MissingDependencyError: matplotlib is not installed (``smsid[plot]``).
        """
        from smsid.figures.draw import estimate_figure

        return estimate_figure(self, truth)

    def __repr__(self) -> str:
        from smsid.identify.estimate_text import text

        return text(self)

    def _repr_html_(self) -> str:
        from smsid.identify.estimate_text import html

        return html(self)


def _check_covariance(covariance: Any, parameters: tuple[ParameterEstimate, ...]) -> np.ndarray:
    """Return a read-only symmetric copy of a covariance, or raise `EstimateError`."""
    found = np.array(covariance, dtype=float)
    n = len(parameters)
    if found.shape != (n, n):
        raise EstimateError(
            f"The covariance has shape {found.shape}; the estimate has {n} parameters.",
            advice="Give a row and a column to each parameter, in order.",
            shape=found.shape,
        )
    scale = np.sqrt(np.abs(np.outer(np.diag(found), np.diag(found))))
    with np.errstate(invalid="ignore"):
        skew = np.abs(found - found.T) > CONSISTENT * scale
    if skew.any():
        i, j = (int(k) for k in np.argwhere(skew)[0])
        raise EstimateError(
            f"The covariance of '{parameters[i].name}' and '{parameters[j].name}' is {found[i, j]:.6g} one "
            f"way and {found[j, i]:.6g} the other.",
            advice="A covariance is symmetric.",
        )
    for p, variance in zip(parameters, np.diag(found), strict=True):
        both = np.isfinite(p.sigma) and np.isfinite(variance)
        if both and abs(p.sigma**2 - variance) > 2.0 * CONSISTENT * max(p.sigma**2, abs(variance)):
            raise EstimateError(
                f"The standard deviation of '{p.name}' is {p.sigma:.6g}, that of the covariance "
                f"{np.sqrt(max(variance, 0.0)):.6g}.",
                advice="Give the covariance in the order of the parameters.",
                name=p.name,
            )
    found = 0.5 * (found + found.T)
    found.setflags(write=False)
    return found


def distinct(names: Iterable[str]) -> list[str]:
    """Return the names, those that repeat with a number: ``exp1``, ``exp1 (2)``."""
    out: list[str] = []
    for name in names:
        own, k = name, 1
        while own in out:
            k += 1
            own = f"{name} ({k})"
        out.append(own)
    return out


def with_distinct_names(parameters: Iterable[ParameterEstimate]) -> tuple[ParameterEstimate, ...]:
    """Return parameters of which no two share a name, as files of earlier versions hold them.

    Of two groups that share one, the later is named by its group; within a group, by a number.
    """
    found = tuple(parameters)
    owner: dict[str, str] = {}
    names = []
    for p in found:
        if owner.setdefault(p.name, p.group) == p.group:
            names.append(p.name)
        else:
            names.append(f"{AS_PRINTED if p.group == 'exp2.step_b_printed' else f'{p.group}: '}{p.name}")
    return tuple(replace(p, name=n) for p, n in zip(found, distinct(names), strict=True))


def save_estimate(estimate: Estimate, path: str | os.PathLike[str]) -> None:
    """Write the estimate as JSON, whole or not at all."""
    atomic_write(Path(path), estimate.to_json())


def load_estimate(path: str | os.PathLike[str]) -> Estimate:
    """Load an estimate; raises `SmsidError` naming what is wrong with the file."""
    from smsid.identify._estimate_file import read_estimate

    return read_estimate(Path(path))
