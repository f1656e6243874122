"""The shortest experiment that reaches a precision: a search over durations, each with its own design."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from smsid.errors import ExperimentError

Progress = Callable[[str, int, float], None]
"""Hears what is being done, how many experiments were tried, and the best relative standard deviation."""

T = TypeVar("T")


@dataclass
class Watch(Generic[T]):
    """The best candidate of a search. Lower cost is better."""

    progress: Progress | None = None
    stage: str = ""
    evaluations: int = 0
    cost: float = float("inf")
    best: T | None = None
    interrupted: bool = False
    shown: float = field(default=float("nan"), repr=False)

    def tried(self, candidate: T, cost: float, shown: float) -> None:
        """Note a candidate; ``shown`` is what progress tells of it."""
        self.evaluations += 1
        if cost < self.cost:
            self.cost, self.best, self.shown = cost, candidate, shown
        if self.progress is not None:
            self.progress(self.stage, self.evaluations, self.shown)

    def restart(self, stage: str) -> None:
        """Forget the best, for a new question; evaluations go on counting."""
        self.stage, self.cost, self.best = stage, float("inf"), None


AIM = 0.995  # of the precision asked for: what a search sees differs by less from the exact bound
POWER = 1.5  # of the duration with which a standard deviation falls, to begin with
POWERS = (0.3, 4.0)  # between which it is believed to be
FACTOR = 8.0  # by which a duration changes at most in a step
CLOSE = 0.01  # relative, to the shortest
ROUNDS = 10


def minimum_time_design(
    search: Callable[[float], tuple[float, T]],
    target: float,
    begin: float,
    longest: float,
    whole: Callable[[float], float],
    watch: Watch[T],
    held_back: Callable[[T], str] = lambda _: "",
) -> T:
    """Return the design of the shortest duration at which a relative standard deviation is at most a target.

    ``search`` gives for a duration [s] the standard deviation and the design, ``whole`` rounds durations. By
    regula falsi on logarithms, to 1 %, half a per cent of the precision to spare. An interrupt ends it with
    the shortest that reaches the target, else with the most precise. ``held_back`` says of a design what kept
    it from being better. Raises `ExperimentError` when even the longest does not reach the target.
    """
    asked, target = target, AIM * target
    tried: dict[float, tuple[float, T]] = {}

    def at(duration: float) -> float:
        tried[duration] = search(duration)
        return tried[duration][0]

    duration = whole(min(begin, longest))
    at(duration)
    for _ in range(ROUNDS):
        good = [t for t, (s, _) in tried.items() if s <= target]
        bad = [t for t, (s, _) in tried.items() if s > target]
        if watch.interrupted or (good and bad and max(bad) > min(good) * (1.0 - CLOSE)):
            break
        if bad and max(bad) >= whole(longest) * (1.0 - 1e-9):
            reached = min(s for s, _ in tried.values())
            raise ExperimentError(
                f"{100 * asked:.4g} % is out of reach within {longest:.4g} s: the best found gives "
                f"{100 * reached:.4g} %{held_back(min(tried.values(), key=lambda x: x[0])[1])}.",
                advice="Allow a longer duration or looser limits.",
                reached=reached,
                duration=longest,
            )
        duration = whole(float(np.clip(_next_duration(tried, target, good, bad), 0.0, longest)))
        if duration <= 0.0 or duration in tried:
            break
        at(duration)
    good = [t for t, (s, _) in tried.items() if s <= target]
    chosen = min(good) if good else min(tried, key=lambda t: tried[t][0])
    return tried[chosen][1]


def _next_duration(tried: dict, target: float, good: list[float], bad: list[float]) -> float:
    """Return the next duration: between a good and a bad one where the logarithms meet, else beyond."""
    if good and bad:
        high = min(good)
        low = max((t for t in bad if t < high), default=min(bad))
        a, b = np.log(tried[low][0] / target), np.log(target / tried[high][0])
        share = np.clip(a / max(a + b, 1e-12), 0.05, 1.0)
        met = float(low * (high / low) ** share * (1.0 + 0.2 * CLOSE))
        return min(met, high * (1.0 - 0.9 * CLOSE))  # a bad one so near ends the search
    at = min(good) if good else max(bad)
    power = POWER
    if len(tried) > 1:
        (t, s), (u, r) = [(t, s) for t, (s, _) in list(tried.items())[-2:]]
        power = float(np.clip(np.log(s / r) / np.log(u / t), *POWERS))
    factor = float(np.clip((tried[at][0] / target) ** (1.0 / power), 1.0 / FACTOR, FACTOR))
    return at * factor * (0.98 if good else 1.003)
