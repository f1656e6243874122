"""What is known before the data: the user's priors, and a wide one around the description for the rest.

Directions that the data do not see - masses and moments of links that no base parameter contains alone - are
held by it; where the data see, it weighs next to nothing. Stated defaults: 50 % of every body's mass, first
moment and inertia (`CAD`), and ten times the value for parameters of effects (`EFFECT`).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from smsid.errors import DescriptionError
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.pseudo_inertia import SIZE
from smsid.model.regressor import INERTIAL_NAMES

CAD = 0.5  # standard deviation of inertial parameters, relative to the body's own size
Cad = float | Mapping[str, tuple[float, float]]
"""What is known of rigid bodies: one relative standard deviation, or (value, sigma) by name."""
EFFECT = 10.0  # standard deviation of effect parameters without a prior, relative to the described value


class Prior:
    """Gaussian prior around a described point, in ordinary inertial parameters and scalar values.

    ``cad``: what is known better of the rigid bodies: the standard deviation of all their described
    parameters, relative to the body's own size as in `CAD`; or (value, sigma) by name (``link2.m``,
    ``bus.Ixx``; moments about the origin of the body's frame, wheels with the bus, appendages not) [kg, kg m,
    kg m^2]. What is known of effects stands in the description (`Effect.prior`).

    Raises `DescriptionError` for a name that is no parameter, or a sigma that is not positive.
    """

    def __init__(self, described: Parameters, cad: Cad | None = None) -> None:
        self.mean = described.inertias.copy()
        relative = CAD if cad is None or isinstance(cad, Mapping) else float(cad)
        if not (relative > 0.0 and np.isfinite(relative)):
            raise DescriptionError(
                f"A prior of the bodies cannot have the relative standard deviation {relative}.",
                advice="Give a positive number: 0.05 for 5 % of a body's size.",
            )
        self.sigma = relative * described.sizes
        known = {
            f"{body}.{symbol}": (i, k)
            for i, body in enumerate(described.layout.names)
            for k, symbol in enumerate(INERTIAL_NAMES[:SIZE])
        }
        for name, (value, sigma) in (cad if isinstance(cad, Mapping) else {}).items():
            if name not in known or not (sigma > 0.0 and np.isfinite([value, sigma]).all()):
                raise DescriptionError(
                    f"'{name}' with {value} +- {sigma} is no prior of a body.",
                    advice=f"Give (value, sigma) of one of {', '.join(known)}.",
                    name=name,
                )
            self.mean[known[name]], self.sigma[known[name]] = value, sigma

    def residual(self, at: Parameters) -> tuple[np.ndarray, np.ndarray]:
        """Return whitened residuals (rows,) and their derivative by the step (rows, size)."""
        n = at.inertias.size
        rows = [((at.inertias - self.mean) / self.sigma).ravel()]
        jacobian = [np.hstack([np.diag((at.sizes / self.sigma).ravel()), np.zeros((n, at.size - n))])]
        start = n
        for i, s in enumerate(at.scalars):
            sigma_ = s.sigma if s.sigma is not None else EFFECT * s.size
            own = np.zeros((1, at.size))
            if s.log:
                # the logarithm of a value with this standard deviation about the reference
                width = float(np.sqrt(np.log1p((sigma_ / s.reference) ** 2)))
                rows.append(np.array([np.log(s.value / s.reference) / width]))
                own[0, start + i] = 1.0 / width
            else:
                rows.append(np.array([(s.value - s.reference) / sigma_]))
                own[0, start + i] = 1.0 / sigma_
            jacobian.append(own)
        return np.concatenate(rows), np.vstack(jacobian)
