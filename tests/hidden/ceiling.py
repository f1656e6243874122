"""What the experiments allow: how often a likelihood that knows the motion recognises what is hidden, and how
much of a held-out flight stays unpredicted after the nominal parameters were estimated as well as may be.

All from simulations of the true world, as in `fisher`; nothing of the tool is asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from .catalogue import hidden_effects
from .effect import Hidden
from .fisher import FLAT, Experiment, experiment
from .judge import ALIASES, Injected
from .limits import strength_one

Array = np.ndarray
PRICES = (0.0, 1.0, 2.0, 4.0, 10.0)  # of a parameter, in squares; the one that serves best counts


@dataclass(frozen=True)
class Signals:
    """Inner products (n, n) of what the catalogue's effects of strength 1 change, in sigmas of the noise, and
    the groups of effects that have kind, place and shape in common.
    """

    effects: tuple[Hidden, ...]
    gram: Array

    @property
    def groups(self) -> list[list[int]]:
        """Places of the effects of each kind, place and shape."""
        found: dict[tuple[str | None, str, tuple[str, ...]], list[int]] = {}
        for i, e in enumerate(self.effects):
            found.setdefault((e.kind, e.location, e.shapes), []).append(i)
        return list(found.values())


def signals(world: str) -> Signals:
    """Return the signals of a world's catalogue; effects that are counted and not measured are left out."""
    exp, effects, columns = experiment(world), [], []
    for effect in hidden_effects(world).values():
        one = strength_one(world, effect.name)
        if effect.kind is not None and effect.rule is None and one is not None:
            size = min(one, effect.cap)
            effects.append(effect)
            columns.append(exp.signal(effect, size) * (one / size) ** effect.power)
    whole = np.column_stack(columns)
    return Signals(tuple(effects), whole.T @ whole)


def recognised(
    known: Signals, drawn: Sequence[Injected], candidates: int, level: float, rng: np.random.Generator
) -> float:
    """Share of drawn effects that are found at a level, corrected for so many candidates, and are among the
    three groups that explain most. One draw of the noise each; what is counted is always recognised.
    """
    groups, names = known.groups, [e.name for e in known.effects]
    values, vectors = np.linalg.eigh(known.gram)
    root = vectors * np.sqrt(np.clip(values, 0.0, None))
    hits = np.zeros(len(PRICES))
    for injected in drawn:
        if injected.effect.name not in names:
            hits += 1.0
            continue
        i = names.index(injected.effect.name)
        size = np.sign(injected.value) * injected.strength
        slopes = size * known.gram[:, i] + root @ rng.standard_normal(len(values))
        explained = np.array([_explained(known, g, slopes) for g in groups])
        width = np.array([len(g) for g in groups])
        sides = np.array([1 if len(g) == 1 and not known.effects[g[0]].signed else 2 for g in groups])
        if (0.5 * sides * chi2.sf(explained, width)).min() * candidates > level:
            continue
        own = np.array([same(injected.effect, known.effects[g[0]]) for g in groups])
        for k, price in enumerate(PRICES):
            worth = explained - price * width
            hits[k] += int((worth[~own] > worth[own].max()).sum()) <= ALIASES
    return float(hits.max() / len(drawn))


def same(first: Hidden, second: Hidden) -> bool:
    """Whether naming one is naming the other: kind (or one that says the same), place and shape."""
    kinds = bool({first.kind, *first.others} & {second.kind, *second.others})
    places = bool({first.location, *first.also} & {second.location, *second.also})
    shapes = not first.shapes or not second.shapes or bool({*first.shapes} & {*second.shapes})
    return kinds and places and shapes


def _explained(known: Signals, group: list[int], slopes: Array) -> float:
    """Squares that effects explain together; a single one that has a sign explains none against it."""
    if len(group) == 1 and not known.effects[group[0]].signed and slopes[group[0]] < 0.0:
        return 0.0
    part = known.gram[np.ix_(group, group)]
    return float(slopes[group] @ np.linalg.pinv(part, rcond=1e-9, hermitian=True) @ slopes[group])


def held_out(world: str) -> Array:
    """Eigenvalues (k,) of what an efficient estimate of the nominal parameters, by the first flight and their
    priors, leaves unknown, in the information of the held-out flight; the initial states of both are free.

    Their sum is the excess of squares to expect there.
    """
    first, second = (_information(experiment(world, k)) for k in (0, 1))
    half = np.linalg.cholesky(np.linalg.inv(first + np.eye(len(first))))
    return np.clip(np.linalg.eigvalsh(half.T @ second @ half)[::-1], 0.0, None)


def chance(eigenvalues: Array, most: float, rng: np.random.Generator, draws: int = 4000) -> float:
    """Chance that an efficient estimate's squares on the held-out flight are at most so many more than those
    of the true numbers, on the same noise.
    """
    errors = rng.standard_normal((draws, len(eigenvalues))) * np.sqrt(eigenvalues)
    noise = rng.standard_normal((draws, len(eigenvalues)))
    return float(np.mean((errors**2 + 2.0 * errors * noise).sum(axis=1) <= most))


def open_loop(world: str, rng: np.random.Generator, *, settle: float, draws: int = 400) -> Array:
    """Errors (draws,) of a simulation of the held-out flight with an efficient estimate of the nominal
    parameters, over those with the true numbers; each starts from the state that its first ``settle`` seconds
    show it. A channel counts by its mean square in its noise.
    """
    information, exp = _information(experiment(world, 0)), experiment(world, 1)
    half = np.linalg.cholesky(np.linalg.inv(information + np.eye(len(information))))
    columns, sigma = exp.nuisances()
    nominal, starts = columns[:, sigma < FLAT], columns[:, sigma == FLAT]
    early, weight = _rows(exp, settle)
    found = np.linalg.pinv(starts[early])
    off = nominal[~early] - starts[~early] @ (found @ nominal[early])
    drift, scale = starts[~early], np.sqrt(weight[~early])
    ratios = np.zeros(draws)
    for k in range(draws):
        seen = rng.standard_normal(len(early))
        true = seen[~early] - drift @ (found @ seen[early])
        estimated = true + off @ (half @ rng.standard_normal(len(half)))
        ratios[k] = np.linalg.norm(scale * estimated) / np.linalg.norm(scale * true)
    return ratios


def _rows(exp: Experiment, settle: float) -> tuple[np.ndarray, Array]:
    """Which whitened values (rows,) are of the first seconds, and the weights of the later ones: one over how
    many its channel has.
    """
    early, weight = [], []
    later = exp.commands.time > settle
    for name, x in exp.nominal.items():
        width = 3 if name == "pose.attitude" else x[0].size  # a rotation vector
        early.append(np.repeat(~later, width))
        weight.append(np.full(len(later) * width, 1.0 / (later.sum() * width)))
    return np.concatenate(early), np.concatenate(weight)


def _information(exp: Experiment) -> Array:
    """Fisher information (k, k) of the nominal parameters in prior sigmas, the initial state free."""
    columns, sigma = exp.nuisances()
    nominal, starts = columns[:, sigma < FLAT], columns[:, sigma == FLAT]
    basis = np.linalg.qr(starts)[0]
    left = nominal - basis @ (basis.T @ nominal)
    return left.T @ left
