"""Do the recordings contradict what was known beforehand? The maximum of the likelihood against the prior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtrc

if TYPE_CHECKING:
    from smsid.estimation._normal_equations import NormalEquations

SIGNIFICANCE = 1e-4  # probability below which recordings contradict the prior
NAMED_SIGMAS = 3.5  # standard deviations of its prior by which a parameter that is named is off
MOST_NAMED = 5  # parameters at most
# information of the data, in units of the prior's, above which a direction is asked about: with less, where a
# search has ended (within 0.3 of a standard deviation) would be taken for a conflict
ASKED = 0.1


@dataclass(frozen=True)
class PriorConflict:
    """What recordings say against priors: probability of so much by chance, and where it shows.

    ``size`` is the root mean square of the difference in what it should be, ``parameters`` are (name,
    standard deviations of its prior by which it is off), the worst first. ``scale``: masses and forces are
    all so many times what was known, and by how much that may be off; ``None``: that is not what it is.
    """

    p_value: float
    size: float
    parameters: tuple[tuple[str, float], ...]
    scale: tuple[float, float] | None = None

    @property
    def sentence(self) -> str:
        """The conflict in a sentence."""
        named = ", ".join(f"{n} by {z:+.1f} sigma" for n, z in self.parameters)
        return (
            f"The recordings contradict what was known beforehand (p = {self.p_value:.1g})"
            + (f": {named}" if named else "")
            + self._as_a_scale
            + ". Check description and priors (`prior`, --cad), or give wider ones."
        )

    @property
    def _as_a_scale(self) -> str:
        if self.scale is None:
            return ""
        factor, sigma = self.scale
        return (
            f"; masses, inertias and forces are all {factor:.3g} +- {1.96 * sigma:.2g} times what was known, "
            "as if forces, torques and wheel rates were recorded with that scale"
        )


def prior_conflict(found: NormalEquations) -> PriorConflict | None:
    """Return by how much the recordings contradict the priors at the maximum of the posterior, if they do."""
    sigma = np.array([u.sigma for u in found.unknowns])
    off = np.array([(found.point.value(u) - u.nominal) for u in found.unknowns]) / sigma
    information = found.information * np.outer(sigma / found.scales, sigma / found.scales)
    heavier = np.array([u.nominal if has_mass(u.unit) else 0.0 for u in found.unknowns]) / sigma
    return conflict_of(off, information, [u.name for u in found.unknowns], heavier)


def has_mass(unit: str) -> bool:
    """Whether a quantity goes with the unit of mass, as forces do: no motion tells its scale by itself."""
    return "kg" in unit or unit.startswith("N")


def conflict_of(
    off: np.ndarray, information: np.ndarray, names: Sequence[str], heavier: np.ndarray | None = None
) -> PriorConflict | None:
    """Return the conflict of posterior means ``off`` (m,) from the priors' with what data say (m, m), if any.

    All in standard deviations of the priors. Along a direction of which the data's information is L, the
    likelihood is largest at ``off (1 + 1 / L)``, whose variance about the prior's mean is ``1 + 1 / L``:
    squares of both are chi-squared, over the directions of which the data tell something (`ASKED`). Beside
    that of all directions there is the test of one, ``heavier`` (m,): all that goes with mass grows together.
    """
    size, basis = np.linalg.eigh(0.5 * (information + information.T))
    told = size > ASKED
    if not told.any():
        return None
    wider = 1.0 + 1.0 / size[told]
    seen = basis[:, told].T @ off
    statistic, freedom = float(seen**2 @ wider), int(told.sum())
    p_value, worst, scale = float(chdtrc(freedom, statistic)), statistic / freedom, None
    along = np.zeros(freedom) if heavier is None else basis[:, told].T @ heavier
    if along.any():
        weight = float(along**2 @ (1.0 / wider))
        share = float(along @ seen) / weight
        p_scale = float(chdtrc(1, share**2 * weight))
        if p_scale < p_value:
            p_value, worst, scale = p_scale, share**2 * weight, (1.0 + share, weight**-0.5)
        p_value = min(2.0 * p_value, 1.0)  # the smaller of two
    if p_value >= SIGNIFICANCE:
        return None
    ranked = sorted(zip(names, off.tolist(), strict=True), key=lambda x: -abs(x[1]))
    named = [(name, z) for name, z in ranked[:MOST_NAMED] if abs(z) > NAMED_SIGMAS]
    return PriorConflict(p_value, float(np.sqrt(worst)), tuple(named), scale)
