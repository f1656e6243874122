"""The best thrust: sequential linear programming on pulses, exact gradients, limits as linear constraints.

The cost falls whenever the thrust grows, so the best thrust lies at the limits. Each round minimises the
linearised cost within them (Frank and Wolfe 1956), then looks along the way there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array, vstack

from smsid.design.goal import Goal
from smsid.design.thrust import ThrustSpace
from smsid.errors import ExperimentError

METHOD = "highs-ds"
ROUNDS = 40
ENOUGH = 1e-3  # gain of the cost (relative standard deviation) in a round below which the search ends
CUTS = 8  # rounds of cuts that keep vectors within a ball
IDLE = 1e-9  # share of the largest slope below which a pulse is not worth firing
OUTSIDE = 1.005  # how far out of a ball a vector may be before it is cut off; the whole is scaled in the end
FRACTIONS = (1.0, 0.5, 0.25, 0.125, 0.0625)


@dataclass(frozen=True)
class Pulses:
    """A thrust (intervals, axes) [N] with the cost of its goal."""

    thrust: np.ndarray
    cost: float


class Feasible:
    """The thrusts within all limits: a box, and balls that hold vectors linear in the thrust, by cuts."""

    def __init__(self, space: ThrustSpace) -> None:
        self.space = space
        self.maps = [space.matrix(b) for b in space.bounds]
        self.limits = [b.limit for b in space.bounds]
        size = space.intervals * len(space.axes)
        self.rows = csr_array((0, size))
        self.right = np.zeros(0)
        for a, limit in zip(self.maps, self.limits, strict=True):
            active = np.flatnonzero(a.any(axis=(0, 2, 3)))
            for component in active:
                flat = a[:: max(1, space.stride // 2), component].reshape(-1, size)
                self._add(np.vstack([flat, -flat]), np.full(2 * len(flat), limit))

    def _add(self, rows: np.ndarray, right: np.ndarray) -> None:
        used = rows.any(axis=1)
        self.rows = csr_array(vstack([self.rows, csr_array(rows[used])]))
        self.right = np.concatenate([self.right, right[used]])

    def scale(self, thrust: np.ndarray) -> float:
        """Return the largest factor by which a thrust (intervals, axes) may be multiplied."""
        worst = float(np.abs(thrust).max()) / self.space.force
        for a, limit in zip(self.maps, self.limits, strict=True):
            worst = max(
                worst, float(np.linalg.norm(np.einsum("tcua,ua->tc", a, thrust), axis=1).max()) / limit
            )
        return 1.0 / worst if worst > 0.0 else np.inf

    def least(self, slope: np.ndarray) -> np.ndarray:
        """Return the thrust (intervals, axes) within the limits at which a linear function is least.

        Raises `ExperimentError` when there is none.
        """
        size = slope.size
        idle = np.abs(slope).ravel() < IDLE * np.abs(slope).max()
        reach = np.where(idle, 0.0, self.space.force)
        found = np.zeros_like(slope)
        rows, right = self.rows, self.right
        for _ in range(CUTS):
            answer = linprog(
                slope.ravel() / np.abs(slope).max(),
                A_ub=rows,
                b_ub=right,
                bounds=np.column_stack([-reach, reach]),
                method=METHOD,
            )
            if answer.x is None:
                raise ExperimentError(
                    f"No thrust within the limits was found: {answer.message}.",
                    advice="Loosen the limits.",
                )
            found = answer.x.reshape(slope.shape)
            cut, limits = self._cuts(found, size)
            if not len(cut):
                break
            rows, right = csr_array(vstack([rows, csr_array(cut)])), np.concatenate([right, limits])
        return found * min(1.0, self.scale(found))

    def _cuts(self, thrust: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
        """Return half-spaces (rows, size), (rows,) that cut off a thrust where vectors leave their balls.

        One for every peak in time.
        """
        rows, right = [np.zeros((0, size))], [np.zeros(0)]
        for a, limit in zip(self.maps, self.limits, strict=True):
            y = np.einsum("tcua,ua->tc", a, thrust)
            length = np.linalg.norm(y, axis=1)
            around = np.pad(length, 1)
            peak = (length >= around[:-2]) & (length >= around[2:])
            out = np.flatnonzero(peak & (length > limit * OUTSIDE))
            if len(out):
                direction = y[out] / length[out, None]
                rows.append(np.einsum("tc,tcua->tua", direction, a[out]).reshape(len(out), size))
                right.append(np.full(len(out), limit))
        return np.concatenate(rows), np.concatenate(right)


def best_pulses(
    space: ThrustSpace,
    goal: Goal,
    start: np.ndarray,
    feasible: Feasible,
    tell: Callable[[Pulses], None] = lambda _: None,
) -> Pulses:
    """Return the thrust at which the cost is least, locally, from a start (intervals, axes) of any size.

    ``tell`` hears of every improvement.
    """
    at = start * feasible.scale(start)
    now = Pulses(at, goal.cost(space.covariance(at)[0]))
    tell(now)
    for _ in range(ROUNDS):
        covariance, jacobian = space.covariance(now.thrust)
        _, weight = goal.cost_and_weight(covariance)
        target = feasible.least(space.pulled(jacobian, weight, covariance))
        better = None
        for fraction in FRACTIONS:
            tried = now.thrust + fraction * (target - now.thrust)
            cost = goal.cost(space.covariance(tried)[0])
            if cost < now.cost and (better is None or cost < better.cost):
                better = Pulses(tried, cost)
                if fraction == 1.0:
                    break
        if better is None:
            break
        gain = now.cost - better.cost
        now = better
        tell(now)
        if gain < ENOUGH:
            break
    return now


def random_start(space: ThrustSpace, rng: np.random.Generator) -> np.ndarray:
    """Return a smooth random thrust (intervals, axes): a few sines with random phases."""
    t = (np.arange(space.intervals) + 0.5) / space.intervals
    out = np.zeros((space.intervals, len(space.axes)))
    for a in range(len(space.axes)):
        for _ in range(3):
            cycles = rng.uniform(0.5, min(0.25 * space.intervals, 8.0))
            out[:, a] += rng.normal() * np.sin(2.0 * np.pi * (cycles * t + rng.uniform()))
    return out
