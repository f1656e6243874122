"""The term u_inf of (46) with the panel looked after: no bending or slosh mode may lose its damping to it."""

from __future__ import annotations

import logging

import numpy as np

from smsid.control.gains import Gains
from smsid.control.robust import FlexiblePlant, Pole, least_damping, named_poles
from smsid.control.robust_term import SLOWER, RobustTerm, design_robust_term
from smsid.control.weights import Weights

logger = logging.getLogger(__name__)
KEPT = 0.8
"""Share of its own damping, base free or held, that a mode has to keep."""
RELAXED = (1.5, 2.0, 3.0, 5.0, 10.0)
"""Times the least bound on the error that is asked for when nothing else helps."""


def guarded_term(
    plant: FlexiblePlant, inertia: np.ndarray, gains: Gains, weights: Weights
) -> tuple[RobustTerm, tuple[Pole, ...]]:
    """Return the H-infinity term and the named poles of the loop with slosh and bending inside.

    The slower the loop may cross over, the less noise and the more phase lag it has at the slow modes, and
    the less error is asked for, the more it does: crossovers are given up, slowest first, then the bound on
    the error is relaxed, until every mode keeps `KEPT` of its damping. What is left to be told stands in the
    poles' flags. ``inertia`` (3 + n, 3 + n) is the controller's H_hat [kg m^2].

    Raises `ControlError` as `design_robust_term`.
    """
    own = least_damping(plant)
    slower, relaxed = SLOWER, iter(RELAXED)
    factor: float | None = 1.0
    while True:
        term = design_robust_term(gains, weights, slower=slower, relaxed=factor)
        poles = named_poles(plant, inertia, gains, term.controller)
        lost = [p.name for p in poles if p.value.imag > 0.0 and p.damping < KEPT * own.get(p.name, 0.0)]
        if not lost:
            return term, poles
        if slower:
            chosen = min(b.crossover for b in term.blocks)
            # what was not chosen need not be tried again
            slower = tuple(s for s in slower if s * weights.crossover > chosen * (1.0 + 1e-9))
            logger.info("%s would lose damping: crossovers above %.3g rad/s only", ", ".join(lost), chosen)
            continue
        factor = next(relaxed, None)
        if factor is None:
            return term, poles
        logger.info("%s would lose damping: %.3g times the least bound on the error", ", ".join(lost), factor)
