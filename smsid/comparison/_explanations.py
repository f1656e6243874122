"""Which physical changes explain the differences of two estimates: stepwise, by the likelihood ratio.

Differences d of the common parameters are ``J x + noise`` with both covariances together. A hypothesis is a
set of columns J: a rigid body added to a link (ten), or the parameters of one effect. Forward steps add the
hypothesis with the least probability by chance, backward elimination takes away what is no longer needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from smsid.comparison._common_basis import ROUNDED, TOTAL, Common, inertial_element
from smsid.comparison.result import LEVEL
from smsid.model.regressor import INERTIAL_NAMES

SINGULAR = 1e-10  # smallest eigenvalue of a correlation matrix that is not rounding
SEEN = 1e-8  # singular value of whitened columns below which nothing is told, relative to the largest
TOLD = 1e-6  # part of a parameter outside what is told with which it still counts as told
RIVAL = 2.0 * np.log(1000.0)  # chi-squared by which a rival may be worse and is named
MOST = 8  # hypotheses in one explanation


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A physical change: ``columns`` (n, k) say what its parameters do to the common ones."""

    kind: str  # "body" or "effect"
    subject: str
    names: tuple[str, ...]
    columns: np.ndarray


@dataclass(frozen=True)
class Explained:
    """A hypothesis of the explanation: values (k,), covariance (k, k), which are ``told`` (k,).

    ``p_value`` is that of all it explains by chance, given the others; ``rivals`` explain as much.
    """

    hypothesis: Hypothesis
    values: np.ndarray
    covariance: np.ndarray
    told: np.ndarray
    p_value: float
    rivals: tuple[str, ...]


class Differences:
    """The differences of common parameters, whitened: ``white`` (r,) has unit covariance if nothing changed.

    ``whitener`` (r, n) leaves out directions of no variance; ``more`` (n,) are standard deviations of
    rounding in the names' factors.
    """

    def __init__(self, common: Common, more: np.ndarray | None = None) -> None:
        self.common = common
        covariance = common.covariances[0] + common.covariances[1]
        if more is not None:
            covariance = covariance + np.diag(more**2)
        scale = np.sqrt(np.diag(covariance))
        size, basis = np.linalg.eigh(covariance / np.outer(scale, scale))
        kept = size > SINGULAR * max(float(size.max(initial=0.0)), 1e-300)
        self.whitener = (basis[:, kept] / np.sqrt(size[kept])).T / scale
        self.white = self.whitener @ (common.after - common.before)

    @property
    def statistic(self) -> float:
        """Chi-squared of all differences."""
        return float(self.white @ self.white)

    @property
    def freedom(self) -> int:
        """Its degrees of freedom."""
        return len(self.white)


def hypotheses(common: Common) -> list[Hypothesis]:
    """Return every change that can be told in the common parameters: a body at a link, an effect's own."""
    bodies = [e[0] for n in common.elements if (e := inertial_element(n))]
    place = {n: k for k, n in enumerate(common.elements)}
    found = []
    for body in dict.fromkeys(bodies):
        columns = np.zeros((len(common.names), 10))
        for i, symbol in enumerate(INERTIAL_NAMES):
            if f"{body}.{symbol}" in place:
                columns[:, i] = common.factors[:, place[f"{body}.{symbol}"]]
        if TOTAL in place:
            columns[:, 0] += common.factors[:, place[TOTAL]]
        if np.any(columns):
            found.append(Hypothesis("body", body, tuple(f"{body}.{s}" for s in INERTIAL_NAMES), columns))
    rest = [n for n in common.elements if not inertial_element(n) and n != TOTAL]
    for owner in dict.fromkeys(n.partition(".")[0] for n in rest):
        own = tuple(n for n in rest if n.partition(".")[0] == owner)
        columns = common.factors[:, [place[n] for n in own]]
        mass = [i for i, n in enumerate(own) if n == f"{owner}.mass"]
        if mass and TOTAL in place:  # what an effect is heavier by, the whole craft is
            columns = columns.copy()
            columns[:, mass[0]] += common.factors[:, place[TOTAL]]
        if np.any(columns):
            found.append(Hypothesis("effect", owner, own, columns))
    return found


def explain(common: Common) -> tuple[list[Explained], float]:
    """Return the physical changes that explain the differences, and the probability of what they leave.

    They are chosen by stepwise selection.
    """
    whole = hypotheses(common)
    data = Differences(common)
    chosen = _select_hypotheses(data, whole)
    moved = _estimated_changes(data, chosen)
    # a name's factors are rounded: what a heavy body changes is known to that share only
    rounding = ROUNDED * np.sum(
        [np.abs(h.columns) @ np.abs(x) for h, x in zip(chosen, moved, strict=True)], 0
    )
    if chosen and np.any(rounding > 0.0):
        several = np.count_nonzero(common.factors, axis=1) > 1
        data = Differences(common, np.where(several, rounding, 0.0))
        chosen = _select_hypotheses(data, whole)
    left, rank = _remaining_chi2(data, chosen)
    parts = [_explanation_of(data, h, chosen, whole) for h in chosen]
    freedom = data.freedom - rank
    return sorted(parts, key=lambda x: x.p_value), float(chi2.sf(left, freedom)) if freedom else 1.0


def _select_hypotheses(data: Differences, whole: Sequence[Hypothesis]) -> list[Hypothesis]:
    chosen: list[Hypothesis] = []
    while len(chosen) < MOST:
        now, rank = _remaining_chi2(data, chosen)
        best, least = None, np.log(LEVEL / max(len(whole), 1))
        for h in whole:
            if h in chosen:
                continue
            then, more = _remaining_chi2(data, [*chosen, h])
            if more > rank:
                chance = float(chi2.logsf(now - then, more - rank))
                # beyond what a double holds the likelihood itself decides
                chance = chance if np.isfinite(chance) else -0.5 * (now - then) + (more - rank)
                if chance < least:
                    best, least = h, chance
        if best is None:
            break
        chosen.append(best)
    return _backward_elimination(data, chosen, len(whole))


def _backward_elimination(data: Differences, chosen: list[Hypothesis], tried: int) -> list[Hypothesis]:
    """Return the hypotheses without those that the others explain: backward elimination."""
    while len(chosen) > 1:
        chances = [_chance(data, h, chosen) for h in chosen]
        worst = int(np.argmax(chances))
        if chances[worst] < LEVEL / max(tried, 1):
            break
        chosen = [h for k, h in enumerate(chosen) if k != worst]
    return chosen


def _chance(data: Differences, one: Hypothesis, chosen: Sequence[Hypothesis]) -> float:
    """Return the probability of what a hypothesis explains beside the others, by chance."""
    now, rank = _remaining_chi2(data, chosen)
    then, less = _remaining_chi2(data, [h for h in chosen if h is not one])
    return float(chi2.sf(then - now, rank - less)) if rank > less else 1.0


def _remaining_chi2(data: Differences, chosen: Sequence[Hypothesis]) -> tuple[float, int]:
    """Return the chi-squared that hypotheses leave, and how many degrees of freedom they take."""
    if not chosen:
        return data.statistic, 0
    u, _, _ = _decompose(data, chosen)
    rest = data.white - u @ (u.T @ data.white)
    return float(rest @ rest), u.shape[1]


def _decompose(data: Differences, chosen: Sequence[Hypothesis]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return U (r, k), the pseudo-inverse (p, k) with x = V U' d, and V0 (p, k) of what is told."""
    columns = data.whitener @ np.hstack([h.columns for h in chosen])
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    u, s, vt = np.linalg.svd(columns / size, full_matrices=False)
    seen = s > SEEN * max(float(s.max(initial=0.0)), 1e-300)
    return u[:, seen], vt[seen].T / s[seen] / size[:, None], vt[seen].T


def _estimated_changes(data: Differences, chosen: Sequence[Hypothesis]) -> list[np.ndarray]:
    if not chosen:
        return []
    u, inverse, _ = _decompose(data, chosen)
    return np.split(inverse @ (u.T @ data.white), np.cumsum([len(h.names) for h in chosen])[:-1])


def _explanation_of(
    data: Differences, one: Hypothesis, chosen: Sequence[Hypothesis], whole: Sequence[Hypothesis]
) -> Explained:
    u, inverse, basis = _decompose(data, chosen)
    begin = sum(len(h.names) for h in chosen[: chosen.index(one)])
    own = slice(begin, begin + len(one.names))
    told = 1.0 - np.sum(basis[own] ** 2, axis=1) < TOLD
    now, _ = _remaining_chi2(data, chosen)
    others = [h for h in chosen if h is not one]
    rivals = []
    for h in whole:
        if h in chosen or h.kind != one.kind:
            continue
        then, _ = _remaining_chi2(data, [*others, h])
        if then - now < RIVAL:
            rivals.append(h.subject)
    values, covariance = (inverse @ (u.T @ data.white))[own], inverse[own] @ inverse[own].T
    return Explained(one, values, covariance, told, _chance(data, one, chosen), tuple(rivals))
