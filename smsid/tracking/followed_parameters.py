"""Which parameters are followed, how fast each may wander, and what is known of them at the start."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from numbers import Real

import numpy as np

from smsid.description.schema import Description
from smsid.errors import DescriptionError, EstimateError
from smsid.estimation.bias_walk import walk_rate
from smsid.estimation.bodies import linear_terms
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.unknowns import BIAS_SIGMA, DEFAULT_STEP, MOST, sensor_unknowns, unknowns_of
from smsid.identify.estimate import Estimate
from smsid.identify.momentum_rows import whole_bodies
from smsid.likelihood.prior import Cad

UNCERTAIN = 0.2
"""Standard deviation, relative to its size, of a parameter of which nothing is known beforehand."""
DRIFT = 0.01
"""Standard deviation, relative to its size, by which a parameter wanders in an hour by default."""
HOUR = 3600.0  # [s]
Rate = float | tuple[float | None, float] | None
"""How a parameter wanders [unit/sqrt(s)], ``None``: as usual; or that, and how large its trend [unit/s]."""
WIDER = 1e3  # times an estimate's standard deviation: the prior it is put on, so that it stands alone


@dataclass(frozen=True)
class Followed:
    """A parameter in the state of a filter: a random walk.

    ``unknown.nominal`` and ``unknown.sigma`` are its mean and standard deviation at the start, ``rate`` by
    how much it wanders [unit / sqrt(s)]. Of a trend, ``of`` is where the parameter stands that it changes.
    """

    unknown: Unknown
    rate: float
    of: int = -1

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.unknown.name


@dataclass(frozen=True, eq=False)
class StartingPoint:
    """Parameters to follow with mean (m,) and covariance (m, m) at the start, in their units.

    Others are ``held`` at values that an estimate says.
    """

    followed: tuple[Followed, ...]
    mean: np.ndarray
    covariance: np.ndarray
    notes: tuple[str, ...] = ()
    held: tuple[tuple[Unknown, float], ...] = ()


def followed_parameters(
    description: Description,
    *,
    follow: Mapping[str, Rate] | Sequence[str] | None = None,
    hold: Sequence[str] = (),
    estimate: Estimate | None = None,
    cad: Cad | None = UNCERTAIN,
    present: Sequence[str] | None = None,
) -> StartingPoint:
    """Return the parameters to follow and what is known of them.

    Args:
        description: as it is followed; its values are the means, its priors the standard deviations. Where it
            states none, a parameter may be off by `UNCERTAIN` of its size.
        follow: rates of random walks [unit / sqrt(s)] by name or pattern (``tank.*``); ``None`` is the usual
            one, as of names alone, `DRIFT` of the size in an hour. A pair also says how steadily it may
            change [unit / s]: its trend, as far from zero as that, is followed as a parameter more. Only
            these are followed; all unknown parameters when not given.
        hold: names or patterns that are not followed.
        estimate: what is known beforehand, with its covariance; of single parameters and of combinations.
        cad: what is known of rigid bodies, as in `smsid.likelihood.refine`.
        present: channels there will be; biases of others are not followed. All when not given.

    Raises:
        DescriptionError: a name in ``follow`` or ``hold`` fits no unknown parameter; nothing is followed; a
            rate is negative.
        EstimateError: the estimate has no covariance.
    """
    point = Point.of(description)
    sensors = description.effective_sensors()
    channels = {f"{s.name}.{q}" for s in sensors for q in s.quantities}
    seen = channels if present is None else channels & set(present)
    taken = {c for e in description.effect if e.unknowns() for c in e.biased_channels()}
    errors = sensor_unknowns(point.base, sensors, seen, "", taken)
    biases = [replace(u, name=u.name.removeprefix(": ")) for u in errors]
    every = [*unknowns_of(point, cad=cad).unknowns, *biases]
    rates = _rates(every, follow, hold)
    walks = {f"{s.name}.{q}": walk_rate(s.error(q)) for s in sensors for q in s.quantities}
    found, steady = [], []
    others = [_with_prior(u) for u in every if u.name not in rates and not u.of_recording]
    others = [u for u in others if np.isfinite(u.sigma)]
    for u in every:
        if u.name in rates:
            own, (rate, trend) = _with_prior(u), rates[u.name]
            if rate is None:
                rate = DRIFT * _size(own) / np.sqrt(HOUR)
                if u.kind == "bias":
                    walk = walks[u.name.partition(".bias.")[0]]
                    rate = max(rate, float(walk.flat[u.column % walk.size]))
            found.append(Followed(own, rate))
            if trend:
                name, unit = f"{u.name}.trend", f"{u.unit or 1}/s".replace("/s/s", "/s^2")
                steady.append((u.name, Unknown(name, "trend", unit, 0.0, trend, trend)))
    place = {f.name: i for i, f in enumerate(found)}
    found += [Followed(u, 0.0, place[name]) for name, u in steady]
    if not found:
        raise DescriptionError(
            "No parameter is left to follow.", advice="Follow one, or free one that is marked as known."
        )
    mean = np.array([f.unknown.nominal for f in found])
    covariance = np.diag([f.unknown.sigma**2 for f in found])
    if estimate is None:
        return StartingPoint(tuple(found), mean, covariance)
    m, held = len(found), [Followed(u, 0.0) for u in others]
    wide = np.diag([*np.diag(covariance), *(u.sigma**2 for u in others)])
    told = linear_terms(estimate, whole_bodies(point.base)[:10])
    known_before = np.array([*mean, *(u.nominal for u in others)])
    whole = _with_estimate([*found, *held], known_before, wide, estimate, told, m)
    known = tuple(
        (f.unknown, float(x))
        for f, x, s in zip(held, whole.mean[m:], np.sqrt(np.diag(whole.covariance))[m:], strict=True)
        if s < f.unknown.sigma
    )
    notes = whole.notes
    if known:
        notes += (f"held at what the estimate says: {', '.join(u.name for u, _ in known)}",)
    return StartingPoint(tuple(found), whole.mean[:m], whole.covariance[:m, :m], notes, known)


def trends_of(followed: Sequence[Followed]) -> tuple[np.ndarray, np.ndarray]:
    """Return what changes by which trend (k, 2), and by how much in a second, per scales (k,)."""
    pairs = np.array([(f.of, i) for i, f in enumerate(followed) if f.of >= 0], dtype=np.int64).reshape(-1, 2)
    scales = np.array([f.unknown.scale for f in followed])
    return pairs, scales[pairs[:, 1]] / scales[pairs[:, 0]]


def _rates(
    every: Sequence[Unknown], follow: Mapping[str, Rate] | Sequence[str] | None, hold: Sequence[str]
) -> dict[str, tuple[float | None, float]]:
    """Return the rates by name of what is followed, ``None`` for the usual one, and trends, zero for none."""
    names = [u.name for u in every]
    asked = follow if isinstance(follow, Mapping) else dict.fromkeys(_patterns("follow", follow))
    out: dict[str, tuple[float | None, float]] = {} if asked else dict.fromkeys(names, (None, 0.0))
    for pattern, given in asked.items():
        rate, trend = given if isinstance(given, tuple) else (given, 0.0)
        if not all(x is None or (isinstance(x, Real) and 0.0 <= float(x) < np.inf) for x in (rate, trend)):
            raise DescriptionError(
                f"The rate of '{pattern}' is {given}.",
                advice="Give zero or more, in its unit per sqrt(s); a trend per second.",
            )
        for name in _matching_names(pattern, names):
            out[name] = rate, trend
    for pattern in _patterns("hold", hold):
        for name in _matching_names(pattern, names):
            out.pop(name, None)
    return out


def _patterns(option: str, given: Sequence[str] | None) -> list[str]:
    """Return names or patterns that are given, of which a single one may stand without a list."""
    found = [given] if isinstance(given, str) else given or ()
    if not isinstance(found, Iterable) or not all(isinstance(x, str) for x in found):
        raise DescriptionError(
            f"{option} is of type {type(given).__name__}, not names of parameters.",
            advice='Give their names or patterns: ["tank.*"].',
        )
    return list(found)


def _matching_names(pattern: str, names: Sequence[str]) -> list[str]:
    found = [n for n in names if n == pattern or fnmatchcase(n, pattern)]
    if not found:
        import difflib

        close = difflib.get_close_matches(pattern, names, n=3) or list(names[:8])
        raise DescriptionError(
            f"'{pattern}' is no unknown parameter of the description.",
            advice=f"There are {', '.join(close)}.",
            known=tuple(names),
        )
    return found


def _size(unknown: Unknown) -> float:
    """Return the typical size of a parameter: that of its body, of its value, or of its prior."""
    if unknown.kind == "bias":
        return BIAS_SIGMA.get(unknown.name.split(".")[1], unknown.sigma)
    return abs(unknown.nominal) if unknown.kind == "effect" and unknown.nominal else unknown.scale


def _with_prior(unknown: Unknown) -> Unknown:
    """Return an unknown whose prior is no wider than a filter can begin with."""
    if unknown.kind != "effect":
        return unknown
    size = abs(unknown.nominal)
    stated = unknown.sigma < 0.999 * (10.0 * size if size else MOST * DEFAULT_STEP)
    if stated or not size:
        return unknown if stated else replace(unknown, sigma=unknown.scale)
    return replace(unknown, sigma=UNCERTAIN * size, scale=size)


def _with_estimate(
    found: Sequence[Followed],
    mean: np.ndarray,
    covariance: np.ndarray,
    estimate: Estimate,
    told: Mapping[str, tuple[dict[str, float], float]],
    own: int,
) -> StartingPoint:
    """Return what is known of parameters after an estimate of them, or of sums of them (`linear_terms`).

    Raises `EstimateError` where it says nothing of the first ``own``, which are followed.
    """
    if estimate.covariance is None:
        raise EstimateError(
            f"The estimate by {estimate.method} has no covariance.",
            advice="Identify by maximum likelihood, or follow from the description alone.",
        )
    index = {f.name: i for i, f in enumerate(found)}
    rows, kept, unused = [], [], []
    for k, p in enumerate(estimate.parameters):
        terms, _ = told.get(p.name, ({}, 0.0))
        finite = np.isfinite(p.value) and np.isfinite(estimate.covariance[k]).all()
        if not terms or not set(terms) <= set(index) or not finite:
            unused.append(p.name)
            continue
        row = np.zeros(len(found))
        for name, factor in terms.items():
            row[index[name]] = factor
        rows.append(row)
        kept.append(k)
    notes = []
    if unused:
        notes.append(f"not taken from the estimate, as they are no parameters here: {', '.join(unused)}")
    if not any(np.any(row[:own]) for row in rows):
        raise EstimateError(
            "No parameter of the estimate is followed.", advice="Is it an estimate of this description?"
        )
    h, value = np.array(rows), np.array([told[estimate.parameters[k].name][1] for k in kept])
    noise = estimate.covariance[np.ix_(kept, kept)]
    wide = covariance.copy()
    for row, variance in zip(h, np.diag(noise), strict=True):
        alone = np.flatnonzero(row)
        if len(alone) == 1:  # what it says of a single parameter has the description's prior in it already
            i = alone[0]
            wide[i, i] = max(wide[i, i], WIDER**2 * variance)
    gain = np.linalg.solve(h @ wide @ h.T + noise, h @ wide).T
    left = np.eye(len(mean)) - gain @ h
    after = left @ wide @ left.T + gain @ noise @ gain.T
    return StartingPoint(
        tuple(found), mean + gain @ (value - h @ mean), 0.5 * (after + after.T), tuple(notes)
    )
