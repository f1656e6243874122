"""From a search to a verdict in words: names in levels, aliases with what would separate them, limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import chi2

from smsid._statistics import NORMAL95
from smsid._time_text import about_text
from smsid.diagnose._change_time_posterior import Began, onset_posteriors
from smsid.diagnose._noise_covariance import strays_by_row
from smsid.diagnose._plausibility import impossible
from smsid.diagnose._wald_test import strengths, wald
from smsid.diagnose.model_comparison import Cause, own_component
from smsid.diagnose.result import Alias, FoundCause, Limit, SignificantTest, Value, Verdict
from smsid.diagnose.score_test import Candidate, Score
from smsid.diagnose.specification_tests import SpecificationTest
from smsid.diagnose.stepwise import Search
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.estimation.joint_problem import on_own_clock
from smsid.estimation.parameter_vector import Unknown

if TYPE_CHECKING:
    from smsid.diagnose.torque.candidates import TorqueCandidate

    Named = Candidate | TorqueCandidate

IN_PIECES = (
    "The simulation does not explain the recording: what would, begins in turn, as the pieces of a drift do "
    "that no cause fits: {}."
)
ROUND = 0.02  # how near to a whole number a gain is told in words

SEPARATE = {
    frozenset(pair): how
    for *pair, how in (
        ("inertia", "motor inertia", "turn the base, which turns links, not motors; if fixed, a data sheet"),
        ("viscous", "coulomb", "move the joint at several rates, a slow one among them"),
        ("force, body", "force, inertial", "turn the spacecraft: one turns with it, one does not"),
        ("torque, body", "torque, inertial", "turn the spacecraft: one turns with it, one does not"),
        ("actuator", "sensor", "command a step with the sensor at rest, then move with no command"),
        ("friction", "actuator", "hold the joint against a torque, then move it at constant rate"),
        ("inertia", "actuator", "repeat with another pose of the arm: inertia changes, a gain does not"),
        ("external", "sensor", "coast without commands: a force moves the spacecraft, a bias does not"),
        ("external", "actuator", "coast without commands, then repeat with other commands"),
    )
}


def causes(found: Search) -> tuple[FoundCause, ...]:
    """Return the causes of a search with their values at the last fit."""
    described = {e.name for e in found.nominal.point.description.effect}
    starts = onset_posteriors(found.last, found.causes, described)
    return tuple(_cause(found, cause, starts) for cause in found.causes)


def _cause(found: Search, cause: Cause, starts: Mapping[str, Began]) -> FoundCause:
    """A shape that is not claimed may be any sibling's: the likeliest are listed, the number is evidence."""
    own = cause.score.candidate
    start = None if own.effect is None else starts.get(own.effect.name)
    begun, recording = own.start, own.recording
    if begun is not None:
        begun, recording = on_own_clock(found.last.problem, begun)
    siblings = [(s, c) for s, c in cause.aliases if is_sibling(s.candidate, own)]
    others = [(s, c) for s, c in cause.aliases if not is_sibling(s.candidate, own)]
    also_at, errors = group_equivalent(cause, others)
    told = [*((s, c, ()) for s, c in siblings[: max(1, THRESHOLDS.aliases - len(errors))]), *errors]
    aliases = tuple(replace(alias(own, s.candidate, c), also_at=where) for s, c, where in told)
    return FoundCause(
        effect=own.kind,
        location=own.location,
        family=own.family,
        shape=None if siblings else own.shape,
        parameters=values(found, own, starts),
        aliases=aliases,
        evidence={
            "likelihood_ratio": float(cause.ratio),
            "freedom": float(cause.score.freedom),
            "p_value": float(min(1.0, cause.score.p_value * found.candidates)),
            "information_gain": float(cause.score.information_gain(found.samples)),
            "siblings_not_rejected": float(len(siblings)),
        },
        onset=begun,
        onset_sigma=None if start is None else start.sigma,
        fitted=own.shape,
        recording=recording,
        also_at=also_at,
    )


def values(
    found: Search, candidate: Candidate, starts: Mapping[str, Began] = MappingProxyType({})
) -> tuple[Value, ...]:
    """Return a cause's parameters at the last fit.

    Further ones of its effect that were not fitted, but have a prior, count in the uncertainties of the rest,
    and so does when it and the others began.
    """
    unknowns: dict[str, Unknown] = {u.name: u for u in found.last.unknowns}
    assumed = _assumed_parameters(found, candidate)
    covariance = (found.last.with_unfitted(assumed) if assumed else found.last).covariance()
    names, told = [u.name for u in found.last.unknowns], found.last.told
    covariance = covariance[: len(names), : len(names)] + sum(s.covariance for s in starts.values())
    out = []
    for name in (*candidate.free, *(n for n in candidate.also if n in unknowns)):
        u = unknowns[name]
        i = names.index(name)
        sigma = float(np.sqrt(covariance[i, i])) if told[i] else np.inf
        nominal = u.nominal if candidate.effect is None or candidate.beside is not None else None
        value, ends = float(found.last.point.value(u)), found.bent.get(name)
        # of a fit without hints that is elsewhere, it is no interval
        own = ends if ends is not None and ends[0] <= value <= ends[1] else _within_bounds(u, value, sigma)
        out.append(Value(name, value, sigma, u.unit, nominal, own))
    return tuple(out)


def _within_bounds(u: Unknown, value: float, sigma: float) -> tuple[float, float] | None:
    """Return the 95 % interval of a Gaussian that reaches beyond what a parameter can be, cut off there;
    nothing of one that does not.
    """
    reach = NORMAL95 * sigma
    if not (u.lower <= value <= u.upper and np.isfinite(sigma)):
        return None
    if u.lower <= value - reach and value + reach <= u.upper:
        return None
    return max(value - reach, u.lower), min(value + reach, u.upper)


def _assumed_parameters(found: Search, candidate: Candidate) -> list[Unknown]:
    if candidate.effect is None:
        return []
    fitted = {u.name for u in found.last.unknowns}
    return [
        Unknown.of_parameter(p, p.sigma, p.sigma)
        for p in candidate.instance(found.last.point).parameters()
        if p.name in candidate.also and p.name not in fitted and p.sigma is not None
    ]


def group_equivalent(
    cause: Cause, others: Sequence[tuple[Score, float]]
) -> tuple[tuple[str, ...], list[tuple[Score, float, tuple[str, ...]]]]:
    """Return where else a cause may be as well, and its aliases, each with where else that may be.

    Errors of one kind that all can do what the cause does (the inertia about a joint of any link beyond it)
    are one base parameter to these recordings: one name, at several places.
    """
    own = cause.score
    first = {own.candidate.key[::2]: own}
    places: dict[int, tuple[str, ...]] = {}
    errors = []
    for s, how in others:
        same = s.candidate.key in cause.equivalent
        one = first.setdefault(s.candidate.key[::2], s) if same else s
        if one is s:
            errors.append((s, how))
        else:
            places[id(one)] = (*places.get(id(one), ()), s.candidate.location)
    return places.get(id(own), ()), [(s, how, places.get(id(s), ())) for s, how in errors]


def is_sibling(a: Named, b: Named) -> bool:
    """Whether two are of one family at one place."""
    return a.location == b.location and a.family == b.family


def alias(own: Named, other: Named, correlation: float) -> Alias:
    """Return a candidate as one that a cause is not told from."""
    told = other.kind, other.location, other.family, other.shape
    return Alias(*told, float(correlation), separate(own, other))


def separate(a: Named, b: Named) -> str:
    """Return in words which experiment would tell two candidates apart."""
    for pair in (frozenset((a.shape, b.shape)), frozenset((a.family, b.family))):
        if pair in SEPARATE:
            return SEPARATE[pair]
    if "load-dependent" in (a.shape, b.shape):
        return "repeat the same motion with and without a payload"
    if a.location == b.location and "motor inertia" in (a.shape, b.shape):
        return f"accelerate {a.location} harder in several poses of the arm"
    if a.location != b.location:
        return f"move {a.location} and {b.location} one after the other"
    return "a longer recording with more varied motion"


def limits(found: Search) -> tuple[Limit, ...]:
    """Return the detection limit of every candidate: 95 % power at the corrected level, nuisances free."""
    needed = found.levels.detectable(found.candidates)
    out = []
    for s in found.scores:
        c = s.candidate
        units = {u.name: u.unit for u in (*found.last.unknowns, *_own_unknowns(c))}
        for i, (name, step) in enumerate(zip(c.free, c.steps, strict=True)):
            sigma = step * float(np.sqrt(max(s.covariance[i, i], 0.0)))
            if i and sigma == 0.0:
                continue  # it has no meaning where the strength is zero
            value = needed * sigma if s.freedom and sigma > 0.0 else float("nan")
            out.append(Limit(c.kind, c.location, c.shape, name, value, units.get(name, "")))
    return tuple(out)


def _own_unknowns(candidate: Candidate) -> tuple[Unknown, ...]:
    return candidate.unknowns(()) if candidate.effect is not None else ()


def remaining_tests(
    found: Search, decided: Verdict, standing: Sequence[FoundCause] = ()
) -> tuple[SignificantTest, ...]:
    """Return the generic tests that are still significant in the description that the diagnosis hands back.

    That is the given one where no cause is named. Behind them come the bands of frequency in which channels
    are left above their noise.
    """
    left = _pattern_left(found, standing) if decided == "unexplained" else found.left
    return test_results((*left, *found.bands), len(found.blocks))


def _pattern_left(found: Search, standing: Sequence[FoundCause]) -> tuple[SpecificationTest, ...]:
    """Return the generic tests that say best what is not explained: what explains a part only takes the
    pattern apart, a cause that stands takes away what is its own.
    """
    sought = {c.score.candidate.key[:2] for c in found.causes}
    stand = {(c.effect, c.location) for c in standing} & sought
    if found.left and stand:  # beside hints, it is what these leave, too: at the right place
        return found.left
    return found.left_before or found.left


def test_results(blocks: Sequence[SpecificationTest], tests: int) -> tuple[SignificantTest, ...]:
    """Return generic tests as results, their p-values corrected for so many."""
    return tuple(
        SignificantTest(b.where, b.dependence, b.ratio, b.freedom, min(1.0, b.p_value * tests))
        for b in blocks
    )


def verdict(
    found: Search,
    named: Sequence[FoundCause],
    standing: Sequence[FoundCause] = (),
    hints: Sequence[FoundCause] | None = None,
) -> tuple[Verdict, str]:
    """Return the verdict and one sentence; ``named`` are all causes, faults of samples among them.

    Where it is ``unexplained``, those ``standing`` are causes all the same, and ``hints`` (all, if not given)
    parts of an explanation.
    """
    left, words = found.left, _in_words(named)
    hints = named if hints is None else hints
    doubts = (*map(impossible, named), *(_may_be_nothing(found, c) for c in found.causes))
    doubted = next((d for d in doubts if d), "")
    if doubted:
        worst = next(iter((*found.left_before, *left)), None)
        what = "" if worst is None else f": {worst.where} depends on {worst.dependence}"
        what += f"{';' if what else ':'} what would ({_in_words(hints)}) is not believed" if hints else ""
        what += f", as {doubted}."
        return "unexplained", f"The simulation does not explain the recording{what}{_parts((), standing)}"
    if found.misfit:
        return _with_misfit(found, named, standing, hints)
    if left:
        worst = _pattern_left(found, standing)[0]
        what = f"{worst.where} depends on {worst.dependence}"
        sentence = f"The simulation does not explain the recording: {what}, and no cause fits it."
        still = f"{left[0].where} still depends on {left[0].dependence}"
        beside = f"; beside it {still}" if worst is not left[0] else ""
        return "unexplained", sentence + _parts(hints, standing, beside)
    if is_piecewise_drift(named):
        return "unexplained", IN_PIECES.format(words)
    open_ = _left_by_causes(found)
    if open_:
        said = f"The simulation does not explain the recording: {open_}."
        return "unexplained", said + _parts(hints, standing)
    if named:
        return "explained", f"The simulation lacks {words}."
    return "adequate", "The simulation explains the recording to its noise."


def is_piecewise_drift(named: Sequence[FoundCause]) -> bool:
    """Whether causes of one family begin at different times: what goes on changing is put together so.

    Sensors fail one by one, and a force is no piece of a torque: of these, only those of one sensor and of
    one effect belong together.
    """
    begun: dict[tuple[str, str], list[float]] = {}
    for cause in named:
        if cause.onset is not None:
            sensor, effect = cause.location.split(".")[0], f"{cause.effect}: {cause.fitted}"
            own = {"sensor": sensor, "external": effect}.get(cause.family, "")
            begun.setdefault((cause.family, own), []).append(cause.onset)
    return any(max(times) - min(times) > THRESHOLDS.in_turn for times in begun.values())


def _in_words(causes: Sequence[FoundCause]) -> str:
    return "; ".join(describe(c) for c in causes)


def _parts(hints: Sequence[FoundCause], standing: Sequence[FoundCause], beside: str = "") -> str:
    """Return which causes stand where the whole does not, and which explain a part only."""
    told = f" What stands all the same: {_in_words(standing)}." if standing else ""
    return told + (f" Explaining a part: {_in_words(hints)}{beside}." if hints else "")


def _with_misfit(
    found: Search,
    named: Sequence[FoundCause],
    standing: Sequence[FoundCause],
    hints: Sequence[FoundCause],
) -> tuple[Verdict, str]:
    """The model still strays: causes are named where they take away most of it, the rest is stated."""
    words = _in_words(named)
    worst = max(found.noise, key=lambda channel: found.noise[channel])
    rest = f"what is left is up to {found.noise[worst]:.3g} times the noise, in {worst}"
    mostly = bool(words) and found.followed >= THRESHOLDS.mostly
    if mostly and is_piecewise_drift(named):
        return "unexplained", IN_PIECES.format(words)
    beside = _left_by_causes(found)
    if mostly and not beside:
        return "explained", f"The simulation lacks {words}; {rest}, and is counted in the uncertainties."
    why = f"{beside}; {rest}" if mostly else f"{rest}, and no cause fits it"
    sentence = f"The simulation does not follow the recording: {why}."
    return "unexplained", sentence + _parts(hints, standing)


def _plainly(cause: FoundCause, p: Value) -> str:
    """Return in words what a large value of a gain or scale means."""
    if not p.name.partition(".")[2].startswith(("error", "gain")) or p.unit != "1":
        return ""
    if abs(p.value + 2.0) < ROUND + 3.0 * p.sigma:
        return " (its sign is reversed)"
    if cause.family == "actuator" and abs(p.value + 1.0) < ROUND + 3.0 * p.sigma:
        return " (it does nothing)"
    return ""


def _value_text(p: Value) -> str:
    return about_text(p.value) if p.name.endswith(".time") else f"{p.value:.4g}"


def describe(cause: FoundCause) -> str:
    """Return a cause in words, with its value and those it is not told from."""
    what = f"{cause.label} ({cause.effect}) at {cause.places}"
    if cause.parameters:
        first = cause.parameters[0].name.split(".")[1]  # the strength; a place or a phase is none
        own = [p for p in cause.parameters if p.nominal is not None or p.name.split(".")[1] == first]
        told = [p for p in own if np.isfinite(p.sigma)] or own
        p = max(told, key=lambda p: abs(p.value - (p.nominal or 0.0)) / max(p.sigma, 1e-300))
        shift = f" instead of {p.nominal:.4g}" if p.nominal is not None else ""
        what += (
            f": {p.name.rpartition('.')[2]} = {_value_text(p)} {p.spread} {p.unit}{shift}{_plainly(cause, p)}"
        )
    if cause.onset is not None:
        sigma = cause.onset_sigma
        own = f" of {cause.recording!r}" if cause.recording else ""
        give = "" if sigma is None or not np.isfinite(sigma) else f" +- {NORMAL95 * sigma:.2g}"
        what += f", from {about_text(cause.onset)}{give} s{own} on"
    elif cause.recording and "likelihood_ratio" in cause.evidence:  # a fault may be in others, too
        what += f", in {cause.recording!r} alone"
    others = [f"{a.shape} at {a.places}" for a in cause.aliases[:3]]
    return what + (f" (or {', or '.join(others)})" if others else "")


def _may_be_nothing(found: Search, cause: Cause) -> str:
    """Return in words that a cause is told from none no longer, beside all that was found; else nothing.

    Where the likelihood is bent, that is said by its profile along what makes the cause do something.
    """
    own = cause.score.candidate
    able = {name for name, makes in zip(own.free, strengths(own), strict=True) if makes}
    for u in found.last.unknowns:
        low, high = found.bent.get(u.name, (-np.inf, np.inf))  # an end at a bound is open
        away = max(u.nominal, u.lower) < low or high < min(u.nominal, u.upper)
        if able == {u.name} and low <= found.last.point.value(u) <= high and away and np.isfinite(high - low):
            return ""
    chance = float(chi2.sf(wald(found.last, own, strength=True), sum(strengths(own))))
    told = f"{own.shape} ({own.kind}) at {own.location} may as well be nothing"
    return told if chance > THRESHOLDS.nested else ""


def _left_by_causes(found: Search) -> str:
    return next((left for c in found.causes if (left := own_component_left(found, c))), "")


def own_component_left(found: Search, cause: Cause) -> str:
    """Return which component a cause changes most, in stated noise, where that is still left far off.

    By misfit where that is counted, else by prediction errors beyond the noise as fitted.
    """
    last, own = found.last, own_component(found.last, cause.score.candidate, found.factors)
    left = found.factors if found.misfit else strays_by_row(last.run, np.ones_like(found.factors))
    if left[own] <= THRESHOLDS.own_channel:
        return ""
    return f"{last.problem.data.names[own]} is left at {left[own]:.3g} times its noise"
