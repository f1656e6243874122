"""Whether the model explains the telemetry: innovations by component, over the last few hundred of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from smsid.estimation.fit_quality import WRONG_RATIO
from smsid.tracking._update import Update

FEWEST, MEMORY = 20, 600  # readings of a component before it is judged; that its mean square goes back


class FitWatch:
    """Listens to a tracker. ``widening`` is the factor its standard deviations need, one while all is right.

    It is the root mean square of the normalised innovations of the worst component, once that is beyond
    `smsid.estimation.fit_quality.WRONG_RATIO`, and does not shrink: what a wrong model has done to parameters
    stays. ``component`` is where it was; ``squares`` are mean square and number of readings by component.
    """

    def __init__(
        self,
        widening: float = 1.0,
        component: str = "",
        squares: Mapping[str, tuple[float, int]] | None = None,
    ) -> None:
        self.widening, self.component = widening, component
        known = dict(squares or {})
        self._names = list(known)
        self._mean = np.array([mean for mean, _ in known.values()], dtype=float)
        self._count = np.array([count for _, count in known.values()], dtype=int)
        self._places: dict[tuple[str, ...], np.ndarray] = {}  # of the components read together

    @property
    def squares(self) -> dict[str, tuple[float, int]]:
        """Mean square and number of readings by component."""
        return dict(
            zip(self._names, zip(self._mean.tolist(), self._count.tolist(), strict=True), strict=True)
        )

    def hear(self, update: Update) -> None:
        """Take in an update."""
        at = self._places.get(update.rows)
        if at is None:
            at = self._places[update.rows] = self._places_of(update.rows)
        count = self._count[at] + 1
        mean = self._mean[at]
        mean += (update.normalised**2 - mean) / np.minimum(count, MEMORY)
        self._mean[at], self._count[at] = mean, count
        worst = np.where(count >= FEWEST, mean, 0.0)
        if len(worst) and worst.max() > max(WRONG_RATIO, self.widening) ** 2:
            k = int(worst.argmax())
            self.widening, self.component = float(mean[k]) ** 0.5, update.rows[k]

    def _places_of(self, rows: tuple[str, ...]) -> np.ndarray:
        new = [name for name in rows if name not in self._names]
        self._names += new
        self._mean = np.append(self._mean, np.zeros(len(new)))
        self._count = np.append(self._count, np.zeros(len(new), dtype=int))
        return np.array([self._names.index(name) for name in rows], dtype=int)

    @property
    def explained(self) -> bool:
        """Whether no component was left at more than `WRONG_RATIO` times its noise."""
        return self.widening == 1.0

    @property
    def sentence(self) -> str:
        """What does not fit, or nothing."""
        if self.explained:
            return ""
        return (
            f"The model does not explain the telemetry: {self.component} is left at {self.widening:.3g} "
            "times its noise. Bands are that much wider; the values may still be wrong"
        )
