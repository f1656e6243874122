"""Which causes stand though something else is left: those that are proven where they show themselves."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from smsid.diagnose._noise_covariance import InflatedFit
from smsid.diagnose._plausibility import impossible
from smsid.diagnose._profile_intervals import with_profile_intervals
from smsid.diagnose._unknown_input import NEAR, fit_noise_of_unknown_inputs, with_unknown
from smsid.diagnose._unknown_structure import but_for_a_structure
from smsid.diagnose._wald_test import chance_of_nothing, each_may_be_zero, strengths
from smsid.diagnose._without_cause import without_cause
from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.result import FoundCause
from smsid.diagnose.score_test import Candidate
from smsid.diagnose.specification_tests import adequacy, equations_of, is_at
from smsid.diagnose.stepwise import Search
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.diagnose.verdict import causes, own_component_left
from smsid.errors import SmsidError
from smsid.estimation.map_estimate import MapFit, fit

LOGGER = logging.getLogger(__name__)


def find_standing_causes(
    found: Search, named: Sequence[FoundCause]
) -> tuple[Search, tuple[FoundCause | None, ...]]:
    """Return the search with the fit that says how large causes are, and those that stand whatever is left
    elsewhere, ``None`` in the place of the others; ``named`` are all of them.

    Their values can be, nothing of another place looks like them, and they are needed also where what is left
    is taken as unknown, or what was left without any cause: the equations and channels that depend on
    something, or where misfit is counted, a structure whose own motion is all that is not followed. Their
    values are those they have then,
    with what is unknown as large as is likeliest: before, they bent to the rest. Of causes at a place that is
    unknown, only those of such a structure stand, with the misfit counted in their values, where the causes
    take most of it away.
    """
    rest = None
    if named:
        rest = _but_for_a_structure(found) if found.misfit else _rest_unknown(found)
    if rest is None:
        return found, (None,) * len(named)
    last, lost = rest
    mostly = found.misfit and found.followed >= THRESHOLDS.mostly
    there = [any(is_at(told.location, place) for place in lost.values()) for told in named]
    likeliest = fit_noise_of_unknown_inputs(last)
    stand = [
        not impossible(told)
        and not told.also_at
        and all((a.location, a.family) == (told.location, told.family) for a in told.aliases)
        and (mostly or not here)
        and (found.misfit or not own_component_left(found, cause))
        and _is_needed(found, cause, found.last if here else last)
        and (here or likeliest is last or _is_needed(found, cause, likeliest))  # what its size is told by
        for cause, told, here in zip(found.causes, named, there, strict=True)
    ]
    if any(stand) and not found.misfit:
        stand = _stand_otherwise(found, stand, lost, likeliest)
    elsewhere = [yes and not here for yes, here in zip(stand, there, strict=True)]
    kept = tuple(c for c, yes in zip(found.causes, elsewhere, strict=True) if yes)
    unknown = f"taken as unknown where causes elsewhere are judged: {', '.join(lost)}"
    profiles = with_profile_intervals(replace(found, causes=kept))
    by = replace(
        found,
        last=likeliest,
        causes=kept,
        failed=(*profiles.failed, unknown) if kept else found.failed,
        bent=profiles.bent,
    )
    values = iter(causes(by))
    own = [next(values) if yes else told for yes, told in zip(elsewhere, named, strict=True)]
    known = [not _is_of_no_size(c.score.candidate, told) for c, told in zip(found.causes, own, strict=True)]
    stand = [yes and sure for yes, sure in zip(stand, known, strict=True)]
    return by, tuple(told if yes else None for yes, told in zip(stand, own, strict=True))


def _is_of_no_size(candidate: Candidate, told: FoundCause) -> bool:
    """Whether the interval of every parameter that makes a cause do something, as told, holds nothing or has
    no end: of a likelihood that is no Gaussian's, a profile may though a standard deviation does not.
    """
    if candidate.effect is None:
        return False
    nothing = {p.name: p.value for p in candidate.effect.parameters()}
    intervals = {p.name: p.interval for p in told.parameters}
    names = [n for n, strong in zip(candidate.free, strengths(candidate), strict=True) if strong]
    known = [(*intervals[n], nothing[n]) for n in names if n in intervals and n in nothing]
    return bool(known) and all(low <= no <= high or np.isinf(high - low) for low, high, no in known)


def _is_needed(found: Search, cause: Cause, rest: MapFit) -> bool:
    """Whether a cause is needed where what is left is taken as unknown, and is there at all."""
    own = cause.score.candidate
    if each_may_be_zero(rest, own):  # a frequency may be known where the mass is none
        return False
    try:
        less = without_cause(rest, own, found.nominal) if rest.problem.coloured else rest
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("%s is not taken out: %s", own.key, error)
        return False
    tried = 0.5 * cause.score.sides * found.candidates
    return tried * chance_of_nothing(rest, own, less) < found.levels.further


def _stand_otherwise(
    found: Search, stand: Sequence[bool], lost: Mapping[str, str], likeliest: MapFit
) -> list[bool]:
    """Return which causes stand also where it is not what they leave that is taken as unknown (the
    ``likeliest`` fit of that), but what was left without any, if that leaves nothing either and is likelier.

    Causes that stand in for a torque by chance at one joint leave little of it, and that at its neighbour.
    """
    other = _rest_unknown(replace(found, blocks=found.before), rounds=1)
    if other is None or set(other[1]) <= set(lost):
        return list(stand)
    last, places = other
    rival = fit_noise_of_unknown_inputs(last).run
    if rival.samples != likeliest.run.samples or rival.log_likelihood < likeliest.run.log_likelihood:
        return list(stand)  # of other readings, or worse
    LOGGER.info("nor is anything left without %s", places)
    return [
        yes
        and not any(is_at(c.score.candidate.location, place) for place in places.values())
        and _is_needed(found, c, last)
        for c, yes in zip(found.causes, stand, strict=True)
    ]


def _rest_unknown(found: Search, rounds: int = THRESHOLDS.peeled) -> tuple[MapFit, dict[str, str]] | None:
    """Return the last fit made again with what is left taken as unknown, and the places of that by name;
    nothing where it cannot be fitted or something is still left.

    One after the other, the worst first: what it leaves shows in its neighbours, too.
    """
    lost, here = dict[str, str](), found
    for _ in range(rounds):
        left = [t for t in here.left if t.where not in lost]
        if not left:
            return here.last, lost
        worst = max(left, key=lambda t: t.ratio / max(t.freedom, 1))
        channel = worst.where.partition("[")[0]  # its components are left for one reason
        lost.update({t.where: t.location for t in left if t.where.partition("[")[0] == channel})
        try:
            dofs = sorted({dof for e in equations_of(found.last) if e.name in lost for dof in e.v})
            problem = with_unknown(found.last.problem, *lost, run=found.last.run, dofs=dofs)
            fitted = fit(found.last.point, found.last.unknowns, problem, iterations=4, enough=NEAR)
            here = replace(found, last=fitted, blocks=tuple(adequacy(fitted)))
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("nothing stands without %s: %s", ", ".join(lost), error)
            return None
        LOGGER.info("without %s is left: %s", lost, [(t.where, t.dependence) for t in here.left])
    return None if any(t.where not in lost for t in here.left) else (here.last, lost)


def _but_for_a_structure(found: Search) -> tuple[MapFit, dict[str, str]] | None:
    """Return the last fit with the structure unknown that is all that is not followed, and its place; its own
    causes stay as they were fitted. Nothing where there is none.
    """

    def own(place: str) -> set[str]:
        causes = (c.score.candidate for c in found.causes)
        return {n for c in causes if is_at(c.location, place) for n in c.parameters}

    rest = but_for_a_structure(InflatedFit(found.last, found.factors), own)
    return None if rest is None else (rest.fit, {rest.unknown: rest.unknown})
