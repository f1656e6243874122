"""A hidden effect: what it is called, where it sits, and what it does to a world at a strength."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .plant import Change

Make = Callable[[float, float | None, np.random.Generator], Change]


@dataclass(frozen=True)
class Hidden:
    """An effect a world may hide.

    kind: its name in the catalogue under test, None when it is outside. others: kinds that say the same.
    shapes: names of the shape that are right, empty for any. also: other locations that mean the same.
    family: levels in which it may be named; for one outside the catalogue all families that touch its
    equation. location: joint, body, sensor, tank or appendage. parameter: which of the kind's parameters is
    hidden, in `unit`; its value goes into `make(value, onset [s], rng)`. guess: where the search for the
    limit starts. power: how the signal grows with the value. cap: the largest value worth simulating.
    signed: both signs make sense. onset: it may begin midway. rule: "distance" when the limit follows from
    the distance between channels with and without it, else the limit itself [unit]. beside: what else one
    that names its kind, place and shape may mean (the other axes of a vector), as `make` at the same value.
    """

    kind: str | None
    family: tuple[str, ...]
    location: str
    parameter: str
    unit: str
    make: Make
    guess: float
    cap: float = np.inf
    signed: bool = False
    power: float = 1.0
    onset: bool = False
    others: tuple[str, ...] = ()
    shapes: tuple[str, ...] = ()
    rule: float | None = None
    also: tuple[str, ...] = ()
    label: str = ""
    beside: tuple[Make, ...] = ()

    @property
    def name(self) -> str:
        """Unique within a world."""
        return f"{self.kind or 'outside'}:{self.label or self.parameter}@{self.location}"


def after(onset: float | None, t: float) -> bool:
    """Whether an effect with that onset acts at t."""
    return onset is None or t >= onset


def plain(make: Callable[[float], Change]) -> Make:
    """A `make` that needs neither onset nor chance."""
    return lambda value, onset, rng: make(value)
