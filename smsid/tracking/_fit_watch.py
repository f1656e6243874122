"""Whether the model explains the telemetry: innovations by component, over the last few hundred of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from smsid.estimation.fit_quality import WRONG_RATIO
from smsid.tracking._update import Update

FEWEST, MEMORY = 20, 600  # readings of a component before it is judged; that its mean square goes back


class FitWatch:
    """Listens to a tracker. ``misfit`` is the root mean square of the normalised innovations of the worst
    component, once that is beyond `smsid.estimation.fit_quality.WRONG_RATIO`, one while all is right.

    It does not shrink: what a wrong model has done to parameters stays. ``component`` is where it was;
    ``squares`` are mean square and number of readings by component. ``apart`` is how far the filter was from
    the most likely parameters of the same samples, in its standard deviations (`WarmStart`), ``seconds`` [s].
    """

    def __init__(
        self,
        misfit: float = 1.0,
        component: str = "",
        squares: Mapping[str, tuple[float, int]] | None = None,
        apart: float = 1.0,
        seconds: float = 0.0,
    ) -> None:
        self.misfit, self.component, self.apart, self.seconds = misfit, component, apart, seconds
        self.forgotten = 1.0  # largest misfit that a change has explained
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

    def copied(self) -> FitWatch:
        """Return the same, to be gone back to."""
        return FitWatch(self.misfit, self.component, self.squares, self.apart, self.seconds)

    def go_back(self, before: FitWatch) -> None:
        """Forget what was heard since: a change explains it."""
        self.forgotten = max(self.forgotten, self.misfit)
        self.misfit, self.component = before.misfit, before.component
        self._names, self._places = list(before._names), {}
        self._mean, self._count = before._mean.copy(), before._count.copy()

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
        if len(worst) and worst.max() > max(WRONG_RATIO, self.misfit) ** 2:
            k = int(worst.argmax())
            self.misfit, self.component = float(mean[k]) ** 0.5, update.rows[k]

    def _places_of(self, rows: tuple[str, ...]) -> np.ndarray:
        new = [name for name in rows if name not in self._names]
        self._names += new
        self._mean = np.append(self._mean, np.zeros(len(new)))
        self._count = np.append(self._count, np.zeros(len(new), dtype=int))
        return np.array([self._names.index(name) for name in rows], dtype=int)

    @property
    def widening(self) -> float:
        """The factor that the filter's standard deviations need."""
        return self.misfit * self.apart

    @property
    def explained(self) -> bool:
        """Whether no component was left at more than `WRONG_RATIO` times its noise."""
        return self.misfit == 1.0

    @property
    def sentence(self) -> str:
        """What does not fit, or nothing."""
        said = []
        if not self.explained:
            said.append(
                f"The model does not explain the telemetry: {self.component} is left at {self.misfit:.3g} "
                "times its noise. Bands are that much wider; the values may still be wrong"
            )
        if self.apart > 1.0:
            said.append(
                f"after {self.seconds:.4g} s the filter was {self.apart:.3g} of its standard deviations from "
                "the most likely parameters of the same samples: a filter averages over torques that follow "
                "measured motion, and is linear about where it was. Bands are that much wider, and changes "
                "that are told may be none; `smsid identify` is not pulled so"
            )
        return ". ".join(x[0].upper() + x[1:] for x in said)
