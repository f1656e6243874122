"""Robust stability over what an estimate leaves open: mu from both sides, worst parameters, samples.

Sources: `smsid.control._mu` for the upper bound (Fan, Tits and Doyle 1991); the lower one is a plant that was
found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from smsid._statistics import NORMAL95
from smsid.control._mu import mu_upper_bound
from smsid.control._statespace import StateSpace
from smsid.control._uncertain_plant import UncertainPlant
from smsid.control.gains import Gains
from smsid.errors import ControlError

BACKGROUND = np.logspace(-3.0, 2.0, 16)  # [rad/s], beside the loop's own frequencies
LARGEST_SCALE = 100.0  # of the intervals, in the search for a plant that is not stable
ROUNDS, STARTS = 8, 3  # of the search for the worst parameters


@dataclass(frozen=True)
class Robustness:
    """What is known of the loop's stability over the identified intervals.

    ``mu_upper`` at ``frequency`` [rad/s]: below one, every plant within the intervals is stable (on the
    frequencies examined). ``mu_lower``: a plant at 1 / mu_lower of the intervals is not, 0 where none was
    found. ``damping`` is the least damping ratio that the worst parameters found within the intervals leave,
    ``worst`` those parameters, +-1 at the ends of their intervals. ``unstable`` of ``samples`` plants drawn
    from the estimate are not stable; ``sampled_damping`` is the least damping ratio among them.
    """

    mu_upper: float
    frequency: float
    mu_lower: float
    damping: float
    worst: dict[str, float]
    samples: int
    unstable: int
    sampled_damping: float

    @property
    def stable(self) -> bool:
        """Whether nothing speaks against robust stability: mu below one, no sample unstable."""
        return self.mu_upper < 1.0 and self.unstable == 0


def robust_stability(
    plant: UncertainPlant,
    inertia: np.ndarray,
    gains: Gains,
    controller: StateSpace | None = None,
    *,
    level: float,
    rng: np.random.Generator,
    samples: int = 1000,
) -> Robustness:
    """Examine the loop over the plant's intervals.

    Args:
        plant: slosh and bending inside, see `uncertain_plant`.
        inertia: (3 + n, 3 + n) the controller's H_hat [kg m^2].
        gains: its gains; ``controller`` its H-infinity term, if any.
        level: how far the bodies' inertia may be off in its own norm, see `identified_level`.
        rng: draws the samples and where the search for the worst parameters starts.
        samples: number of plants; drawn Gaussian with the estimate's standard deviations, dampings uniformly
            from their intervals, which end at zero.

    Raises:
        ControlError: the loop is not stable even at the centre of the intervals, or sizes do not fit.
    """
    loop, blocks, _ = plant.fractional(inertia, gains, controller, level=level)
    if not loop.stable:
        raise ControlError(
            "The loop is not stable even at the identified values.",
            advice="Lower the gains or the crossover; see the named poles.",
            poles=loop.poles,
        )
    own = np.abs(loop.poles[loop.poles.imag > 0.0])
    upper, frequency, scalings = 0.0, 0.0, None
    for omega in np.unique(np.concatenate([own, BACKGROUND])):
        bound, scalings = mu_upper_bound(loop.response(np.array([omega]))[0], blocks, scalings)
        if bound > upper:
            upper, frequency = bound, float(omega)

    def damping_at(scale: float) -> tuple[float, np.ndarray]:
        return worst_parameters(plant, inertia, gains, controller, level=level, scale=scale, rng=rng)

    damping, worst = damping_at(1.0)
    closed = partial(plant.closed_loop, inertia=inertia, gains=gains, controller=controller)
    drawn = [_least_damping(closed, d) for d in _samples(plant, rng, samples)]
    return Robustness(
        upper,
        frequency,
        _lower_bound(damping_at, damping),
        damping,
        {c.name: float(d) for c, d in zip(plant.changes, worst, strict=True)},
        samples,
        int(np.sum(np.array(drawn) <= 0.0)),
        float(min(drawn, default=np.nan)),
    )


def worst_parameters(
    plant: UncertainPlant,
    inertia: np.ndarray,
    gains: Gains,
    controller: StateSpace | None = None,
    *,
    level: float,
    scale: float,
    rng: np.random.Generator,
) -> tuple[float, np.ndarray]:
    """Return the least damping ratio found within ``scale`` times the intervals, and where (changes,).

    ``inertia`` (3 + n, 3 + n) is the controller's H_hat [kg m^2].

    Scalars go to the end of their intervals that the derivative of the damping points to, the bodies' inertia
    along it as far as ``level`` and the intervals allow; repeated, from the centre and from random ends. A
    lower bound of the harm, not a guarantee.
    """
    rigid = np.array([c.rigid for c in plant.changes], dtype=bool)
    closed = partial(plant.closed_loop, inertia=inertia, gains=gains, controller=controller)

    def to_the_end(direction: np.ndarray) -> np.ndarray:
        delta = np.where(rigid, 0.0, scale * np.sign(direction))
        bodies = np.where(rigid, direction, 0.0)
        size = plant.rigid_size(bodies)
        if size > 0.0:
            bodies = np.clip(bodies * (scale * level / size), -scale, scale)
        return delta + bodies

    best, at = np.inf, np.zeros(len(plant.changes))
    for start in range(STARTS):
        delta = np.zeros(len(rigid)) if start == 0 else to_the_end(rng.standard_normal(len(rigid)))
        now = _least_damping(closed, delta)
        for _ in range(ROUNDS):
            if now < best:
                best, at = now, delta
            if not np.isfinite(now):
                break
            moved = to_the_end(-_slope(closed, delta))
            new = _least_damping(closed, moved)
            if new >= now - 1e-12:
                break
            delta, now = moved, new
        if now < best:
            best, at = now, delta
    return float(best), at


def _lower_bound(damping_at: Callable[[float], tuple[float, np.ndarray]], first: float) -> float:
    """Return 1 / the smallest scale of the intervals at which an unstable plant was found, to 1 %."""
    low, high = (0.0, 1.0) if first <= 0.0 else (1.0, 1.5)
    while high > 1.0 and damping_at(high)[0] > 0.0:
        low, high = high, 1.5 * high
        if high > LARGEST_SCALE:
            return 0.0
    while high - low > 0.01 * high:
        middle = 0.5 * (low + high)
        if damping_at(middle)[0] > 0.0:
            low = middle
        else:
            high = middle
    return 1.0 / high


def _samples(plant: UncertainPlant, rng: np.random.Generator, count: int) -> list[np.ndarray]:
    """Return parameters (changes,) drawn Gaussian; dampings, which cannot be negative, uniformly."""
    bounded = np.array([".damping" in c.name for c in plant.changes], dtype=bool)
    found = []
    for _ in range(count):
        delta = rng.standard_normal(len(bounded)) / NORMAL95
        found.append(np.where(bounded, rng.uniform(-1.0, 1.0, len(bounded)), delta))
    return found


def _least_damping(closed: Callable[[np.ndarray], np.ndarray], delta: np.ndarray) -> float:
    """Return the least damping ratio of the loop's poles, negative for an unstable one; inf for no plant."""
    try:
        poles = np.linalg.eigvals(closed(delta))
    except ControlError:
        return np.inf
    return float((-poles.real / np.maximum(np.abs(poles), 1e-300)).min())


def _slope(closed: Callable[[np.ndarray], np.ndarray], delta: np.ndarray) -> np.ndarray:
    """Return the derivative (changes,) of the least damping ratio, from its pole's left and right vectors."""
    a = closed(delta)
    values, right = np.linalg.eig(a)
    k = int(np.argmin(-values.real / np.maximum(np.abs(values), 1e-300)))
    pole, x = values[k], right[:, k]
    values_left, left = np.linalg.eig(a.T)
    y = left[:, int(np.argmin(np.abs(values_left - pole)))]
    y = y / (y @ x)
    out = np.zeros(len(delta))
    for i in range(len(delta)):
        step = np.zeros(len(delta))
        step[i] = 1e-4
        change = (closed(delta + step) - a) / 1e-4
        moved = complex(y @ change @ x)
        size = abs(pole)
        out[i] = -moved.real / size + pole.real * (pole.conjugate() * moved).real / size**3
    return out
