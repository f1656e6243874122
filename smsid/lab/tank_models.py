"""Which model of a tank its test asks for: rigid, sloshing, or sloshing softer at large amplitude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.stats import chi2

from smsid._short_repr import short_repr
from smsid._statistics import NORMAL95
from smsid.arm.regression import correlation_lags
from smsid.diagnose.result import Diagnosis, FoundCause, SignificantTest, Value
from smsid.diagnose.verdict import describe
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


ABOVE = 2.0
"""What is left ringing down counts when it is this many times what is left before the motion."""


def tank_diagnosis(test: TankTest, compared: TankComparison, recording: str) -> Diagnosis:
    """Return the diagnosis that a comparison of models amounts to, from the rigid container on.

    Causes: the slosh mass, the dependence of its frequency on amplitude, and the lag of the force sensor,
    each with its likelihood ratio in independent samples. The lag's parameter is the named model's; where its
    interval does not agree with that of the cross-correlation, a note says so. The verdict is ``unexplained``
    where more is left ringing down than `ABOVE` times what is left before the motion.
    """
    fit = compared.fits[compared.named]
    causes = []
    if compared.sloshes:
        ratio = float(compared.gains.get("slosh", float("nan")))
        names = "slosh_mass", "frequency", "damping"
        causes.append(_cause(fit, "slosh", "tank", "slosh", "slosh mass", names, ratio))
    if compared.amplitude:
        ratio = float(compared.gains.get(compared.named, float("nan")))
        causes.append(
            _cause(fit, "slosh_nonlinearity", "tank", "slosh", compared.named, ("softening",), ratio)
        )
    lag = fit.estimate["tank.lag"]
    if abs(lag.value) > NORMAL95 * lag.sigma:
        shape, ratio = "delay" if lag.value > 0.0 else "lead", (lag.value / lag.sigma) ** 2
        causes.append(_cause(fit, "sensor_delay", "force", "sensor", shape, ("lag",), ratio))
    quiet = fit.quiet(test)
    remaining = ()
    if fit.ring_down > ABOVE * quiet:
        remaining = (
            SignificantTest("force while ringing down", "time", (fit.ring_down / quiet) ** 2, 1, 0.0),
        )
    words = "; ".join(describe(c) for c in causes)
    left = (
        f"{fit.ring_down:.3g} N are left ringing down, {fit.moving:.3g} N while moving; "
        f"{quiet:.3g} N before the motion"
    )
    notes = [left, *fit.estimate.notes]
    low, high = test.lag.interval
    notes.append(f"force behind motion by cross-correlation, without a model: {low:.3g} to {high:.3g} s")
    if lag.interval[0] > high or lag.interval[1] < low:
        notes.append("the two lags do not agree")
    said = f"A rigid container lacks {words}. {left}." if causes else f"A rigid container is enough. {left}."
    return Diagnosis(
        description="tank",
        recordings=(recording,),
        verdict="unexplained" if remaining else "explained" if causes else "adequate",
        sentence=said,
        priors="all parameters of the models fitted freely",
        causes=tuple(causes),
        gain_reason="one recording holds one motion: there is no other to judge by",
        remaining=remaining,
        whitened_rms={"nominal": compared.fits["rigid"].ring_down / quiet, "extended": fit.ring_down / quiet},
        notes=tuple(notes),
    )


def _cause(
    fit: TankFit, effect: str, place: str, family: str, shape: str, names: Sequence[str], ratio: float
) -> FoundCause:
    p_value = float(chi2.sf(ratio, len(names)))
    evidence = {"likelihood_ratio": ratio, "freedom": float(len(names)), "p_value": p_value}
    found = [fit.estimate[f"tank.{n}"] for n in names]
    values = tuple(Value(p.name, p.value, p.sigma, p.unit) for p in found)
    return FoundCause(effect, place, family, shape, values, (), evidence)
