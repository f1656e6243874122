"""The parameters of two estimates in terms that both know: by name, or as combinations of combinations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from smsid.comparison.result import NotComparable
from smsid.estimation.inertial_combinations import about_centre
from smsid.identify.estimate import BY_PRODUCT_GROUPS, Estimate
from smsid.identify.parameter_estimate import parse_combination
from smsid.model.regressor import INERTIAL_NAMES

ROUNDED = 5e-5  # factors in names have four digits
NEAR = 1e-3  # largest difference of a factor, relative to what the parameter's factors are elsewhere
SAME_FACTOR = 2.0 * ROUNDED  # relative difference of factors of one combination named twice
DERIVED = 0.1  # share of a standard deviation that factors which do not quite fit may bring
TOTAL = "total.mass"


@dataclass(frozen=True)
class Side:
    """One estimate made ready: names, values (n,), covariance (n, n) and factors (n, p) on ``elements``.

    Of a name that is no combination the only element is itself. ``joint`` says whether the covariance is
    whole; without it is the diagonal one.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    factors: np.ndarray
    joint: bool


@dataclass(frozen=True)
class _Row:
    """A comparison: weights of the first's parameters and of the second's, and factors on the elements."""

    name: str
    unit: str
    left: np.ndarray
    right: np.ndarray
    factors: np.ndarray
    derived: bool = False


@dataclass(frozen=True)
class Common:
    """What both estimates know: values (n,), (n,) and covariances, in the order of ``names``.

    ``factors`` (n, p) are on ``elements``; ``derived`` (n,) are those that one of them does not name.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    before: np.ndarray
    after: np.ndarray
    covariances: tuple[np.ndarray, np.ndarray]
    factors: np.ndarray
    elements: tuple[str, ...]
    derived: np.ndarray
    not_comparable: tuple[NotComparable, ...]
    joint: bool


def common_basis(first: Estimate, second: Estimate, sizes: Mapping[str, float] | None = None) -> Common:
    """Return the parameters that both estimates know.

    By-products (biases, the state at a recording's start) belong to recordings and are left out. A
    combination that the other estimate has under another name is sought among the combinations of its
    combinations; of a body that one estimate tells about its centre of mass alone, the other is put so, too.
    ``sizes`` are values of elements as described, by name, which say how much a factor that
    does not quite fit matters.
    """
    first, second = in_terms_of(first, second), in_terms_of(second, first)
    terms = [_terms(e) for e in (first, second)]
    elements = tuple(dict.fromkeys(n for own in terms for t in own.values() for n in t))
    sides = [_side(e, t, elements) for e, t in zip((first, second), terms, strict=True)]
    size = _sizes(sides, elements, sizes or {})
    rows: list[_Row] = []
    refused: list[NotComparable] = []
    a, b = sides
    taken: set[int] = set()
    for i, name in enumerate(a.names):
        j = _find_row(a.factors[i], b.factors, taken)
        if j is not None and b.units[j] == a.units[i]:
            taken.add(j)
            left, right = np.eye(len(a.names))[i], np.eye(len(b.names))[j]
            rows.append(_Row(name, a.units[i], left, right, a.factors[i]))
    known = {r.name for r in rows}
    lone: list[tuple[Literal["first", "second"], int]] = []
    lone.extend(("first", i) for i, n in enumerate(a.names) if n not in known)
    lone.extend(("second", j) for j in range(len(b.names)) if j not in taken)
    for which, k in lone:
        own, other = (a, b) if which == "first" else (b, a)
        weights, why = _made_of(own, k, other, size)
        if weights is None:
            refused.append(NotComparable(own.names[k], which, why))
            continue
        unit = np.eye(len(own.names))[k]
        pair = (unit, weights) if which == "first" else (weights, unit)
        row = _Row(own.names[k], own.units[k], *pair, own.factors[k], derived=True)
        if _is_new(row, rows):
            rows.append(row)
    endless = "its interval has no end"
    refused.extend(NotComparable(p.name, "first", endless) for p in first.parameters if p.sigma == np.inf)
    refused.extend(NotComparable(p.name, "second", endless) for p in second.parameters if p.sigma == np.inf)
    left = np.array([r.left for r in rows]).reshape(len(rows), len(a.names))
    right = np.array([r.right for r in rows]).reshape(len(rows), len(b.names))
    return Common(
        tuple(r.name for r in rows),
        tuple(r.unit for r in rows),
        left @ a.values,
        right @ b.values,
        (left @ a.covariance @ left.T, right @ b.covariance @ right.T),
        np.array([r.factors for r in rows]).reshape(len(rows), len(elements)),
        elements,
        np.array([r.derived for r in rows], dtype=bool),
        tuple(refused),
        a.joint and b.joint,
    )


def inertial_element(name: str) -> tuple[str, int] | None:
    """Return body and number (0 to 9) of an inertial parameter; None for any other element."""
    body, _, symbol = name.rpartition(".")
    return (body, INERTIAL_NAMES.index(symbol)) if body and symbol in INERTIAL_NAMES else None


def _terms(estimate: Estimate) -> dict[str, dict[str, float]]:
    """Return the factors of every parameter that belongs to the spacecraft, by name."""
    out = {}
    for p in estimate.parameters:
        by_product = p.group in BY_PRODUCT_GROUPS or p.status in ("by_product", "known")
        if by_product or not np.isfinite(p.value) or not 0.0 < p.sigma < np.inf:
            continue
        found = parse_combination(p.name)
        linear = found is not None and any(inertial_element(n) for n in found)  # a rotor may be among them
        out[p.name] = found if linear and found is not None else {p.name: 1.0}
    return out


def _side(estimate: Estimate, terms: Mapping[str, dict[str, float]], elements: Sequence[str]) -> Side:
    index = [i for i, p in enumerate(estimate.parameters) if p.name in terms]
    chosen = [estimate.parameters[i] for i in index]
    sigma = np.array([p.sigma for p in chosen], dtype=float)
    covariance, joint = np.diag(sigma**2), False
    if estimate.covariance is not None:
        whole = estimate.covariance[np.ix_(index, index)]
        joint = bool(np.isfinite(whole).all())
        covariance = whole if joint else covariance
    place = {n: k for k, n in enumerate(elements)}
    factors = np.zeros((len(chosen), len(elements)))
    for i, p in enumerate(chosen):
        for n, x in terms[p.name].items():
            factors[i, place[n]] = x
    names, units = tuple(p.name for p in chosen), tuple(p.unit for p in chosen)
    return Side(names, units, np.array([p.value for p in chosen], dtype=float), covariance, factors, joint)


def _sizes(sides: Sequence[Side], elements: Sequence[str], known: Mapping[str, float]) -> np.ndarray:
    """Return how large elements are (p,): as described, or as the largest combination they lead."""
    out = np.zeros(len(elements))
    for k, name in enumerate(elements):
        out[k] = abs(known.get(name, 0.0))
        if name not in known:
            values = [abs(x) for s in sides for x, f in zip(s.values, s.factors, strict=True) if f[k]]
            out[k] = max(values, default=0.0)
    return out


def _find_row(row: np.ndarray, others: np.ndarray, taken: set[int]) -> int | None:
    """Return which row has the same factors, but for how they are rounded."""
    for j, other in enumerate(others):
        if j not in taken and np.all(
            np.abs(row - other) <= SAME_FACTOR * np.maximum(np.abs(row), np.abs(other))
        ):
            return j
    return None


def _made_of(own: Side, k: int, other: Side, size: np.ndarray) -> tuple[np.ndarray | None, str]:
    """Return by which weights (n,) the other's combinations make one of these, or None and why not."""
    row = own.factors[k]
    usable = np.flatnonzero(np.any(other.factors != 0.0, axis=1))
    if not len(usable) or not np.any(other.factors[:, row != 0.0]):
        return None, "the other estimate does not have it"
    scale = np.maximum(np.abs(other.factors).max(axis=0), np.abs(row))
    scale[scale == 0.0] = 1.0
    weights = np.zeros(len(other.names))
    weights[usable] = np.linalg.lstsq((other.factors[usable] / scale).T, row / scale, rcond=1e-6)[0]
    weights[np.abs(weights) < 1e-9] = 0.0
    rest = np.abs(weights @ other.factors - row)
    sigma = np.sqrt(own.covariance[k, k] + weights @ other.covariance @ weights)
    if np.any(rest > NEAR * scale):
        return None, "the other estimate tells no combination of its parameters that is this one"
    if rest @ size > DERIVED * sigma:
        return None, "the factors of the other's combinations are rounded too coarsely to make it"
    return weights, ""


def _is_new(row: _Row, rows: Sequence[_Row]) -> bool:
    """Return whether a comparison is no combination of those there are."""
    both = np.array([np.concatenate([r.left, r.right]) for r in (*rows, row)])
    return np.linalg.matrix_rank(both, tol=1e-8 * len(both)) == len(both)


CENTRAL = tuple(f"c{n[1:]}" if n[0] == "m" else f"Ic{n[1:]}" for n in INERTIAL_NAMES[1:])
STEP = 1e-6  # of the parameters, for derivatives


def slope_of(function: Callable[[np.ndarray], np.ndarray], theta: np.ndarray) -> np.ndarray:
    """Return the derivative (k, 10) of a function (k,) of a body's parameters theta (10,)."""
    steps = STEP * np.diag(np.maximum(np.abs(theta), 1e-3 * abs(theta[0])))
    return np.array([(function(theta + s) - function(theta - s)) / (2.0 * s.sum()) for s in steps]).T


def in_terms_of(estimate: Estimate, other: Estimate) -> Estimate:
    """Return an estimate with bodies about their centre of mass where the ``other`` has them so, only.

    First-order covariance. As it is where mass and all three first moments are not told, each by itself.
    """
    there = {p.name: i for i, p in enumerate(estimate.parameters)}
    for body in dict.fromkeys(p.name.rpartition(".")[0] for p in other.parameters):
        asked = [k for k, c in enumerate(CENTRAL) if f"{body}.{c}" in {p.name for p in other.parameters}]
        names = [f"{body}.{n}" for n in INERTIAL_NAMES]
        if asked and all(n in there for n in names[:4]):
            own = [k for k in asked if names[k + 1] in there and f"{body}.{CENTRAL[k]}" not in there]
            estimate = _about_centre(estimate, body, names, own)
    return estimate


def _about_centre(estimate: Estimate, body: str, names: list[str], own: list[int]) -> Estimate:
    """Return an estimate with elements ``own`` of `CENTRAL` of a body in the place of those by origin."""
    parameters = list(estimate.parameters)
    at = {n: [p.name for p in parameters].index(n) for n in names if n in {p.name for p in parameters}}
    theta = np.array([parameters[at[n]].value if n in at else 0.0 for n in names])
    by_origin = slope_of(about_centre, theta)
    slope = np.eye(len(parameters))
    for k in own:
        row = at[names[k + 1]]
        slope[row] = 0.0
        for n, x in zip(names, by_origin[k], strict=True):
            if n in at:
                slope[row, at[n]] = x
    covariance = estimate.covariance
    if covariance is None:
        covariance = np.diag([p.sigma**2 for p in parameters])
    spread = slope @ covariance @ slope.T
    for k in own:
        row = at[names[k + 1]]
        parameters[row] = replace(
            parameters[row],
            name=f"{body}.{CENTRAL[k]}",
            unit="m" if k < 3 else "kg m^2",
            value=float(about_centre(theta)[k]),
            sigma=float(np.sqrt(spread[row, row])),
            profile=None,
        )
    told = None if estimate.covariance is None else spread
    return replace(estimate, parameters=tuple(parameters), covariance=told)
