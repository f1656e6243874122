"""Commands that act otherwise between samples, as rivals of every clock that is off and every delay.

What is held, taken for straight lines, acts half a period early. So a sensor or an actuator seems to be late,
and beside that, straight lines go on to look right.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from smsid.diagnose._without_cause import without_cause
from smsid.diagnose.stepwise import Search
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SmsidError
from smsid.estimation.innovations import normalised_rmse
from smsid.estimation.input_timing import CLEAR_GAIN, timings
from smsid.estimation.joint_problem import with_likely_timing
from smsid.estimation.map_estimate import MapFit, fit
from smsid.estimation.problem import CommandTiming, Problem, recordings_of

LOGGER = logging.getLogger(__name__)
STEPS = 2  # of a fit with commands in another way


def as_inputs_act(found: Search) -> Problem:
    """Return the problem of the last fit with commands as they act by what is known now.

    Without a time offset, what is likeliest at the last fit counts, see `with_likely_timing`. One is believed
    only where the model without it, fitted again, explains clearly less with commands of every other way:
    what tells two causes apart, and what the offset costs in Bayes's criterion. It may have another size
    beside another way. Where something is left, parameters may have bent to the way they were fitted with:
    others are judged some steps on.
    """
    last, apart = found.last, found.levels.alias
    causes = (c.score.candidate for c in found.causes)
    late = [c for c in causes if c.effect is not None and c.effect.shifts_time]
    if not late:
        likely = with_likely_timing(last.point, last.problem)
        return likely if normalised_rmse(last.run) < THRESHOLDS.noise_left else _refitted(last, likely)
    paid = apart + sum(len(c.free) for c in late) * float(np.log(found.samples))
    chosen, best = last.problem, 2.0 * last.objective + paid
    for choice in dict.fromkeys(t for p in recordings_of(last.problem) for t in timings(p.recording)):
        other = _with_hold(last.problem, choice)
        for gone, price in ((late, 0.0), ([], paid + apart)):
            try:
                less = last
                for candidate in gone:
                    less = without_cause(less, candidate, found.nominal)
                reached = 2.0 * fit(less.point, less.unknowns, other, iterations=8).objective + price
            except (SmsidError, np.linalg.LinAlgError) as error:
                LOGGER.info("not %s: %s", choice, error)
                continue
            LOGGER.info("%s without %s: %.1f more", choice, [c.key for c in gone], best - reached)
            if reached < best:
                chosen, best = other, reached
    return chosen


def _refitted(last: MapFit, likely: Problem) -> Problem:
    """Return the problem of a fit with commands in the way that explains most some steps on: ``likely``, the
    one that does so as it stands, unless another is clearly better.
    """
    choices = dict.fromkeys(t for p in recordings_of(last.problem) for t in timings(p.recording))
    ways = [likely, *(_with_hold(last.problem, t) for t in choices)]
    if len(ways) < 3:  # the one there is
        return likely
    reached = np.full(len(ways), np.inf)
    for k, other in enumerate(ways):
        try:
            reached[k] = fit(last.point, last.unknowns, other, iterations=STEPS).objective
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("not %s: %s", other.timing, error)
    LOGGER.info("refitted: %s", ", ".join(f"{p.timing}: {x:.1f}" for p, x in zip(ways, reached, strict=True)))
    best = int(np.argmin(reached))
    # what is left is no noise: gains are as many times larger as it is
    return ways[best] if reached[0] - reached[best] > CLEAR_GAIN * normalised_rmse(last.run) ** 2 else likely


def _with_hold(problem: Problem, choice: CommandTiming) -> Problem:
    """Return a problem whose commands act in one way in every recording that may be of it."""
    own = [choice if choice in timings(p.recording) else p.timing for p in recordings_of(problem)]
    parts = tuple(replace(p, timing=t) for p, t in zip(problem.parts, own, strict=False))
    return replace(problem, timing=own[0], parts=parts)
