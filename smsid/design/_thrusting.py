"""Designs Exp. 1: thrust with the attitude held, arm and wheels locked.

Sequential linear programming on pulses, exact gradients, limits as linear constraints. The cost falls
whenever the thrust grows, so the best thrust lies at the limits. Each round minimises the linearised cost
within them (Frank and Wolfe 1956), then looks along the way there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array, vstack

from smsid.design._forecast import Forecast
from smsid.design._goal import Criterion, Goal, goal_of
from smsid.design._limits import Limits, experiment_use
from smsid.design._minimum_time import Watch
from smsid.design._thrust import ThrustSpace, thrust_space
from smsid.errors import ExperimentError
from smsid.experiments import Experiment, LimitUse, StepProfile, thrust_experiment
from smsid.model.spacecraft import SpacecraftModel

TICK = 0.01  # [s] that intervals are whole multiples of, where the duration allows it
INTERVALS = (40, 72)  # how many there may be
STARTS = 4
DIGITS = 3  # of a thrust in newtons
LOOKS = 5  # random thrusts over which slopes are averaged
IDLE = 0.25  # share of the largest slope below which an axis has little to do with a parameter


@dataclass(frozen=True)
class FoundThrust:
    """A thrust that was found, as an experiment, with what is predicted of it."""

    experiment: Experiment
    goal: Goal
    covariance: np.ndarray
    thrust: np.ndarray


def intervals_of(duration: float) -> int:
    """Return into how many intervals a duration [s] is divided, each a multiple of `TICK` if possible."""
    few, many = INTERVALS
    ticks = duration / TICK
    if abs(ticks - round(ticks)) < 1e-6:
        whole = [n for n in range(many, few - 1, -1) if round(ticks) % n == 0]
        if whole:
            return min(whole, key=lambda n: abs(n - 60))
    return 60


def design_thrust(
    model: SpacecraftModel,
    wanted: Sequence[str],
    criterion: Criterion,
    limits: Limits,
    duration: float,
    rng: np.random.Generator,
    watch: Watch[FoundThrust],
    starts: Sequence[np.ndarray] = (),
    axes: str | None = None,
) -> FoundThrust:
    """Return the best thrust of a duration [s] that the search finds; an interrupt leaves it in the watch.

    ``starts`` are thrusts (intervals, 3) to begin from beside the paper's and random ones; ``axes``: along
    which thrust may act (letters of xyz; by default those that move what is asked for). Raises
    `ExperimentError` when nothing limits the thrust, or nothing asked for answers to it.
    """
    force = largest_thrust(model, limits)
    allowed = tuple("xyz".index(a) for a in axes or "xyz")
    space = thrust_space(Forecast.of(model, duration), allowed, intervals_of(duration), limits, force)
    goal = goal_of(space.forecast.parameters, wanted, criterion, None)
    if axes is None:
        space = space.restrict_axes(_axes(space, goal, rng))
    feasible = Feasible(space)

    def tell(thrust: np.ndarray, _cost: float) -> None:
        whole = np.zeros((space.intervals, 3))
        whole[:, list(space.axes)] = np.round(thrust, DIGITS)
        covariance, _ = space.covariance(whole[:, list(space.axes)])
        made = FoundThrust(thrust_steps(whole, duration), goal, covariance, whole)
        watch.tried(made, goal.cost(covariance), float(goal.relative(covariance).max()))

    begin = [s[:, list(space.axes)] for s in starts if len(s) == space.intervals]
    fresh = STARTS if not begin else 1
    begin += [_bang_bang(space)] + [random_start(space, rng) for _ in range(fresh - 1)]
    for start in begin:
        if np.any(start):
            # the mean first: where one parameter is the worst, the others have no slope
            smooth, _ = best_pulses(space, goal.by("A"), start, feasible, tell)
            if criterion != "A":
                best_pulses(space, goal, smooth, feasible, tell)
    assert watch.best is not None
    return watch.best


def largest_thrust(model: SpacecraftModel, limits: Limits) -> float:
    """Return the most thrust per axis [N] that limits allow; raises `ExperimentError` when none is stated."""
    known = [f for f in (model.description.thrust.max_force, limits.force) if f is not None]
    if not known:
        raise ExperimentError(
            f"'{model.description.name}' states no limit of its thrust.",
            advice="Give `max_force` in [thrust] of the description, or --force.",
        )
    return limits.usable_share * min(known)


def thrust_steps(thrust: np.ndarray, duration: float, name: str = "design") -> Experiment:
    """Return the experiment of a thrust (intervals, 3) [N]."""
    changes = np.concatenate([[True], np.any(np.diff(thrust, axis=0) != 0.0, axis=1)])
    first = np.flatnonzero(changes)
    times = tuple(round(i * duration / len(thrust), 9) for i in first)
    values = tuple(tuple(float(x) + 0.0 for x in thrust[i]) for i in first)
    return Experiment(
        name=name,
        note="designed: thrust, attitude held, joints and wheels locked",
        duration=duration,
        hold_attitude=True,
        lock_joints=True,
        lock_wheels=True,
        force=StepProfile(times=times, values=values),  # type: ignore[arg-type]
    )


def axes_of(thrust: np.ndarray) -> str:
    """Return the axes along which a thrust (intervals, 3) acts, letters of ``xyz``."""
    used = np.abs(thrust).sum(axis=0).tolist()
    return "".join(a for a, size in zip("xyz", used, strict=True) if size) or "x"


def paper_thrust(model: SpacecraftModel, made: FoundThrust, limits: Limits) -> Experiment:
    """Return the paper's thrust (48) on the same axes, of the same duration, as strong as limits allow."""
    axes = axes_of(made.thrust)
    duration = made.experiment.duration
    unit = thrust_experiment(axes, force=1.0, duration=duration)
    share = limit_share(experiment_use(model, unit, limits), limits)
    return thrust_experiment(
        axes, force=round(min(1.0 / share, largest_thrust(model, limits)), 4), duration=duration
    )


def limit_share(uses: Sequence[LimitUse], limits: Limits) -> float:
    """Return the largest share used of a limit that depends on the thrust: joints stand where they stand."""
    return max(limits.share(u) for u in uses if not u.quantity.startswith(("angle of", "swing of")))


def scale_thrust(made: FoundThrust, factor: float) -> FoundThrust:
    """Return the thrust times a factor; its covariance is left as it was."""
    thrust = np.round(made.thrust * factor, DIGITS)
    experiment = thrust_steps(thrust, made.experiment.duration, made.experiment.name)
    return FoundThrust(experiment, made.goal, made.covariance, thrust)


def _bang_bang(space: ThrustSpace) -> np.ndarray:
    out = np.zeros((space.intervals, len(space.axes)))
    third = space.intervals // 6
    out[:third], out[third : 2 * third] = 1.0, -1.0
    return out


def _axes(space: ThrustSpace, goal: Goal, rng: np.random.Generator) -> list[int]:
    """Return which axes have to do with the goal: for any of its parameters, more than a little."""
    shares = np.zeros((len(goal.names), len(space.axes)))
    for _ in range(LOOKS):
        covariance, jacobian = space.covariance(random_start(space, rng))
        for i in range(len(goal.names)):
            _, weight = goal.only(i).cost_and_weight(covariance)
            slope = np.abs(space.cost_gradient(jacobian, weight, covariance)).max(axis=0)
            shares[i] += slope / max(slope.max(), 1e-300) / LOOKS
    used = (shares > IDLE).any(axis=0)
    if not used.any():
        raise ExperimentError(
            f"No thrust shows {', '.join(goal.names)}.", advice="Ask for it with --mode motion."
        )
    return [int(i) for i in np.flatnonzero(used)]


METHOD = "highs-ds"
ROUNDS = 40
ENOUGH = 1e-3  # gain of the cost (relative standard deviation) in a round below which the search ends
CUTS = 8  # rounds of cuts that keep vectors within a ball
SMALLEST = 1e-9  # share of the largest slope below which a pulse is not worth firing
OUTSIDE = 1.005  # how far out of a ball a vector may be before it is cut off; the whole is scaled in the end
FRACTIONS = (1.0, 0.5, 0.25, 0.125, 0.0625)


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
        idle = np.abs(slope).ravel() < SMALLEST * np.abs(slope).max()
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
                    f"No thrust within the limits was found: {answer.message}.", advice="Loosen the limits."
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
    tell: Callable[[np.ndarray, float], None],
) -> tuple[np.ndarray, float]:
    """Return the thrust (intervals, axes) [N] at which the cost is least, locally, and that cost.

    From a ``start`` (intervals, axes) of any size; ``tell`` hears of every improvement.
    """
    at = start * feasible.scale(start)
    cost = goal.cost(space.covariance(at)[0])
    tell(at, cost)
    for _ in range(ROUNDS):
        covariance, jacobian = space.covariance(at)
        _, weight = goal.cost_and_weight(covariance)
        target = feasible.least(space.cost_gradient(jacobian, weight, covariance))
        best, least = at, cost
        for fraction in FRACTIONS:
            tried = at + fraction * (target - at)
            new = goal.cost(space.covariance(tried)[0])
            if new < least:
                best, least = tried, new
                if fraction == 1.0:
                    break
        if not least < cost:
            break
        gain = cost - least
        at, cost = best, least
        tell(at, cost)
        if gain < ENOUGH:
            break
    return at, cost


def random_start(space: ThrustSpace, rng: np.random.Generator) -> np.ndarray:
    """Return a smooth random thrust (intervals, axes): a few sines with random phases."""
    t = (np.arange(space.intervals) + 0.5) / space.intervals
    out = np.zeros((space.intervals, len(space.axes)))
    for a in range(len(space.axes)):
        for _ in range(3):
            cycles = rng.uniform(0.5, min(0.25 * space.intervals, 8.0))
            out[:, a] += rng.normal() * np.sin(2.0 * np.pi * (cycles * t + rng.uniform()))
    return out
