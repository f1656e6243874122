"""Whether the model explains the telemetry: innovations by component, over the last few hundred of them."""

from __future__ import annotations

from dataclasses import dataclass, field

from smsid.estimation.fit_quality import WRONG
from smsid.tracking.update import Update

FEWEST, MEMORY = 20, 600  # readings of a component before it is judged; that its mean square goes back


@dataclass
class FitWatch:
    """Listens to a tracker. ``widening`` is the factor its standard deviations need, one while all is right.

    It is the root mean square of the normalised innovations of the worst component, once that is beyond
    `smsid.estimation.fit_quality.WRONG`, and does not shrink: what a wrong model has done to parameters
    stays. ``component`` is where it was; ``squares`` are mean square and number of readings by component.
    """

    widening: float = 1.0
    component: str = ""
    squares: dict[str, tuple[float, int]] = field(default_factory=dict)

    def hear(self, update: Update) -> None:
        """Take in an update."""
        for name, x in zip(update.rows, update.normalised.tolist(), strict=True):
            mean, count = self.squares.get(name, (0.0, 0))
            count += 1
            mean += (x * x - mean) / min(count, MEMORY)
            self.squares[name] = mean, count
            if count >= FEWEST and mean > max(WRONG, self.widening) ** 2:
                self.widening, self.component = mean**0.5, name

    @property
    def explained(self) -> bool:
        """Whether no component was left at more than `WRONG` times its noise."""
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
