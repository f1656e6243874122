"""Keeping the best so far: progress to whoever watches, and interrupts that lose nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

T = TypeVar("T")
Progress = Callable[[str, int, float], None]
"""Hears what is being done, how many experiments were tried, and the best relative standard deviation."""


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

    def restarted(self, stage: str) -> None:
        """Forget the best, for a new question; evaluations go on counting."""
        self.stage, self.cost, self.best = stage, float("inf"), None
