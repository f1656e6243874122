"""Recordings that contradict each other: each one's own optimum against that of the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtrc

from smsid.errors import NotIdentifiableError

if TYPE_CHECKING:
    from smsid.estimation._normal_equations import NormalEquations
    from smsid.likelihood.combinations import Combination


SIGNIFICANCE = 1e-4  # probability below which recordings contradict each other
NAMED_SIGMAS = 3.5  # standard deviations between two values that are named
OF_FORCES = ("kg", "kg m", "kg m^2", "kg/m", "N/m", "N s/m")  # units of what forces are linear in
MOST_NAMED = 5  # parameters at most
AT_BOUND = 1e-6  # of its scale, within which a parameter is at its bound
TOLD_SHARE = 0.5  # of its standard deviation beforehand, what a recording leaves of a value that it tells


@dataclass(frozen=True)
class Contradiction:
    """One recording against all others: probability of so much difference by chance, and where it shows.

    ``parameters`` are (name, value by this recording alone, by the others, difference in standard
    deviations). ``factor``: of this recording's masses and springs to those of the others, where one explains
    all differences: forces of one are scaled.
    """

    recording: str
    p_value: float
    parameters: tuple[tuple[str, float, float, float], ...]
    factor: float | None = None

    @property
    def sentence(self) -> str:
        """The contradiction in a sentence."""
        named = "; ".join(
            f"{n} {a:.4g} against {b:.4g} ({abs(z):.1f} sigma)" for n, a, b, z in self.parameters
        )
        said = f"'{self.recording}' contradicts the other recordings (p = {self.p_value:.1g})"
        said += f": {named}. " if named else ". "
        if self.factor is None:
            said += "Were they flown with the same spacecraft? Identify them apart and compare."
            return said + self._scale
        return (
            f"{said}One factor explains it, {self.factor:.3g} on all masses and springs: is what drives one "
            "of them scaled, thrust ('command.force') or the wheels' inertia times rate ('wheel_rate')?"
        )

    @property
    def _scale(self) -> str:
        """What a difference in mass would be if it came from what drives them."""
        mass = [a / b for n, a, b, _ in self.parameters if n == "total.mass"]
        drives = "thrust ('command.force') or the wheels' inertia times rate ('wheel_rate')"
        return f" Or are {drives} of one of them scaled, by about {mass[0]:.3g}?" if mass else ""


@dataclass(frozen=True)
class RecordingInformation:
    """What one recording says of shared parameters: Gram matrix (m, m), slope (m,) at the joint optimum."""

    label: str
    gram: np.ndarray
    slope: np.ndarray


def contradictions(
    found: NormalEquations, rows: Sequence[Combination], widening: float = 1.0
) -> tuple[Contradiction, ...]:
    """Return the recordings that contradict the others, the worst first.

    ``rows`` are what a contradiction is put in terms of; standard deviations are ``widening`` times as large.
    Parameters at a bound stay there: beyond it nothing is.
    """
    free = within_bounds(found)
    if not len(free):
        return ()
    both = np.ix_(free, free)
    prior = np.diag((found.scales / np.array([u.sigma for u in found.unknowns])) ** 2)
    parts = [RecordingInformation(t.label, t.gram[both], t.slope[free]) for t in found.recordings]
    rows = [replace(r, gradient=r.gradient[free]) for r in rows]
    return contradictions_of(parts, prior[both], rows, widening)


def within_bounds(found: NormalEquations) -> np.ndarray:
    """Return the unknowns (k,) that are not at a bound."""
    values = np.array([found.point.value(u) for u in found.unknowns])
    bounds = np.array([(u.lower, u.upper) for u in found.unknowns]).reshape(-1, 2)
    near = AT_BOUND * found.scales
    return np.flatnonzero((values > bounds[:, 0] + near) & (values < bounds[:, 1] - near))


def contradictions_of(
    parts: Sequence[RecordingInformation],
    prior: np.ndarray,
    rows: Sequence[Combination],
    widening: float = 1.0,
    alone: Mapping[str, Mapping[str, float]] | None = None,
) -> tuple[Contradiction, ...]:
    """Return which parts contradict the others, the worst first; ``prior`` (m, m): known beforehand.

    By the normal equations at the joint optimum: recording i alone would move by ``(G_i + P)^-1 s_i``, and
    the difference to the same of all others is chi-squared. ``rows`` are what it is put in terms of, and
    ``alone`` their values where a part was fitted by itself, by its label and their name: of two such parts
    these are told, not what a straight line leads to.
    """
    if len(parts) < 2:
        return ()
    out = []
    for part in parts:
        rest = [x for x in parts if x is not part]
        grams = part.gram, np.sum([x.gram for x in rest], axis=0)
        slopes = part.slope, np.sum([x.slope for x in rest], axis=0)
        sides = [covariances_of(g, prior) for g in grams]
        covariances = [covariance for covariance, _ in sides]
        apart = covariances[0] @ slopes[0] - covariances[1] @ slopes[1]
        # what both have from the prior is no difference: of each only what its data say
        spread = (sides[0][1] + sides[1][1]) * widening**2
        shared = _shared_directions(grams, prior)
        own, scatter = shared.T @ apart, shared.T @ spread @ shared
        width = np.sqrt(np.diag(scatter))  # of unlike size: what is told best must not drown
        own, (size, basis) = own / width, np.linalg.eigh(scatter / np.outer(width, width))
        seen = size > 1e-8
        statistic = float(np.sum((basis[:, seen].T @ own) ** 2 / size[seen]))
        p_value = float(chdtrc(int(seen.sum()), statistic))
        if p_value * len(parts) < SIGNIFICANCE:
            apart_by_row = _differences(rows, covariances, slopes, spread)
            if alone is not None and len(rest) == 1:
                own_values, others = alone[part.label], alone[rest[0].label]
                apart_by_row = {
                    k: (name, own_values.get(name, a), others.get(name, b), z)
                    for k, (name, a, b, z) in apart_by_row.items()
                }
            named = [x for x in apart_by_row.values() if abs(x[3]) > NAMED_SIGMAS]
            named = sorted(named, key=lambda x: -abs(x[3]))[:MOST_NAMED]
            factor = _common_factor(rows, apart_by_row)
            out.append(Contradiction(part.label, p_value, tuple(named), factor))
    return tuple(sorted(out, key=lambda c: c.p_value))


def contradictions_of_separate(
    labels: Sequence[str],
    information: Sequence[np.ndarray],
    moved: Sequence[np.ndarray],
    prior: np.ndarray,
    rows: Sequence[Sequence[Combination]],
    widening: float = 1.0,
) -> tuple[Contradiction, ...]:
    """Return which of recordings that were fitted one by one contradict the others, the worst first.

    ``information`` (m, m) is each one's without the prior, ``moved`` (m,) its optimum from what was known
    beforehand, ``rows`` are those at its optimum. What one of them does not tell is not named.
    """
    grams = [x + prior for x in information]
    slopes = [g @ x for g, x in zip(grams, moved, strict=True)]
    parts = [RecordingInformation(*x) for x in zip(labels, information, slopes, strict=True)]
    told = []
    for row in rows[0]:
        widest = max(float(row.gradient @ np.linalg.solve(g, row.gradient)) for g in grams)
        if widest < TOLD_SHARE**2 * float(row.gradient @ np.linalg.solve(prior, row.gradient)):
            told.append(replace(row, value=row.value - float(row.gradient @ moved[0])))
    alone = {label: {r.name: r.value for r in own} for label, own in zip(labels, rows, strict=True)}
    return contradictions_of(parts, prior, told, widening, alone)


def contradiction_error(found: Sequence[Contradiction]) -> NotIdentifiableError:
    """Return the error of recordings that are explained one by one and not together."""
    return NotIdentifiableError(
        "No spacecraft as described flies all of these recordings, though it explains each by itself.",
        advice=found[0].sentence,
        contradictions=[c.sentence for c in found],
    )


def covariances_of(gram: np.ndarray, prior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return C = (G + P)^-1 and C G C (m, m) of ``gram`` G and a diagonal ``prior`` P (m, m).

    By the eigenvalues of G in standard deviations of the prior: products of the matrices themselves lose what
    is known a million times better than before beside what is hardly told.
    """
    width = np.sqrt(1.0 / np.diag(prior))
    size, basis = np.linalg.eigh(gram * np.outer(width, width))
    size, basis = np.maximum(size, 0.0), basis * width[:, None]
    return (basis / (size + 1.0)) @ basis.T, (basis * size / (size + 1.0) ** 2) @ basis.T


def _shared_directions(grams: tuple[np.ndarray, np.ndarray], prior: np.ndarray) -> np.ndarray:
    """Return the directions (m, k) that the data of both sides tell more of than the prior."""
    width = np.sqrt(1.0 / np.diag(prior))
    first, second = (g * np.outer(width, width) for g in grams)
    both = first @ np.linalg.inv(first + second + np.eye(len(first))) @ second  # parallel sum
    size, basis = np.linalg.eigh(0.5 * (both + both.T))
    return basis[:, size > 1.0] / width[:, None] if (size > 1.0).any() else basis[:, -1:] / width[:, None]


def _differences(
    rows: Sequence[Combination],
    covariances: list[np.ndarray],
    slopes: tuple[np.ndarray, np.ndarray],
    spread: np.ndarray,
) -> dict[int, tuple[str, float, float, float]]:
    """Return name, value by one side, by the other, and their difference in standard deviations, by row."""
    found = {}
    for k, row in enumerate(rows):
        own, other = (float(row.gradient @ c @ s) for c, s in zip(covariances, slopes, strict=True))
        sigma = float(np.sqrt(row.gradient @ spread @ row.gradient))
        if sigma > 0.0 and own != other:
            found[k] = (row.name, row.value + own, row.value + other, (own - other) / sigma)
    return found


def _common_factor(
    rows: Sequence[Combination], apart: dict[int, tuple[str, float, float, float]]
) -> float | None:
    """Return the factor between what both sides say of all that is linear in force, if there is one."""
    own = [
        (a / b, abs((a - b) / z / b)) for k, (_, a, b, z) in apart.items() if rows[k].unit in OF_FORCES and b
    ]
    ratio, sigma = np.array(own).reshape(-1, 2).T
    if not len(ratio):
        return None
    factor = float(np.average(ratio, weights=sigma**-2))
    telling = sigma < abs(factor - 1.0) / NAMED_SIGMAS
    off = (ratio - factor)[telling] / sigma[telling]
    return factor if telling.sum() > 1 and np.sqrt(np.mean(off**2)) < NAMED_SIGMAS else None
