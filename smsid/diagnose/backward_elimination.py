"""Causes are left out that others, found later, made unnecessary."""

from __future__ import annotations

import logging
from collections.abc import Collection

import numpy as np
from scipy.stats import chi2

from smsid.diagnose.exchange_step import without_cause
from smsid.diagnose.model_comparison import Cause, DetectionThresholds, strengths, wald
from smsid.errors import SmsidError
from smsid.estimation.map_estimate import Fit, fit

LOGGER = logging.getLogger(__name__)


def eliminate_backward(
    causes: list[Cause],
    last: Fit,
    nominal: Fit,
    levels: DetectionThresholds,
    tried: int,
    proven: Collection[tuple[str, str, str]] = (),
) -> tuple[list[Cause], Fit]:
    """Leave out causes that the others made unnecessary, by Wald's statistic: of all parameters, or of those
    that make it do something.

    One that is far from doing nothing as far as its further parameters are what they are (the gap of a
    backlash, which goes with the torque of its crossing) is left out only where it is not missed. Those
    ``proven``, by key, stay.
    """

    def chance(cause: Cause) -> float:
        own = cause.score.candidate
        whole = float(chi2.sf(wald(last, own), len(own.free)))
        alone = float(chi2.sf(wald(last, own, strength=True), sum(strengths(own))))
        return 0.5 * cause.score.sides * tried * max(whole, alone)

    needed = [c for c in causes if c.score.candidate.key in proven]
    while len(causes) > 1:
        doubted = [c for c in causes if not any(c is n for n in needed) and chance(c) > levels.candidate]
        if not doubted:
            break
        worst = min(doubted, key=lambda c: wald(last, c.score.candidate))
        try:
            less = without_cause(last, worst.score.candidate, nominal)
            rest = fit(less.point, less.unknowns, last.problem, iterations=20)
        except (SmsidError, np.linalg.LinAlgError) as error:  # without a cause the recording is lost
            LOGGER.info("not without %s: %s", worst.score.candidate.key, error)
            needed.append(worst)
            continue
        if _missed(worst, last, rest, levels, tried, max(c.ratio for c in causes)):
            LOGGER.info("%s is missed", worst.score.candidate.key)
            needed.append(worst)
        else:
            causes, last = [c for c in causes if c is not worst], rest
    return causes, last


def _missed(
    cause: Cause, last: Fit, rest: Fit, levels: DetectionThresholds, tried: int, strongest: float
) -> bool:
    """Whether the fit ``rest`` without a cause explains clearly less than ``last``, which has it."""
    own, score = cause.score.candidate, cause.score
    held = float(chi2.sf(wald(last, own, held=True), len(own.free)))
    if 0.5 * score.sides * tried * held > levels.candidate:
        return False  # it ran away
    lost = 2.0 * (rest.objective - last.objective)
    names = {u.name for u in last.unknowns}
    chance = tried * own.grid * float(chi2.sf(lost, len(own.free) + len(names & set(own.also))))
    return lost > levels.beside * strongest and chance <= levels.candidate
