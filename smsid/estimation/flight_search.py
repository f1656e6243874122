"""The search for the maximum over flights: with less and less noise of the model, to none."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from smsid.errors import NotIdentifiableError, SmsidError
from smsid.estimation._contradictions import contradiction_error, contradictions_of_separate
from smsid.estimation._differences import derivatives_hold
from smsid.estimation._likeliest_torques import are_told_by_torques, with_likeliest_motion, with_mean_torques
from smsid.estimation._maximum import equations_at_maximum, has_converged, maximise
from smsid.estimation._normal_equations import NormalEquations, objective_of
from smsid.estimation._restart import guess_sigma, likeliest_of_restarts
from smsid.estimation._trust_region import bounded_step, predicted_gain
from smsid.estimation.commands_between_samples import (
    as_commands_act,
    likelihood_with_own_walks,
    with_timing,
)
from smsid.estimation.fit_quality import FitQuality, fit_quality
from smsid.estimation.flight import Flight
from smsid.estimation.inertial_combinations import reported_parameters
from smsid.estimation.loosening import FIRST_SHARE, SHARE_RATIO, likeliest_share, loosen_model, thin_flight
from smsid.estimation.moving_start import with_moving_start
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.step_size import finely_stepped
from smsid.likelihood.search import GROSS

LOGGER = logging.getLogger(__name__)
NEAR_GAIN = 4.0  # predicted gain of the log-posterior with which a search with noise of the model has ended
LITTLE_ERROR = 1e-3  # share by which a model errs from where on a strict search is near enough
ASTRAY_ERROR = 0.03  # share of what drives the motion, by which a model errs at best that does not follow
WIDE_ATTITUDE = 0.1  # [rad] of the attitude at the start, beyond which a filter's linearisation may not hold

Tell = Callable[[str], None]
Found = tuple[NormalEquations, list[Flight], list[NormalEquations]]


def search_flights(
    described: Point, unknowns: Sequence[Unknown], flights: Sequence[Flight], tell: Tell | None = None
) -> Found:
    """Return the maximum, the flights as their commands are taken, and the points on the way.

    Raises `NotIdentifiableError` where the search does not come to rest, or recordings that are explained
    one by one contradict each other; `SimulationError` where the description loses a recording at once.
    """
    point, near, share = _approach(described, unknowns, flights, tell)
    several = len({f.label for f in flights}) > 1
    if several and share > ASTRAY_ERROR:
        several = False
        _refuse_contradicting(described, unknowns, flights, tell)
    near = [with_moving_start(point, f, share) for f in near]
    try:
        return _at_rest(point, unknowns, near, tell)
    except NotIdentifiableError:
        if several:
            _refuse_contradicting(described, unknowns, flights, tell)
        raise


def _approach(
    described: Point, unknowns: Sequence[Unknown], flights: Sequence[Flight], tell: Tell | None
) -> tuple[Point, list[Flight], float]:
    """Return where a strict search may begin, the flights for it, and how much the model errs there at best.

    Far from the maximum, a model that may err has a likelihood without the many maxima of one that may not.
    It errs by the share of what drives it that is likeliest at the point, which every search lowers: one that
    is begun with much less than what is left of errors, begins beyond what its quadratic form holds for.
    Beside such errors little is told of hidden masses and springs, which would run after them: they stay near
    where they are described, as long as nothing tells otherwise.
    """
    unknowns = [replace(u, sigma=guess_sigma(u)) for u in unknowns]
    point, coarse = described, [thin_flight(f) for f in flights]
    fewer = any(c is not f for c, f in zip(coarse, flights, strict=True))
    share, last, astray = likeliest_share(point, coarse, FIRST_SHARE), np.inf, 0.0
    while share < last and (share or fewer):
        if tell is not None:
            tell(f"search with a model that may err by {100 * share:.2g} % of what drives the motion")
        loose = [replace(f, problem=loosen_model(f.model, f.problem, share)) for f in coarse]
        point = maximise(point, unknowns, loose, enough=NEAR_GAIN, tell=tell)[0].point
        if not fewer:
            coarse = [
                with_timing(f, as_commands_act(point, unknowns, x, False).problem.timing)
                for f, x in zip(coarse, loose, strict=True)
            ]
        last, share = share, likeliest_share(point, coarse, share) if share else 0.0
        if share == last and share > LITTLE_ERROR:  # all the way to a strict one would be a longer way still
            share, astray = SHARE_RATIO * share, max(astray, share)
    share = max(share, astray)
    flights = [as_commands_act(point, unknowns, f, False) for f in flights] if fewer else coarse
    return point, list(flights), share


def _at_rest(point: Point, unknowns: Sequence[Unknown], flights: list[Flight], tell: Tell | None) -> Found:
    """Return the maximum of the model as it is, near a point.

    At the likeliest motion of all readings, where torques tell what is asked; else in the mean over all
    torques. The search goes there last: where it has far to go, readings that a wrong model leaves far off
    would lead.
    """
    if tell is not None:
        tell("search with the model as it is")
    begins = [point]
    if any(f.problem.profiled for f in flights):
        try:
            found, taken, _ = _searched(point, unknowns, flights, tell)
            taken = with_likeliest_motion(taken)
            found, more = maximise(found.point, unknowns, taken, tell=tell)
            found, taken, visited = _settled(found, taken, more, tell)
            if are_told_by_torques(found, taken):  # it has not gone off to where noise fits noise
                return found, taken, visited
            begins.append(found.point)
        except NotIdentifiableError as error:
            LOGGER.info("not at the likeliest torques: %s", error)
    averaged = with_mean_torques(flights)
    begin = min(begins, key=lambda x: objective_of(x, unknowns, averaged)) if begins[1:] else point
    return _settled(*_searched(begin, unknowns, averaged, tell), tell)


def _searched(point: Point, unknowns: Sequence[Unknown], flights: list[Flight], tell: Tell | None) -> Found:
    """Return the maximum near a point, with commands as they are likeliest there."""
    found, visited = maximise(point, unknowns, flights, tell=tell)
    acting = [as_commands_act(found.point, unknowns, f, has_converged(found)) for f in flights]
    if any(a.problem.timing != f.problem.timing for a, f in zip(acting, flights, strict=True)):
        otherwise, more = maximise(found.point, unknowns, acting, tell=tell)
        if likelihood_with_own_walks(otherwise.point, acting) > likelihood_with_own_walks(
            found.point, flights
        ):
            return otherwise, acting, visited + more
    return found, flights, visited


def _settled(
    found: NormalEquations, flights: list[Flight], visited: list[NormalEquations], tell: Tell | None
) -> Found:
    """Return a maximum at rest, with steps as short as it needs, the likeliest that is found."""
    found, again = likeliest_of_restarts(found, flights, tell)
    found, flights, more = finely_stepped(found, flights, tell)
    found, last = settled_maximum(found, [], flights, tell)
    return found, flights, [*visited, *again, *more, *last]


def settled_maximum(
    found: NormalEquations, visited: list[NormalEquations], flights: list[Flight], tell: Tell | None
) -> tuple[NormalEquations, list[NormalEquations]]:
    """Return the maximum, by differences of whole runs where slopes along states do not lead there."""
    if not has_converged(found):  # so far off, better derivatives do not help
        left = fit_quality(found)
        if max((c.ratio for c in left.channels), default=0.0) > GROSS:
            raise convergence_error(flights, left)
    if not has_converged(found) or not derivatives_hold(found, flights):
        found = equations_at_maximum(found, flights, tell=tell)
        visited = [*visited, found]
    if not has_converged(found):
        raise convergence_error(flights, fit_quality(found))
    return found, visited


def _refuse_contradicting(
    described: Point, unknowns: Sequence[Unknown], flights: Sequence[Flight], tell: Tell | None
) -> None:
    """Raise `NotIdentifiableError` where each recording is explained by itself, and they differ in what."""
    alone: list[NormalEquations] = []
    for label in dict.fromkeys(f.label for f in flights):
        if tell is not None:
            tell(f"'{label}' by itself")
        own = [f for f in flights if f.label == label]
        try:
            point, near, share = _approach(described, unknowns, own, tell)
            near = [with_moving_start(point, f, share) for f in near]
            found = maximise(point, unknowns, near, enough=NEAR_GAIN, tell=tell)[0]
        except SmsidError as error:
            LOGGER.info("'%s' by itself: %s", label, error)
            return
        if any(c.judgement == "not explained" for c in fit_quality(found).channels):
            return
        alone.append(found)
    scales, sigmas = alone[0].scales, np.array([u.sigma for u in unknowns])
    nominal = np.array([u.nominal for u in unknowns])
    # a search that halts before its maximum is off by as many standard deviations at most
    off = max(predicted_gain(a, bounded_step(a)) for a in alone)
    found = contradictions_of_separate(
        [a.terms[0].label for a in alone],
        [a.information for a in alone],
        [(np.array([a.point.value(u) for u in unknowns]) - nominal) / scales for a in alone],
        np.diag((scales / sigmas) ** 2),
        [reported_parameters(a, described) for a in alone],
        max(1.0, np.sqrt(2.0 * off)),
    )
    if found:
        raise contradiction_error(found)


def convergence_error(flights: Sequence[Flight], quality: FitQuality) -> NotIdentifiableError:
    """Return the error of a search that does not come to rest, with what may be the reason."""
    wide = {f.label: x for f in flights if (x := _widest_turn(f)) > WIDE_ATTITUDE}
    if wide:
        label, turn = next(iter(wide.items()))
        return NotIdentifiableError(
            "The search for the most likely parameters does not come to rest: nothing reads the attitude in "
            f"'{label}', and at the start it is known to {turn:.2g} rad only.",
            advice="Say how well it is known, as in --start attitude=0.02,rate=0.01 (rad, rad/s).",
            attitude=wide,
        )
    doubts = [f"'{f.label}' is {n}. " for f in flights for n in f.notes if n.startswith("doubtful")]
    if quality.judgement == "not explained":
        doubts.append(f"Where it stopped: {quality.sentence} `smsid diagnose` looks for what is missing. ")
    taken = {f.label: [n for n in f.notes if not n.startswith("doubtful")] for f in flights}
    taken = {label: notes for label, notes in taken.items() if notes}
    granted = " ".join(f"Taken for granted of '{label}': {'; '.join(n)}." for label, n in taken.items())
    return NotIdentifiableError(
        "The search for the most likely parameters does not come to rest.",
        advice="".join(doubts)
        + "Give priors (`prior`, --cad), or mark as known what the recordings do not tell. "
        + granted,
        taken=taken,
    )


def _widest_turn(flight: Flight) -> float:
    """Return the largest standard deviation of the attitude at the start [rad]."""
    begin = flight.problem.begin
    if begin is None or not flight.model.free:
        return 0.0
    return float(np.sqrt(begin.covariance.diagonal()[3:6].max()))
