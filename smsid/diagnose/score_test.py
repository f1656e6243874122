"""A candidate: one effect at one place with the parameters it frees, and how it scores on what is left."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import chain, count
from typing import Any, TypeVar

import numpy as np
from scipy.stats import chi2

from smsid.arm.columns import JointStates, effect_columns
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.effects.base import Effect
from smsid.effects.friction_law import BY_FIELD
from smsid.errors import DescriptionError, SmsidError
from smsid.estimation.joint_problem import samples_in
from smsid.estimation.map_estimate import LeftColumns, MapFit, ProjectedColumns, columns_of
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.sensitivities import Sensitivities, Sensitivity, propagate
from smsid.model.spacecraft import SpacecraftModel

LOGGER = logging.getLogger(__name__)
T = TypeVar("T", bound="Candidate")
EXCITED = THRESHOLDS.excited
NOTHING = 1e-18  # share of the most that a parameter of a candidate tells, below which it does nothing


@dataclass(frozen=True)
class Candidate:
    """One explanation to be tried.

    ``effect`` does nothing as it stands; ``free`` names the parameters that are fitted, ``steps`` typical
    sizes of them. With ``effect`` ``None`` the candidate is that nominal parameters (``free``) are wrong by
    more than their prior allows. ``also`` are parameters freed once the effect is there (a payload's centre
    of mass has no meaning without its mass). ``grid`` counts the variants searched, for the correction.
    ``simpler`` are shapes at its location that come first: what one of them explains as well is not its own.
    ``recording`` is the only one of several that it is in, empty: it is in all. Of an effect that a
    description has, ``beside`` is one that does nothing beside it.
    """

    kind: str
    location: str
    family: str
    shape: str
    effect: Effect | None
    free: tuple[str, ...]
    steps: tuple[float, ...]
    also: tuple[str, ...] = ()
    grid: int = 1
    simpler: tuple[str, ...] = ()
    recording: str = ""
    beside: Effect | None = None

    @property
    def key(self) -> tuple[str, str, str]:
        """What makes it itself: kind, location, shape."""
        return self.kind, self.location, self.shape

    @property
    def parameters(self) -> frozenset[str]:
        """Names of what it frees, at once or once its effect is there."""
        return frozenset((*self.free, *self.also))

    @property
    def start(self) -> float | None:
        """When its effect begins midway [s]."""
        return getattr(self.effect, "start", None)

    def extends(self, other: Candidate) -> bool:
        """Whether another is a simpler law of the same place."""
        same = (self.location, self.family) == (other.location, other.family)
        return same and other.shape in self.simpler

    def holds(self, other: Candidate) -> bool:
        """Whether another is a special case of it: the same effect with fewer parameters free."""
        one, two = self.effect, other.effect
        if one is None or two is None or one.name != two.name:
            return False
        same = (self.start, self.recording) == (other.start, other.recording)
        return same and set(other.free) < set(self.free)

    def unknowns(self, nominal: Sequence[Unknown]) -> tuple[Unknown, ...]:
        """Return the parameters it frees as unknowns, without prior where its effect states none."""
        if self.effect is None:
            by_name = {u.name: u for u in nominal}
            return tuple(by_name[name].unbound() for name in self.free)
        by_name_ = {p.name: p for p in self.effect.parameters()}
        found = []
        for name, step in zip(self.free, self.steps, strict=True):
            p = by_name_[name]
            sigma = np.inf if p.sigma is None else p.sigma
            found.append(Unknown.of_parameter(p, sigma, step))
        return tuple(found)

    def columns(self, changes: Sensitivities, nominal: Sequence[Unknown]) -> list[Sensitivity]:
        """Return the derivatives by its parameters, per unit of ``steps``, where it does nothing."""
        if self.effect is None:
            unknowns = self.unknowns(nominal)
            scaled = columns_of(changes, unknowns)
            return [c.times(u.scale) for c, u in zip(scaled, unknowns, strict=True)]
        plain = self.instance(changes.point)
        found = self._joint_torques(plain, changes)
        if found:
            return found
        for name, step in zip(self.free, self.steps, strict=True):
            p = next(p for p in plain.parameters() if p.name == name)
            sign = 1.0 if p.value + step <= p.upper else -1.0
            changed = plain.with_values({name: p.value + sign * step})
            found.append(changes.effect(plain, changed, sign * step).times(step))
        return found

    def _joint_torques(self, plain: Effect, changes: Sensitivities) -> list[Sensitivity]:
        """Return the derivatives of an effect that is linear in what it adds to joint torques, else none.

        For all samples at once, as the dynamics of arms has them: its force is what the motors need not give.
        """
        if getattr(plain, "start", None) is not None:
            return []
        fields, parts = [name.partition(".")[2] for name in self.free], []
        try:
            for s in (changes.run.middle, changes.run.states):
                own = linear_torques(plain, fields, changes.model, JointStates(s.q, s.v, s.a, s.tau))
                parts.append([-step * own[n] for n, step in zip(self.free, self.steps, strict=True)])
        except (DescriptionError, KeyError):
            return []
        return [Sensitivity.of(forces) for forces in zip(*parts, strict=True)]

    def apart(self, names: Collection[str]) -> Candidate:
        """Return it with an effect of its own where one of its name is known, as an effect has one start."""
        effect = self.effect
        if effect is None or effect.name not in names:
            return self
        numbers = chain([""], count(2))
        own = replace(self, effect=self.beside or effect, beside=None)
        return own.renamed(next(n for k in numbers if (n := f"{effect.name}_later{k}") not in names))

    def renamed(self, name: str) -> Candidate:
        """Return it with its effect, and with that its parameters, under another name."""
        assert self.effect is not None
        free, also = (tuple(parameter_of(name, p) for p in some) for some in (self.free, self.also))
        return replace(self, effect=self.effect.model_copy(update={"name": name}), free=free, also=also)

    def instance(self, point: Point) -> Effect:
        """Return its effect as the point has it, perhaps with other parameters freed already."""
        assert self.effect is not None
        mine = [e for e in point.description.effect if e.name == self.effect.name]
        return mine[0] if mine else self.effect

    def scored(self, found: MapFit, own: ProjectedColumns) -> Score:
        """Return its score on a fit, from its whitened columns beside the fitted parameters.

        What does nothing in this recording (a centre of mass along the only axis its body turns about) is
        not fitted, unless a prior tells what it is.
        """
        raw = own.raw
        moves = raw > NOTHING * raw.max(initial=0.0)
        if moves.any() and not (moves | self._told).all():
            kept = moves | self._told
            return self._only(kept).scored(found, own.only(kept))
        estimate, covariance, ratio, values = least_squares(own.gram, own.slope, raw)
        excited = float(values.min(initial=1.0)) if (raw > 0.0).all() else 0.0
        if int((raw > 0.0).sum()) == 1 and not _is_within_bounds(self, estimate):
            ratio = 0.0
        freedom = int((values > EXCITED).sum())
        sides = 1 if freedom == 1 and self.one_sided else 2
        shown = LeftColumns(found, own.columns)
        return Score(self, ratio, freedom, estimate, covariance, excited, shown, own.taken, sides)

    def scored_coarsely(self, found: MapFit, own: ProjectedColumns) -> Score:
        """Return its score as of the variants its columns are of, where `scored` may look for finer ones."""
        return self.scored(found, own)

    @property
    def _told(self) -> np.ndarray:
        """Which of its parameters have a prior (d,)."""
        sigma = {} if self.effect is None else {p.name: p.sigma for p in self.effect.parameters()}
        return np.array([sigma.get(name) is not None for name in self.free])

    def _only(self, which: np.ndarray) -> Candidate:
        kept = [k for k, there in enumerate(which) if there]
        free, steps = tuple(self.free[k] for k in kept), tuple(self.steps[k] for k in kept)
        return replace(self, free=free, steps=steps)

    @property
    def one_sided(self) -> bool:
        """Whether where it does nothing is as far as its only parameter goes."""
        if self.effect is None or len(self.free) != 1:
            return False
        (p,) = (p for p in self.effect.parameters() if p.name == self.free[0])
        return p.value in (p.lower, p.upper)


def recast(cls: type[T], candidate: Candidate, changes: Mapping[str, Any]) -> T:
    """Return a candidate as one of another class, with changes."""
    return cls(**{f.name: getattr(candidate, f.name) for f in fields(Candidate)} | dict(changes))


def linear_torques(
    effect: Effect, fields: Sequence[str], model: SpacecraftModel, states: JointStates
) -> dict[str, np.ndarray]:
    """Return what the motors must give (N, nv) per unit of each parameter that an effect is linear in.

    Laws of friction that are on request are asked for by ``fields``. Raises `DescriptionError` for an effect
    that does not enter torques linearly.
    """
    laws = [BY_FIELD[f].law for f in fields if f in BY_FIELD and BY_FIELD[f].law]
    asked = effect.model_copy(update={"laws": (*getattr(effect, "laws", ()), *laws)}) if laws else effect
    return {c.name: c.values for c in effect_columns(asked, model, states)}


def parameter_of(effect: str, parameter: str) -> str:
    """Return the name of a parameter, ``<effect>.<parameter>``, as one of another effect."""
    return f"{effect}.{parameter.partition('.')[2]}"


@dataclass(frozen=True)
class Score:
    """How a candidate does on a fit: likelihood ratio on ``freedom`` degrees, and its linear estimate.

    ``estimate`` and ``covariance`` are in units of the candidate's steps. ``excited`` is the smallest share
    of a column's information left beside the nominal parameters; ``columns`` (N rows + m, d) are what
    the fitted parameters leave of the whitened columns, ``taken`` (m, d) what they stand in for. ``sides`` is
    1 where its only parameter has a sign: estimates of the other count for nothing. ``another`` is a place to
    start from that scored less, of a search that may have ended beside the best one.
    """

    candidate: Candidate
    ratio: float
    freedom: int
    estimate: np.ndarray
    covariance: np.ndarray
    excited: float
    columns: np.ndarray | LeftColumns
    taken: np.ndarray
    sides: int = 2
    another: Score | None = None

    def with_own_columns(self) -> Score:
        """Return it with its columns as an array, without the fit and all candidates' that they are of."""
        return self if isinstance(self.columns, np.ndarray) else replace(self, columns=np.array(self.columns))

    def without_columns(self) -> Score:
        """Return it without columns: it cannot be compared with others any more."""
        return replace(self, columns=np.zeros((0, len(self.estimate))))

    @property
    def p_value(self) -> float:
        """Chance of a ratio as large when the candidate is not there; variants are corrected for, other
        candidates are not.
        """
        return self.chance_of(float(chi2.sf(self.ratio, self.freedom))) if self.freedom else 1.0

    def chance_of(self, one: float) -> float:
        """Return the chance over all variants that were searched, from that of ``one`` of both signs."""
        return min(1.0, 0.5 * self.sides * self.candidate.grid * one)

    def information_gain(self, samples: int) -> float:
        """Return the gain in Bayes's information criterion, searched variants paid for."""
        return self.ratio - self.freedom * float(np.log(samples)) - 2.0 * float(np.log(self.candidate.grid))

    def odds(self, samples: int) -> float:
        """Return twice the log of the odds against nothing, searched variants paid for.

        The parameters' prior is as wide as makes what was found likeliest, but no wider than what one sample
        tells (Zellner's g by local empirical Bayes; Liang et al., J. Am. Stat. Assoc. 103, 2008). Bayes's
        criterion has the latter: of what is just found, it asks a third for every component that it has.
        """
        return odds(self.ratio, self.freedom, samples) - 2.0 * float(np.log(self.candidate.grid))


def odds(ratio: float, freedom: int, samples: int) -> float:
    """Return twice the log odds that a likelihood ratio is worth on so many degrees, see `Score.odds`."""
    width = max(ratio / max(freedom, 1), 1.0)
    return ratio - freedom * min(1.0 + float(np.log(width)), float(np.log(samples)))


def changes_of(found: MapFit, candidate: Candidate) -> list[Sensitivity]:
    """Return the changes by a candidate's parameters at a fit; those that are there all the time are kept.

    Raises `SmsidError` where it cannot be there.
    """
    if candidate.start is not None:
        return candidate.columns(found.changes, found.unknowns)
    # what is resolved at a value has the key of what it came from, and other columns
    known, what = found.changes.by_candidate, (type(candidate), candidate.key, candidate.free)
    if what not in known:
        known[what] = candidate.columns(found.changes, found.unknowns)
    return known[what]


def signatures(found: MapFit, candidates: Sequence[Candidate]) -> dict[int, np.ndarray]:
    """Return the whitened columns (N rows, d) of every candidate that has any, by its place in the list."""
    changes: list[Sensitivity] = []
    where: dict[int, slice] = {}
    for i, candidate in enumerate(candidates):
        try:
            own = changes_of(found, candidate)
        except SmsidError:
            continue
        if own:
            where[i] = slice(len(changes), len(changes) + len(own))
        changes += own
    if not changes:
        return {}
    flat = propagate(found.run, changes).reshape(-1, len(changes))
    known = {i: seen_where(found, candidates[i], flat[:, index]) for i, index in where.items()}
    lost = [i for i, columns in known.items() if not np.isfinite(columns).all()]
    for i in lost:
        LOGGER.info("%s has no finite signature here", candidates[i].key)
        del known[i]
    return known


def seen_where(found: MapFit, candidate: Candidate, columns: np.ndarray) -> np.ndarray:
    """Return columns (N rows, d) of a candidate as they are where it is in one recording alone."""
    if not candidate.recording or not found.problem.parts:
        return columns
    here = samples_in(found.problem, candidate.recording)
    return columns * np.repeat(here, len(columns) // len(here))[:, None]


def score_candidates(
    found: MapFit, candidates: Sequence[Candidate], columns: Sequence[np.ndarray], *, coarsely: bool = False
) -> list[Score]:
    """Return the scores of candidates from their whitened columns (N rows, d).

    The fitted parameters are free to move within their priors. One that fails numerically has no score.
    ``coarsely``: as `Candidate.scored_coarsely`.
    """
    beside = found.projected(columns)
    scores: list[Score] = []
    for candidate, own in zip(candidates, beside, strict=True):
        try:
            scores.append((candidate.scored_coarsely if coarsely else candidate.scored)(found, own))
        except (SmsidError, np.linalg.LinAlgError, ArithmeticError) as error:
            LOGGER.info("%s cannot be scored: %s", candidate.key, error)
    return scores


def least_squares(
    gram: np.ndarray, slope: np.ndarray, raw: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Return estimate (d,), covariance (d, d), gain in chi-squared, and the shares of information left (d,).

    ``gram`` and ``slope`` are of columns with the nuisance projected out, ``raw`` (d,) their squares before:
    directions of which less than `EXCITED` is left count as not excited.
    """
    size = np.sqrt(np.where(raw > 0.0, raw, 1.0))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    keep = values > EXCITED
    directions = vectors[:, keep] / np.sqrt(values[keep])
    scaled = directions.T @ (slope / size)
    covariance = (directions @ directions.T) / np.outer(size, size)
    return (directions @ scaled) / size, covariance, float(scaled @ scaled), values


def _is_within_bounds(candidate: Candidate, estimate: np.ndarray) -> bool:
    if candidate.effect is None:
        return True
    by_name = {p.name: p for p in candidate.effect.parameters()}
    return all(
        by_name[n].lower <= by_name[n].value + step * float(x)
        for n, step, x in zip(candidate.free, candidate.steps, estimate, strict=True)
    )


def correlation(first: Score, second: Score) -> float:
    """Return the largest canonical correlation of two candidates, the fitted parameters projected out."""
    return float(_canonical_correlations(first, second).max(initial=0.0))


def is_same_error(first: Score, second: Score) -> bool:
    """Whether two candidates of one kind and shape do the same, as at bodies that move as one: neither can do
    what the other cannot, the fitted parameters projected out.
    """
    (kind, _, shape), (its_kind, _, its_shape) = first.candidate.key, second.candidate.key
    if (kind, shape) != (its_kind, its_shape) or first.freedom != second.freedom:
        return False
    return can_do_the_same(first, second)


def can_do_the_same(first: Score, second: Score) -> bool:
    """Whether a candidate can do all that the ``first`` can, the fitted parameters projected out."""
    alike = _canonical_correlations(first, second)
    return len(alike) >= first.freedom and float(alike.min(initial=1.0)) > THRESHOLDS.same


def _canonical_correlations(first: Score, second: Score) -> np.ndarray:
    bases = []
    for s in (first, second):
        columns = np.asarray(s.columns)
        size = np.linalg.norm(columns, axis=0)
        u, values, _ = np.linalg.svd(columns / np.where(size > 0.0, size, 1.0), full_matrices=False)
        bases.append(u[:, values > 1e-6])
    return np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)
