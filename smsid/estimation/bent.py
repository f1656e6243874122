"""Parameters that are known only as far as an effect's parameter that the data hardly tell.

Masses and springs of an effect enter the motion as products with hidden states. Where one of them is known to
a quarter of its size or worse, the likelihood is bent, and a standard deviation from its curvature at the
maximum says little: the total mass of a craft goes with the mass in its tank, and is as uncertain.
"""

from __future__ import annotations

import numpy as np

from smsid.estimation.normal_equations import NormalEquations

POORLY = 0.25  # standard deviation over value from which an effect's parameter is poorly known
MOST = 0.5  # share of a variance that comes through such parameters


def bent_by(found: NormalEquations, gradient: np.ndarray, covariance: np.ndarray) -> list[str | None]:
    """Return for each row (rows, m) of ``gradient`` the poorly known parameter it goes with, or None.

    ``covariance`` (m, m) is that of the unknowns, both in units of their scales. A row goes with such
    parameters when half of its variance would be gone if they were known.
    """
    unknowns, sigma = found.unknowns, np.sqrt(np.diag(covariance)) * found.scales
    poor = [i for i, u in enumerate(unknowns) if u.positive and sigma[i] > POORLY * abs(found.point.value(u))]
    if not poor:
        return [None] * len(gradient)
    cross = gradient @ covariance[:, poor]
    total = np.einsum("ij,jk,ik->i", gradient, covariance, gradient)
    through = np.einsum("ij,ji->i", cross, np.linalg.solve(covariance[np.ix_(poor, poor)], cross.T))
    alone = cross**2 / np.diag(covariance)[poor]
    return [
        unknowns[poor[int(np.argmax(a))]].name if t > MOST * v > 0.0 else None
        for t, v, a in zip(through, total, alone, strict=True)
    ]
