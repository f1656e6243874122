"""Which model of a tank its test asks for: rigid, sloshing, or sloshing softer at large amplitude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.stats import chi2

from smsid._short_repr import short_repr
from smsid.arm.regression import correlation_lags
from smsid.lab.tank import COUNTS, Model, TankFit, TankTest, fit_tank

MODELS: tuple[Model, ...] = ("rigid", "slosh", "softening spring", "softening inertia")

LEVEL = 0.01
"""Significance that a richer model needs."""


@short_repr
@dataclass(frozen=True)
class TankComparison:
    """Models of one test, simplest first.

    ``named`` is the richest that the data ask for, each step significant at `LEVEL`; ``gains`` the twofold
    increase of the log likelihood over the model named before, in independent samples, by model.
    ``sloshes``: whether a moving liquid is needed at all; ``amplitude``: whether its frequency depends on
    amplitude.
    """

    fits: Mapping[Model, TankFit]
    gains: Mapping[Model, float]
    named: Model

    @property
    def sloshes(self) -> bool:
        """Whether the container alone does not explain the force."""
        return self.named != "rigid"

    @property
    def amplitude(self) -> bool:
        """Whether the frequency depends on amplitude."""
        return self.named.startswith("softening")


def compare_tank_models(test: TankTest, models: Sequence[Model] = MODELS) -> TankComparison:
    """Fit models of rising richness to a tank test and name the one that the data ask for.

    Residuals are correlated over time: their likelihood counts one sample per correlation time of the
    richer model's residual. Of two models of the same number of parameters the likelier is taken.

    Args:
        test: of `tank_test`.
        models: to compare.

    Raises:
        NotIdentifiableError: as `fit_tank`.
    """
    fits: dict[Model, TankFit] = {m: fit_tank(test, m) for m in models}
    order: list[Model] = sorted(fits, key=lambda m: (COUNTS[m], -fits[m].log_likelihood))
    named = order[0]
    gains: dict[Model, float] = {}
    for model in order[1:]:
        more = COUNTS[model] - COUNTS[named]
        lags = max(1, correlation_lags(fits[model].residual[:, None]))
        gains[model] = 2.0 * (fits[model].log_likelihood - fits[named].log_likelihood) / lags
        if more > 0 and gains[model] > chi2.ppf(1.0 - LEVEL, more):
            named = model
    return TankComparison(fits, gains, named)
