"""Steps of a fit: Gauss and Newton's within the parameters' bounds, damped where the likelihood bends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import lsq_linear

from smsid.diagnose.point import Point, Unknown

if TYPE_CHECKING:
    from smsid.diagnose.fit import Fit

FIRST = 0.01  # damping that is tried first where a full step leads up
STEEPER = 4.0  # by which it grows, and its own growth with it
LEAST = 1e-6  # damping below which there is none
ROUNDED = 1e-12  # share of a parameter's squares that is added: what does nothing stays where it is


def bounded_step(found: Fit, damping: float = 0.0) -> np.ndarray:
    """Return the step (m,), in scales, to the lowest point of the quadratic form within the bounds.

    With ``damping``, of the form to which that share of every parameter's squares is added: what the data
    tell least of, which bends soonest, moves least. Source: Marquardt, J. SIAM 11 (1963) 431; bounds as
    quadratic programme: Stark and Parker, Comput. Stat. 10 (1995) 129, by scipy's ``lsq_linear``.
    """
    size = np.sqrt(np.diag(found.gram))
    size = np.where(size > 0.0, size, 1.0)
    gram = found.gram / np.outer(size, size)
    share, basis = np.linalg.eigh(gram)
    share = np.maximum(share, 0.0) + damping + ROUNDED
    root = np.sqrt(share)[:, None] * basis.T
    aim = basis.T @ (found.slope / size) / np.sqrt(share)
    low, high = (bound * size for bound in reach(found.point, found.unknowns))
    step = basis @ (aim / np.sqrt(share))
    if (step < low).any() or (step > high).any():
        step = lsq_linear(root, aim, (low, high), method="bvls").x
    return step / size


def reach(point: Point, unknowns: Sequence[Unknown]) -> tuple[np.ndarray, np.ndarray]:
    """Return how far parameters may go down and up from a point, in scales: (m,) each."""
    ends = np.array([np.array(point.bounds(u)) - point.value(u) for u in unknowns]).reshape(-1, 2)
    ends /= np.array([[u.scale] for u in unknowns])
    still = ends[:, 1] - ends[:, 0] < ROUNDED  # no room at all is none that a solver accepts
    ends[still, 1] = ends[still, 0] + ROUNDED
    return ends[:, 0], ends[:, 1]


def damped_more(damping: float, failed: int) -> float:
    """Return the damping after a step that led up, the ``failed``-th in a row."""
    return max(damping * STEEPER**failed, FIRST)


def damped_less(damping: float, share: float) -> float:
    """Return the damping after a step that gained that share of what the quadratic form promised.

    Source: Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05.
    """
    less = damping * max(1.0 / 3.0, 1.0 - (2.0 * min(share, 1.0) - 1.0) ** 3)
    return less if less > LEAST else 0.0
