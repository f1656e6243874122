"""What a refinement reports of each parameter: status, interval, note; and notes about the recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.errors import NotIdentifiableError, SimulationError
from smsid.identify.estimate import ParameterEstimate, classify
from smsid.likelihood._profile import not_gaussian, profile_of
from smsid.likelihood.combinations import Combination
from smsid.likelihood.fit import Fit
from smsid.likelihood.prior import Prior

METHOD = "maximum_likelihood"
UNSEEN = "the data do not see it"
WIDE = 0.05  # relative standard deviation above which the Gaussian interval is put to the test
CERTAIN = 5.0  # standard deviations beyond which a clock is said to be off
HELD = 0.5  # share of a variance that may come from the prior before a parameter counts as not seen


def judged_by_share(c: Combination, sigma: float, share: float) -> ParameterEstimate:
    """Return a parameter with its status; ``share`` of its variance is the prior's."""
    found = classify(c.name, c.value, c.unit, sigma, METHOD, nominal=c.nominal, reference=c.reference)
    if share <= HELD:
        return found
    note = f"{100 * share:.0f} % of its variance is the prior's, around the description: {UNSEEN}"
    return replace(found, status="not_identifiable", note=note)


def with_profiles(
    parameters: Sequence[ParameterEstimate], found: Fit, prior: Prior, covariance: np.ndarray
) -> list[ParameterEstimate]:
    """Return the parameters with profile intervals for what is seen, not well known, and not Gaussian.

    ``covariance`` (n, n) of the parameters, in order.
    """
    scalars = {s.name for s in found.point.parameters.scalars}
    out = []
    for p in parameters:
        wide = p.name in scalars and p.relative_sigma > WIDE and UNSEEN not in p.note
        if wide and not_gaussian(found, prior, p.name, covariance):
            try:
                interval = profile_of(found, prior, p.name)
            except (NotIdentifiableError, SimulationError) as error:
                note = f"{p.note}; not Gaussian, and its profile has no end: {error}".lstrip("; ")
                out.append(replace(p, status="not_identifiable", note=note))
                continue
            note = f"{p.note}; the likelihood is not Gaussian: interval from its profile".lstrip("; ")
            p = replace(p, profile=(interval.lower, interval.upper), note=note)
        out.append(p)
    return out


def nuisances(found: Fit, sigma: np.ndarray) -> list[ParameterEstimate]:
    """Return the local parameters but the joints' motion; ``sigma`` (k,) in their order."""
    out = []
    for piece, local in zip(found.pieces, found.point.locals, strict=True):
        for name, value, unit in zip(piece.names, piece.values(local), piece.units, strict=True):
            own = float(sigma[len(out)])
            out.append(ParameterEstimate(name, float(value), unit, own, "by_product", "nuisance"))
    return out


def clock_notes(parameters: Sequence[ParameterEstimate]) -> list[str]:
    """Return which clocks were found to be off, and by how much, beyond `CERTAIN` standard deviations."""
    clocks = [p for p in parameters if p.name.endswith((".clock_offset", ".clock_drift"))]
    return [
        f"{p.name} is {p.value:.3g} +- {p.sigma:.2g} {p.unit}: this clock does not agree with the rest"
        for p in clocks
        if abs(p.value) > CERTAIN * p.sigma
    ]


def prior_notes(parameters: Sequence[ParameterEstimate]) -> list[str]:
    """Return which values and intervals are those of what was known beforehand."""
    names = [p.name for p in parameters if UNSEEN in p.note]
    return [f"value and interval come from the prior, the data say less: {', '.join(names)}"] if names else []


def fit_notes(found: Fit) -> list[str]:
    """Return what there is to say about the channels: samples left out, noise levels."""
    notes = []
    for piece in found.pieces:
        for c in piece.channels:
            levels = ", ".join(f"{x:.2g}" for x in np.sqrt(np.diag(c.covariance)))
            if c.dropped:
                share = c.dropped / (c.dropped + len(c.times))
                what = "missing, at the sensor's limit, or far outside of their noise"
                notes.append(f"{piece.name}: {100 * share:.2g} % of {c.name} left out: {what}")
            notes.append(f"{piece.name}: noise of {c.name} as its residuals show it: {levels}")
    return notes
