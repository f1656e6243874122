"""Are the filter's steps short enough for what is estimated? What they cut off would pass for parameters."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from smsid.errors import SmsidError
from smsid.estimation._maximum import maximise
from smsid.estimation._normal_equations import NormalEquations, normal_equations
from smsid.estimation._trust_region import bounded_step
from smsid.estimation.flight import Flight
from smsid.estimation.problem import Problem

LOGGER = logging.getLogger(__name__)
MOST_HALVINGS = 4  # times that steps are halved
NEGLIGIBLE_SHIFT = 0.2  # standard deviations by which halved steps may move all parameters together


def finely_stepped(
    found: NormalEquations, flights: Sequence[Flight], tell: Callable[[str], None] | None = None
) -> tuple[NormalEquations, list[Flight], list[NormalEquations]]:
    """Return a maximum of the likelihood with steps as short as its parameters need, and points on the way.

    Friction that changes its sign, or a wall, acts within less than a step that the rest of the motion needs.
    """
    flights, visited = list(flights), []
    for _ in range(MOST_HALVINGS):
        finer = [replace(f, problem=with_half_the_step(f.problem)) for f in flights]
        try:
            here = normal_equations(found.point, found.unknowns, finer)
            moved = bounded_step(here) - bounded_step(found)
            size = float(np.sqrt(moved @ here.gram @ moved))
            LOGGER.info("steps of half the length: %.2g standard deviations", size)
            if not size > NEGLIGIBLE_SHIFT:
                break
            if tell is not None:
                tell(
                    f"with steps of half the length, which move parameters by {size:.2g} standard deviations"
                )
            better, more = maximise(found.point, found.unknowns, finer, tell=tell)
        except SmsidError as error:
            LOGGER.info("no shorter steps: %s", error)
            break
        found, flights, visited = better, finer, [*visited, *more]
    return found, flights, visited


def with_half_the_step(problem: Problem) -> Problem:
    """Return the problem with half the steps that are taken: an even number of them fills a sample."""
    interval = float(np.median(np.diff(problem.data.times)))
    taken = 2 * np.ceil(interval / problem.substep / 2.0 - 1e-9)
    return replace(problem, substep=0.5 * interval / max(taken, 2))
