"""Axes of Exp. 1 brought together: what they share is averaged, after a test that they agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from smsid._by_name import ByName, no_such_name
from smsid._short_repr import short_repr
from smsid.identify.paper._translation import AxisEstimate

CONTRADICTION = 1e-3  # probability below which axes that agree are said to contradict each other
ACCURACY = 1e-3  # of a value: what filters' ends and interpolated clocks leave without any noise


@dataclass(frozen=True)
class AxisAgreement:
    """Whether axes agree in a parameter they share: ``values`` and ``sigma`` by axis, and the test's result.

    ``chi_squared`` of the values about their mean has ``freedom`` degrees; ``probability`` is that of one as
    large if the axes agree.
    """

    name: str
    axes: tuple[str, ...]
    values: tuple[float, ...]
    sigma: tuple[float, ...]
    chi_squared: float
    freedom: int
    probability: float

    @property
    def contradicts(self) -> bool:
        """Whether the axes do not agree: then there is no one value that all of them measure."""
        return self.probability < CONTRADICTION

    @property
    def birge_ratio(self) -> float:
        """How far the axes are apart in units of their standard deviations: what the mean's is off by."""
        values, weight = np.array(self.values), 1.0 / np.array(self.sigma) ** 2
        off = values - np.sum(weight * values) / np.sum(weight)
        return float(np.sqrt(np.sum(weight * off**2) / self.freedom))

    def __str__(self) -> str:
        told = ", ".join(
            f"{a} {v:.6g} +- {s:.2g}" for a, v, s in zip(self.axes, self.values, self.sigma, strict=True)
        )
        return (
            f"the axes contradict each other in {self.name}: {told} (chi-squared {self.chi_squared:.3g} with "
            f"{self.freedom} degrees of freedom)"
        )


@short_repr
@dataclass(frozen=True)
class CombinedAxes(ByName[tuple[float, float]]):
    """Parameters of several axes brought together: those that axes share are averaged where they agree.

    ``names``: the shared ones as they are (``M``, ``m_s``, ``rho``), the others with their axis (``k_s.x``).
    ``agreements``: the test of every shared one that several axes tell. Where it fails, the standard
    deviation is widened until it holds (Birge's ratio), and nobody should call the mean identified.
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    agreements: tuple[AxisAgreement, ...] = ()

    @property
    def contradictions(self) -> dict[str, AxisAgreement]:
        """Return, by name, the shared parameters in which axes contradict each other."""
        return {a.name: a for a in self.agreements if a.contradicts}

    def keys(self) -> tuple[str, ...]:
        """Return the names of the parameters."""
        return self.names

    def __getitem__(self, name: str) -> tuple[float, float]:
        """Return value and standard deviation."""
        if name not in self.names:
            no_such_name(name, self.names)
        i = self.names.index(name)
        return float(self.values[i]), float(np.sqrt(self.covariance[i, i]))

    def directions(self) -> list[dict[str, float]]:
        """Return changes of the parameters, by name, whose outer products add up to the covariance.

        Principal directions of the correlations, so that units and the described density do not matter.
        """
        sigma = np.sqrt(np.diag(self.covariance))
        scale = np.where(sigma > 0.0, sigma, 1.0)
        size, vectors = np.linalg.eigh(self.covariance / np.outer(scale, scale))
        moves = scale[:, None] * vectors * np.sqrt(np.maximum(size, 0.0))
        return [dict(zip(self.names, column, strict=True)) for column in moves.T]


def is_shared(name: str) -> bool:
    """Return whether all axes tell a parameter: M, a tank's mass, a panel's density."""
    return name == "M" or name.startswith(("rho", "m_s"))


def combine(estimates: Sequence[AxisEstimate]) -> CombinedAxes:
    """Bring axes together; shared parameters are weighed by their variances, not-a-number is left out.

    Whether the axes agree is tested first (chi-squared, `CONTRADICTION`), each to no better than `ACCURACY`.
    """
    if not estimates:
        return CombinedAxes((), np.zeros(0), np.zeros((0, 0)))
    rows: dict[str, list[tuple[int, int]]] = {}
    for e, estimate in enumerate(estimates):
        for i, name in enumerate(estimate.names):
            if np.isfinite(estimate.values[i]) and np.isfinite(estimate.covariance[i, i]):
                own = name if is_shared(name) else f"{name}.{estimate.axis}"
                rows.setdefault(own, []).append((e, i))
    offsets = np.cumsum([0, *(len(e.names) for e in estimates)])
    weights = np.zeros((len(rows), offsets[-1]))
    widened, agreements = np.ones(len(rows)), []
    for r, (name, places) in enumerate(rows.items()):
        share = np.array([1.0 / estimates[e].covariance[i, i] for e, i in places])
        for (e, i), w in zip(places, share / share.sum(), strict=True):
            weights[r, offsets[e] + i] = w
        if len(places) > 1:
            found = _agreement(name, [(estimates[e], i) for e, i in places])
            agreements.append(found)
            if found.contradicts:
                widened[r] = found.birge_ratio
    stacked = np.nan_to_num(np.concatenate([e.values for e in estimates]))
    full = np.zeros((offsets[-1], offsets[-1]))
    for e, estimate in enumerate(estimates):
        full[offsets[e] : offsets[e + 1], offsets[e] : offsets[e + 1]] = np.nan_to_num(estimate.covariance)
    covariance = weights @ full @ weights.T * np.outer(widened, widened)
    return CombinedAxes(tuple(rows), weights @ stacked, covariance, tuple(agreements))


def _agreement(name: str, places: Sequence[tuple[AxisEstimate, int]]) -> AxisAgreement:
    values = np.array([e.values[i] for e, i in places])
    sigma = np.array([np.sqrt(e.covariance[i, i]) for e, i in places])
    spread = np.hypot(sigma, ACCURACY * np.abs(values).max())
    mean = float(np.sum(values / spread**2) / np.sum(1.0 / spread**2))
    chi_squared, freedom = float(np.sum(((values - mean) / spread) ** 2)), len(values) - 1
    return AxisAgreement(
        name,
        tuple(e.axis for e, _ in places),
        tuple(values.tolist()),
        tuple(sigma.tolist()),
        chi_squared,
        freedom,
        float(chdtrc(freedom, chi_squared)),
    )
