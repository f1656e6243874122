"""What a run of the study is: everything drawn from its seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .catalogue import hidden_effects
from .effect import Hidden
from .judge import Injected
from .limits import strength_one

CATEGORIES = ("nothing", "wrong_noise", "single", "onset", "outside", "pair")
SHARES = (0.3, 0.1, 0.4, 0.05, 0.08, 0.07)
WORLD_SHARES = {"sms": 0.4, "panel": 0.15, "rigid": 0.2, "arm": 0.25}
WRONG_NOISE = (0.7, 1.3)
OUTSIDE_STRENGTH = 10.0
ONSET_STRENGTHS = (10.0, 30.0)
PAIR_STRENGTHS = (5.0, 20.0)
LEAST = 0.7  # share of a wanted strength below which an effect is drawn again, as its cap forbids it


@dataclass(frozen=True)
class Run:
    """One run: its seed, world, what it hides, and true noise over stated noise."""

    seed: int
    category: str
    world: str
    hidden: tuple[Injected, ...]
    noise_factor: float = 1.0

    @property
    def key(self) -> str:
        """Name of the run: it changes with what is drawn."""
        parts = [f"{i.effect.name}={i.value:.4g}" for i in self.hidden]
        return ";".join([str(self.seed), self.category, self.world, *parts])


def draw_run(seed: int, *, strengths: tuple[float, ...] = (1.0, 3.0, 10.0, 100.0)) -> Run:
    """Draw a run from a seed."""
    rng = np.random.default_rng([seed, 77])
    category = str(rng.choice(CATEGORIES, p=SHARES))
    world = str(rng.choice(list(WORLD_SHARES), p=list(WORLD_SHARES.values())))
    if category == "nothing":
        return Run(seed, category, world, ())
    if category == "wrong_noise":
        return Run(seed, category, world, (), float(rng.choice(WRONG_NOISE)))
    if category == "outside":
        return Run(seed, category, world, (draw_effect(world, rng, OUTSIDE_STRENGTH, outside=True),))
    if category == "pair":
        first = draw_effect(world, rng, float(rng.choice(PAIR_STRENGTHS)))
        while True:
            second = draw_effect(world, rng, float(rng.choice(PAIR_STRENGTHS)))
            apart = first.effect.family != second.effect.family
            if apart and first.effect.location != second.effect.location:
                return Run(seed, category, world, (first, second))
    if category == "onset":
        strength = float(rng.choice(ONSET_STRENGTHS))
        begin = float(rng.uniform(20.0, 50.0))
        return Run(seed, category, world, (draw_effect(world, rng, strength, onset=begin),))
    return Run(seed, category, world, (draw_effect(world, rng, float(rng.choice(strengths))),))


def draw_effect(
    world: str,
    rng: np.random.Generator,
    strength: float,
    *,
    outside: bool = False,
    onset: float | None = None,
) -> Injected:
    """Draw an effect: family, then kind, then parameter, then place, each with equal chance."""
    allowed = []
    for effect in hidden_effects(world).values():
        one = strength_one(world, effect.name)
        wanted = None if one is None else one * strength ** (1.0 / effect.power)
        fits = wanted is not None and min(wanted, effect.cap) >= LEAST * wanted
        if fits and (effect.kind is None) == outside and (onset is None or effect.onset):
            allowed.append(effect)
    chosen = allowed
    for level in (lambda e: e.family[0], lambda e: e.kind or e.label, lambda e: e.label or e.parameter):
        groups = sorted({level(e) for e in chosen})
        pick = groups[int(rng.integers(len(groups)))]
        chosen = [e for e in chosen if level(e) == pick]
    effect = chosen[int(rng.integers(len(chosen)))]
    return inject(world, effect, strength, rng, onset)


def inject(
    world: str, effect: Hidden, strength: float, rng: np.random.Generator, onset: float | None = None
) -> Injected:
    """Hide an effect at a strength; the sign is drawn where both make sense.

    What grows with the square of its value (an orbit's rate) is as strong as its square.
    """
    one = strength_one(world, effect.name)
    assert one is not None, effect.name
    size = min(one * strength ** (1.0 / effect.power), effect.cap)
    sign = -1.0 if effect.signed and rng.uniform() < 0.5 else 1.0
    return Injected(effect, sign * size, (size / one) ** effect.power, onset)
