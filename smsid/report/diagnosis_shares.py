"""Where a misfit comes from, as shares: which place and which candidate account for how much of it."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.score_test import Candidate, Score, changes_of, correlation, score_candidates, signatures
from smsid.diagnose.specification_tests import PAST, adequacy
from smsid.diagnose.stepwise import Search
from smsid.errors import SmsidError
from smsid.estimation.map_estimate import MapFit, PriorRows, evaluate
from smsid.estimation.sensitivities import propagate
from smsid.report.axes import Axis, ticks_of
from smsid.report.diagnosis_map import MapCell, column_of, row_of, strongest_by_place
from smsid.report.heat import HeatCell, HeatMap, correlation_map, step_of
from smsid.report.model import Figure
from smsid.report.numbers import share
from smsid.report.rows import Bar, ChartRow, RowChart

EDGES = (0.02, 0.1, 0.25, 0.45, 0.65, 0.8, 0.95)
SHOWN = 14
SCALE = (
    (0, "below 2 %"),
    *((k, f"{100 * x:g} %") for k, x in enumerate(EDGES, 1)),
    (-1, "where it comes from"),
)
OF_CAUSES = (
    "What the named cause does to the predictions is taken as the whole. A cell is the share of it that "
    "the equation or channel could produce in the cause's stead, if it depended on the column's quantity in "
    "any of the usual ways, everything nominal free to move within its prior. Rows are torques of joints and "
    "wheels, forces and torques on the bus, then sensor channels. Places share effects, so shares do "
    "not add up."
)
OF_REST = (
    "The whole is what the nominal parameters leave, noise included. A cell is the share of its squares that "
    "the equation or channel could produce, if it depended on the column's quantity in any of the usual ways."
)


def share_map(found: Shares) -> Figure | None:
    """Return the map of equation by dependence in shares, the one strongest place framed."""
    rows, columns, best = strongest_by_place(found.places, lambda p: p.share)
    if not best:
        return None
    top = found.places[0]
    place = (row_of(top.where), column_of(top.dependence)) if top.share >= TELLING else None
    cells = [[_cell(best.get((r, c)), (r, c) == place) for c in columns] for r in rows]
    where, title = "none stands out", "Where it comes from: no one place"
    if place:
        where = f"strongest: {top.where} against {top.dependence}, {percent(top.share)}"
        its = top.dependence.removeprefix("its ")
        title = f"Where it comes from: {top.where}, as a function of its {its}"
    body = HeatMap(rows, columns, cells, f"shares of the misfit by place; {where}", SCALE, "share")
    return Figure("share-map", title, body, OF_CAUSES if found.of_causes else OF_REST)


def share_ranking(found: Shares) -> Figure | None:
    """Return the candidates' shares on a linear axis from none to all, the causes marked."""
    shown = found.candidates[:SHOWN]
    if not shown:
        return None
    rows = []
    for c in shown:
        series = 0 if c.cause else 1 if c.alias else 2
        what = {0: "the cause", 1: "not told from it"}.get(series, "")
        text = f"{percent(c.share)} {what}".strip()
        rows.append(ChartRow(label(c.candidate), (Bar(c.share, series, tip=text),), text))
    names = ("named as cause", "not told from a cause", "other candidates")
    used = {r.items[0].series for r in rows}
    legend = [(name, k, "bar") for k, name in enumerate(names) if k in used]
    ticks = tuple((v, f"{100 * v:g} %") for v, _ in ticks_of(0.0, 1.0, count=6))
    axis = Axis("share explained by one candidate alone", 0.0, 1.02, False, ticks)
    chart = RowChart(axis, rows, "shares that candidates explain", legend)
    caption = (
        "How much of what the cause does each other candidate could do alone in its stead; the cause has all "
        "of it by definition. Of strong effects even one per cent is far beyond the noise: this is how the "
        "causes were told apart."
        if found.of_causes
        else "How much of the squares left each candidate alone would explain, everything nominal free to "
        "move."
    )
    return Figure("ranking", "What each candidate would explain", chart, caption)


def percent(x: float) -> str:
    """Return a share in whole per cents, with one digit where it is small."""
    return share(x, 2) if x < 0.0995 else f"{100 * x:.0f} %"


def _cell(p: MapCell | None, here: bool) -> HeatCell:
    if p is None:
        return HeatCell()
    text = "0" if p.share < 0.005 else f"{100 * p.share:.0f}"
    tip = f"{p.where} against {p.dependence}: {percent(p.share)}, by {p.freedom} functions of it"
    return HeatCell(step_of(p.share, EDGES), text, tip, here)


COMPARED = 14


def rescore(search: Search) -> tuple[Score, ...]:
    """Return every candidate's score on the nominal fit, the most informative first.

    The search keeps those of its last round only, with the causes in the model already.
    """
    known = _candidates(search)
    columns = signatures(search.nominal, known)
    found = score_candidates(search.nominal, [known[i] for i in columns], list(columns.values()))
    return tuple(sorted(found, key=lambda s: -s.information_gain(search.samples)))


def _candidates(search: Search) -> list[Candidate]:
    """Return the causes and all candidates of the last round, each once."""
    found: dict[tuple[str, str, str], Candidate] = {}
    for s in (*(c.score for c in search.causes), *search.scores):
        found.setdefault(s.candidate.key, s.candidate)
    return list(found.values())


def alias_matrix(search: Search, scores: Sequence[Score]) -> Figure | None:
    """Return the correlations of the strongest candidates' signatures, nominal parameters projected out."""
    wanted = {c.score.candidate.key for c in search.causes}
    wanted |= {a.candidate.key for c in search.causes for a, _ in c.aliases}
    usable = [s for s in scores if s.freedom]
    chosen = [s for s in usable if s.candidate.key in wanted]
    chosen += [s for s in usable if s.candidate.key not in wanted][: COMPARED - len(chosen)]
    chosen = sorted(chosen[:COMPARED], key=lambda s: -s.ratio)
    if len(chosen) < 2:
        return None
    values = np.ones((len(chosen), len(chosen)))
    for i, j in combinations(range(len(chosen)), 2):
        values[i, j] = values[j, i] = correlation(chosen[j], chosen[i])
    names = [label(s.candidate) for s in chosen]
    alt = "correlations of the candidates' signatures in this experiment"
    body = correlation_map(names, names, values, alt)
    caption = (
        "Largest canonical correlation of two candidates' signatures, nominal parameters projected out. Near "
        "one, this experiment cannot tell the two apart."
    )
    return Figure("alias-matrix", "Alias matrix", body, caption)


def label(c: Candidate) -> str:
    """Return a candidate in words."""
    return f"{c.shape.replace('_', ' ')} at {c.location}"


LOGGER = logging.getLogger(__name__)
TELLING = 0.05  # share above which the strongest place counts as one


@dataclass(frozen=True)
class CandidateShare:
    """A candidate and the share [0, 1] of the misfit that it alone explains."""

    candidate: Candidate
    share: float
    cause: bool
    alias: bool


@dataclass(frozen=True)
class Shares:
    """Shares of the misfit explained, the largest first; ``of_causes``: the misfit is what the causes do."""

    places: tuple[MapCell, ...]
    candidates: tuple[CandidateShare, ...]
    of_causes: bool

    @property
    def telling(self) -> bool:
        """Whether a place explains enough of the misfit to be seen."""
        return any(p.share >= TELLING for p in self.places)


def shares_of(search: Search) -> Shares | None:
    """Return the shares of the misfit that every equation and every candidate explains by itself.

    With causes, the misfit is what they do to the innovations, linear at the fit that has them. Without
    a strong cause the simulation strays so far that no derivative there says anything. Without
    causes it is what the nominal fit leaves. Everything nominal is free to move within its prior.
    ``None`` where nothing was measured.
    """
    found = without_causes(search)
    of_causes = found is not None
    found = search.nominal if found is None else found
    total = float(found.residual @ found.residual)
    if not total > 0.0:
        return None
    places = [
        MapCell(b.where, b.dependence, min(1.0, b.ratio / total), b.freedom)
        for b in adequacy(found)
        if b.dependence != PAST and b.freedom  # correlation in time is a symptom, and no share of squares
    ]
    places.sort(key=lambda p: -p.share)
    return Shares(tuple(places), _candidate_shares(search, found, total), of_causes)


def without_causes(search: Search) -> MapFit | None:
    """Return the last fit with only nominal parameters free and what the causes do as its residual.

    ``None`` without causes, and where their part cannot be told.
    """
    if not search.causes:
        return None
    try:
        base = evaluate(search.last.point, search.nominal.unknowns, search.last.problem)
        part = sum(_contribution(search, base, cause) for cause in search.causes)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("what the causes do: %s", error)
        return None
    part = np.asarray(part)
    if not float(part @ part) > 0.0:
        return None
    shape = base.run.innovations.shape
    count = int(np.prod(shape))
    run = replace(base.run, innovations=part[:count].reshape(shape))
    return replace(base, run=run, prior=PriorRows(-part[count:], base.prior.rows))


def _contribution(search: Search, base: MapFit, cause: Cause) -> np.ndarray:
    """What a cause does to the innovations and priors (N rows + priors,), nominal ones projected out."""
    candidate = cause.score.candidate
    columns = propagate(base.run, changes_of(base, candidate)).reshape(-1, len(candidate.free))
    at = {u.name: search.last.point.value(u) for u in search.last.unknowns}
    if candidate.effect is None:
        nominal = {u.name: u for u in search.nominal.unknowns}
        size = [(at[n] - nominal[n].nominal) / nominal[n].scale for n in candidate.free]
    else:
        plain = {p.name: p.value for p in candidate.effect.parameters()}
        steps = zip(candidate.free, candidate.steps, strict=True)
        size = [(at.get(n, plain[n]) - plain[n]) / step for n, step in steps]
    return base.left(columns @ np.array(size)[:, None])[:, 0]


def _candidate_shares(search: Search, found: MapFit, total: float) -> tuple[CandidateShare, ...]:
    listed = _candidates(search)
    # a searched candidate that was narrowed down still has the columns of all it could be: not comparable
    columns = {i: c for i, c in signatures(found, listed).items() if c.shape[1] == len(listed[i].free)}
    named = {c.score.candidate.key for c in search.causes}
    aliases = {a.candidate.key for c in search.causes for a, _ in c.aliases}
    out = []
    for s in score_candidates(found, [listed[i] for i in columns], list(columns.values())):
        if s.freedom:
            c = s.candidate
            out.append(CandidateShare(c, min(1.0, s.ratio / total), c.key in named, c.key in aliases))
    # of equal shares the cause first, then the simpler
    return tuple(sorted(out, key=lambda c: (-round(c.share, 6), not c.cause, len(c.candidate.free))))
