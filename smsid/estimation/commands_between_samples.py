"""How commands go on between samples, and what an estimate owes to that where it is not told."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.special import softmax

from smsid.errors import SmsidError
from smsid.estimation._maximum import maximise
from smsid.estimation._normal_equations import (
    NormalEquations,
    log_likelihood_of,
    normal_equations,
    prior_offset,
)
from smsid.estimation._trust_region import bounded_step, predicted_gain
from smsid.estimation.flight import Flight
from smsid.estimation.input_hold import VARYING, input_channels
from smsid.estimation.input_timing import CLEAR_GAIN, HOPELESS_LOSS, PARTS, timings
from smsid.estimation.loosening import MOST_SAMPLES
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import CommandTiming

LOGGER = logging.getLogger(__name__)
SHARE, FURTHEST = 1.0 / 3.0, 6  # of its walk that a torque is tried with next, and how often
STEPS = 4  # of a search for the parameters that go with another way
NEGLIGIBLE_SHARE = 1e-4  # probability of a way to act, below which it does not count
NEGLIGIBLE_SHIFT = 0.1  # of a standard deviation, by which all parameters may differ without a note


def as_commands_act(point: Point, unknowns: Sequence[Unknown], flight: Flight, at_rest: bool) -> Flight:
    """Return the flight with commands held, linear or both between samples, as is most likely near a point.

    Where the search is ``at_rest``, each way is judged by what the likelihood would come to one step of all
    parameters on: those of a fit make up for a wrong way, as inertia for a wave that straight lines cut off.
    Ways far behind over the first samples go no further.
    """
    choices = timings(flight.problem.recording)
    if len(choices) == 1:
        return flight
    now = flight.problem.timing
    likely = _over_first_samples(point, unknowns, flight, choices, at_rest)
    ahead = _not_hopeless(likely)
    if len(ahead) != 1:
        likely = _likelihoods(point, unknowns, flight, ahead or choices, at_rest)
    best = max(likely, key=lambda t: likely[t], default=now)
    # at rest `undecided_covariance` says how far it is told how they act, the sides of jumps apart
    either = at_rest and _way(best) != _way(now)
    if likely.get(best, -np.inf) - likely.get(now, -np.inf) < (0.0 if either else CLEAR_GAIN):
        best = now
    told = ", ".join(f"{t.words} {t.side} {x:.1f}" for t, x in likely.items())
    LOGGER.info("commands of '%s' taken as %s, %s: %s", flight.label, best.words, best.side, told)
    return with_timing(flight, best)


def _over_first_samples(
    point: Point, unknowns: Sequence[Unknown], flight: Flight, choices: Sequence[CommandTiming], at_rest: bool
) -> dict[CommandTiming, float]:
    """Return the same as `_likelihoods` of the first of `PARTS` parts of a flight."""
    data = flight.problem.data
    some = replace(flight, problem=replace(flight.problem, data=data.first(-(-len(data.times) // PARTS))))
    return _likelihoods(point, unknowns, some, choices, at_rest)


def _not_hopeless(likely: dict[CommandTiming, float]) -> list[CommandTiming]:
    return [t for t in likely if likely[t] > max(likely.values()) - HOPELESS_LOSS]


def _likelihoods(
    point: Point, unknowns: Sequence[Unknown], flight: Flight, choices: Sequence[CommandTiming], at_rest: bool
) -> dict[CommandTiming, float]:
    """Return how likely a flight is with commands as in each choice that a filter can follow."""
    likely: dict[CommandTiming, float] = {}
    for timing in choices:
        try:
            other = _with_likely_walks(point, with_timing(flight, timing))
            if at_rest:
                here = normal_equations(point, unknowns, [other])
                likely[timing] = predicted_gain(here, bounded_step(here)) + here.log_posterior
            else:
                likely[timing] = log_likelihood_of(point, [other])
        except SmsidError as error:
            LOGGER.info("not %s, %s: %s", timing.words, timing.side, error)
    return likely


def likelihood_with_own_walks(point: Point, flights: Sequence[Flight]) -> float:
    """Return the log-likelihood of flights whose commands act in some way, to be held against another way."""
    return log_likelihood_of(point, [_with_likely_walks(point, f) for f in flights])


def _with_likely_walks(point: Point, flight: Flight) -> Flight:
    """Return the flight with torques that follow measured motion as lively as its first samples say.

    What they wander is a wide guess, which an estimate bears. Between ways of commands it would decide:
    the more of a torque's step is told by its mean, the less it costs that it could have been larger. A model
    that may err (`loosen_model`) is another guess, beside which it tells nothing.
    """
    if flight.problem.noise.accelerations or all(u.row < 0 for u in flight.problem.unknown_inputs):
        return flight
    data = flight.problem.data.first(MOST_SAMPLES)

    def wandering(factor: float) -> Flight:
        walks = tuple(
            replace(u, walk=u.walk * factor) if u.row >= 0 else u for u in flight.problem.unknown_inputs
        )
        return replace(flight, problem=replace(flight.problem, unknown_inputs=walks))

    @cache
    def likely(power: int) -> float:
        some = wandering(SHARE**power)
        return log_likelihood_of(point, [replace(some, problem=replace(some.problem, data=data))])

    power, way = 0, 1 if likely(1) > likely(0) else -1
    while abs(power) < FURTHEST and likely(power + way) > likely(power):
        power += way
    return wandering(SHARE**power)


def with_timing(flight: Flight, timing: CommandTiming) -> Flight:
    """Return a flight whose commands act otherwise between samples."""
    return replace(flight, problem=replace(flight.problem, timing=timing))


def notes_on_commands(flight: Flight) -> list[str]:
    """Return what there is to say of how the commands of a flight act between samples."""
    if not flight.problem.timing.anywhere:
        return []
    return [
        "commands jump between their samples, not at one of them: when is not known, and counts in "
        "intervals. Record on-times, or commands faster"
    ]


def undecided_covariance(found: NormalEquations, flights: Sequence[Flight]) -> tuple[np.ndarray, list[str]]:
    """Return what is added to the covariance (m, m), in scales, as commands may act otherwise, and notes.

    Models of a recording that are as likely before it are, after it, as their likelihoods; what is known of
    parameters is their mixture, here about the likeliest one. Source: Hoeting et al., Statist. Sci. 14
    (1999) 382, eq. (6).
    """
    more, notes = np.zeros_like(found.gram), []
    for k, flight in enumerate(flights):
        doubts, others = [], []
        for timing, share, step in _other_ways(found, flights, k):
            more += share * np.outer(step, step)
            if share * float(step @ found.gram @ step) > NEGLIGIBLE_SHIFT**2:
                others.append(timing)
                doubts.append(f"{timing.words} with a probability of {100 * share:.2g} %")
        if doubts:
            advice = "Record commands at a higher rate"
            if not all(t.hold in VARYING for t in (flight.problem.timing, *others)):
                advice += ', or say which by `inputs = "held"` or `"linear"` in [recording] of the mapping'
            notes.append(
                f"{flight.label}: nothing tells how commands go on between samples: taken as "
                f"{flight.problem.timing.words}, they are {', '.join(doubts)}, which intervals include. "
                f"{advice}"
            )
    return more, notes


def _other_ways(
    found: NormalEquations, flights: Sequence[Flight], k: int
) -> list[tuple[CommandTiming, float, np.ndarray]]:
    """Return the other ways in which the commands of flight number ``k`` may act, all being as likely before:
    how probable each is, and by how much (m,), in scales, it moves the parameters. Of those that differ in
    the side of jumps alone, the likelier one; those that are out by one step of the parameters are left out.
    """
    point, unknowns, now = found.point, found.unknowns, flights[k].problem.timing
    recording = flights[k].problem.recording
    choices = timings(recording)
    asked = choices[1:] and input_channels(flights[k].model, recording)
    first = _over_first_samples(point, unknowns, flights[k], choices, True) if asked else {}
    ways = [t for t in _not_hopeless(first) if _way(t) != _way(now)]
    if not ways:
        return []

    def likelihood(at: Point, own: Sequence[Flight]) -> float:
        return log_likelihood_of(at, own) - 0.5 * float(np.sum(prior_offset(at, unknowns) ** 2))

    def own_walks(timing: CommandTiming) -> list[Flight]:
        return [_with_likely_walks(point, f) for f in _otherwise(flights, k, timing)]

    likely = {_way(now): (likelihood(point, own_walks(now)), now, np.zeros(len(unknowns)))}
    taken = likely[_way(now)][0]
    for timing in ways:
        try:
            own = own_walks(timing)
            near = normal_equations(point, unknowns, own)
            if predicted_gain(near, bounded_step(near)) + near.log_posterior < taken - HOPELESS_LOSS:
                continue
            there = maximise(point, unknowns, _otherwise(flights, k, timing), iterations=STEPS)[0].point
            reached = likelihood(there, own)
        except SmsidError as error:
            LOGGER.info("not %s: %s", timing.words, error)
            continue
        step = np.array([there.value(u) - point.value(u) for u in unknowns]) / found.scales
        LOGGER.info("%s: %.1f, taken as %s: %.1f", timing.words, reached, now.words, taken)
        if _way(timing) not in likely or reached > likely[_way(timing)][0]:
            likely[_way(timing)] = reached, timing, step
    # straight lines and curves are hardly two: together they are as likely before as what is held
    alike = Counter(hold in VARYING for hold, _ in likely)
    shares = softmax([x - np.log(alike[t.hold in VARYING]) for x, t, _ in likely.values()])
    told = zip(likely.values(), shares, strict=True)
    return [(t, float(x), step) for (_, t, step), x in told if t is not now and x > NEGLIGIBLE_SHARE]


def _way(timing: CommandTiming) -> tuple[str, bool]:
    return timing.hold, timing.anywhere


def _otherwise(flights: Sequence[Flight], k: int, timing: CommandTiming) -> list[Flight]:
    return [*flights[:k], with_timing(flights[k], timing), *flights[k + 1 :]]
