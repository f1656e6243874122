"""The maximum of the posterior of several recordings: Gauss-Newton steps within a trust region."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from smsid.estimation._differences import difference_equations
from smsid.estimation._normal_equations import NormalEquations, normal_equations
from smsid.estimation._trust_region import bounded_step, descend, predicted_gain
from smsid.estimation.flight import Flight
from smsid.estimation.parameter_vector import Point, Unknown

LOGGER = logging.getLogger(__name__)
ENOUGH_GAIN = 0.05  # predicted gain of the log-posterior below which a search has ended
MOST_TRIES = 8  # steps that are tried from one point, each shorter than the last
MOST_ITERATIONS = 40
MOST_ROUNDS = 15  # steps by differences of whole runs, each as long as a run of the filter a parameter
LITTLE_GAIN = 0.2  # predicted gain of a last step by differences that asks for none anew
GAIN_TOLERANCE = 0.25  # share by which what it gains may differ from that
STALLED_SHARE = 0.02  # share of the predicted gain below which two steps in a row were the last

Tell = Callable[[str], None]


def maximise(
    point: Point,
    unknowns: Sequence[Unknown],
    flights: Sequence[Flight],
    *,
    enough: float = ENOUGH_GAIN,
    iterations: int = MOST_ITERATIONS,
    tell: Tell | None = None,
) -> tuple[NormalEquations, list[NormalEquations]]:
    """Return the normal equations at the maximum of the posterior, and those of every point on the way.

    Steps are those of Gauss and Newton within the parameters' bounds, shortened (Levenberg-Marquardt, with
    the length in hand) until the objective falls and every body can exist. ``tell`` hears a line each step.
    Raises `SimulationError` when the start cannot be filtered.
    """
    found = normal_equations(point, unknowns, flights)
    return _climb(found, flights, enough, iterations, tell, lambda better: better)


def equations_at_maximum(
    found: NormalEquations, flights: Sequence[Flight], *, tell: Tell | None = None
) -> NormalEquations:
    """Return the normal equations at the maximum near a point where `maximise` came to a halt.

    Steps are of slopes by differences of whole runs (`smsid.estimation._differences`), and so are the normal
    equations returned: at rest if `has_converged`. Raises `SimulationError` where a filter loses its
    recording.
    """
    exact = difference_equations(found, flights)

    def at(better: NormalEquations) -> NormalEquations:
        nonlocal exact
        exact = _one_step_on(exact, better) or difference_equations(better, flights)
        return exact

    return _climb(exact, flights, ENOUGH_GAIN, MOST_ROUNDS, tell, at)[0]


def _one_step_on(exact: NormalEquations, better: NormalEquations) -> NormalEquations | None:
    """Return normal equations by differences a step on, as their quadratic form has them; ``None`` where the
    step was not little, or gained otherwise than the form promised.
    """
    moved = np.array([better.point.value(u) - exact.point.value(u) for u in exact.unknowns])
    step = moved / exact.scales
    promised, gained = predicted_gain(exact, step), exact.objective - better.objective
    if not (0.0 < promised < LITTLE_GAIN and abs(gained - promised) < GAIN_TOLERANCE * promised):
        return None
    terms = tuple(
        replace(t, gram=e.gram, slope=e.slope - e.gram @ step, scatter=e.scatter)
        for t, e in zip(better.terms, exact.terms, strict=True)
    )
    return replace(better, terms=terms, gram=exact.gram, slope=exact.slope - exact.gram @ step, exact=True)


def _climb(
    found: NormalEquations,
    flights: Sequence[Flight],
    enough: float,
    iterations: int,
    tell: Tell | None,
    at: Callable[[NormalEquations], NormalEquations],
) -> tuple[NormalEquations, list[NormalEquations]]:
    """Return the last and all normal equations on the way up, as ``at`` makes them of those along states."""
    visited, stalled, radius = [found], 0, np.inf
    for i in range(iterations):
        gain = predicted_gain(found, bounded_step(found))
        if gain < enough:
            break
        better, radius = _descend(found, flights, radius)
        if better is None:
            break
        gained = found.objective - better.objective
        how = " by differences" if found.exact else ""
        line = f"step {i + 1}{how}: log-posterior {-better.objective:.1f} (+{gained:.3g})"
        LOGGER.info("%s, predicted %.3g", line, gain)
        if tell is not None:
            tell(line)
        stalled = stalled + 1 if gained < STALLED_SHARE * gain else 0
        found = at(better)
        visited.append(found)
        if stalled == 2:
            break
    return found, visited


def has_converged(found: NormalEquations) -> bool:
    """Whether no step is left that would gain anything that matters."""
    return predicted_gain(found, bounded_step(found)) < 20.0 * ENOUGH_GAIN


def _descend(
    found: NormalEquations, flights: Sequence[Flight], radius: float
) -> tuple[NormalEquations | None, float]:
    def look(point: Point) -> tuple[float, Callable[[], NormalEquations]]:
        # that a step leads up is rare: its derivatives are taken with it, not in a second run
        trial = normal_equations(point, found.unknowns, flights)
        return trial.objective, lambda: trial

    return descend(found, radius, MOST_TRIES, look, lengthen=found.exact)
