"""What no diagnosis can do better: the best power, what an experiment cannot tell apart, and how much of a
held-out flight stays unpredicted after the nominal parameters were estimated as well as the flight allows.

All from simulations of the true world, as in `fisher`; nothing of the tool is asked.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.stats import norm

from .catalogue import hidden_effects
from .effect import Hidden
from .fisher import DETECTION, SEPARATION, Experiment, distance_after, experiment, initial_directions
from .flight import fly
from .judge import ALIASES
from .limits import strength_one
from .numbers import moved, nominal
from .plan import draw_effect

Array = np.ndarray
FORWARD = 0.01  # of a nominal sigma, for differences
START = 1e-4  # [m, rad, m/s, rad/s] of the initial state


def power(candidates: int, level: float, strength: float = 1.0) -> float:
    """Chance that a test of one direction finds a strength, at a level corrected for so many candidates."""
    return float(norm.sf(norm.isf(0.5 * level / candidates) - DETECTION * strength))


def held_out(world: str) -> Array:
    """Eigenvalues (k,): the squares that an efficient estimate leaves on the held-out flight, beyond noise,
    are these times independent chi-squared numbers of one degree of freedom; their sum is what to expect.

    The estimate is of the nominal parameters, by the first flight and their priors; the initial states of
    both flights are free.
    """
    first, second = (_information(experiment(world, k)) for k in (0, 1))
    half = np.linalg.cholesky(np.linalg.inv(first + np.eye(len(first))))
    return np.clip(np.linalg.eigvalsh(half.T @ second @ half)[::-1], 0.0, None)


def chance(eigenvalues: Array, most: float, rng: np.random.Generator, draws: int = 4000) -> float:
    """Chance that an efficient estimate leaves at most so many squares on the held-out flight."""
    return float(np.mean(rng.standard_normal((draws, len(eigenvalues))) ** 2 @ eigenvalues <= most))


def _information(exp: Experiment) -> Array:
    """Fisher information (k, k) of the nominal parameters in prior sigmas, the initial state free."""
    n = exp.numbers
    steps = [fly(moved(n, {p.name: FORWARD * p.sigma}), exp.commands) for p in nominal(n)]
    columns = np.column_stack([exp.distance_vector(x) for x in steps]) / FORWARD
    starts = [exp.distance_vector(exp.started(START * d)) / START for d in initial_directions(n)]
    basis = np.linalg.qr(np.column_stack(starts))[0]
    left = columns - basis @ (basis.T @ columns)
    return left.T @ left


def distances(world: str) -> dict[str, Array]:
    """For every effect of the catalogue at strength 1, what is left of its signal [sigma] when another kind,
    place or shape explains what it can: one number for each of these.
    """
    exp, signals, groups = experiment(world), {}, {}
    for effect in hidden_effects(world).values():
        one = strength_one(world, effect.name)
        if effect.kind is not None and effect.rule is None and one is not None:
            size = min(one, effect.cap)
            signals[effect.name] = exp.signal(effect, size) * (one / size) ** effect.power
            groups.setdefault(_shape(effect), []).append(effect.name)
    found = {}
    for effect in (hidden_effects(world)[name] for name in signals):
        others = [names for key, names in groups.items() if key != _shape(effect)]
        found[effect.name] = np.array(
            [distance_after(signals[effect.name], np.array([signals[n] for n in x]).T) for x in others]
        )
    return found


def separable(
    left: Mapping[str, Array], world: str, strength: float, rng: np.random.Generator, draws: int = 2000
) -> float:
    """Share of the effects drawn at a strength that this experiment tells from all others but two.

    ``left`` are the distances of `distances`.
    """
    told = 0
    for _ in range(draws):
        drawn = draw_effect(world, rng, strength)
        told += int(np.sum(left.get(drawn.effect.name, np.inf) * drawn.strength < SEPARATION)) <= ALIASES
    return told / draws


def _shape(effect: Hidden) -> tuple[str | None, str, tuple[str, ...]]:
    return effect.kind, effect.location, effect.shapes
