"""Where the search starts: the linear method's result put into the parameter vector."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from smsid.errors import SimulationError
from smsid.identify.momentum_rows import carried_matrix
from smsid.identify.paper.pipeline import BRIDGED, Identification
from smsid.likelihood.fit import NEARBY
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import Evaluation, SearchPoint
from smsid.likelihood.prior import CAD, Prior
from smsid.likelihood.pseudo_inertia import SIZE
from smsid.likelihood.recording_term import RecordingTerm
from smsid.model.regressor import Regressor

logger = logging.getLogger(__name__)

TRUST = 0.01  # the linear method's results are trusted no further than this, relative to the body's size


def best_start(pieces: Sequence[RecordingTerm], points: Sequence[SearchPoint], prior: Prior) -> Evaluation:
    """Return what is seen at the point whose prediction is nearest to the data.

    A biased sensor can spoil the linear method.
    The last is asked first, and taken without a look at the others where it is near the maximum.

    Raises `SimulationError` when none of them can be predicted from.
    """
    found: list[tuple[float, Evaluation]] = []
    failure: SimulationError | None = None
    samples = sum(c.values.shape[0] * c.width for p in pieces for c in p.channels)
    for point in points[::-1]:
        try:
            seen = Evaluation.at(pieces, point)
        except SimulationError as error:
            failure = error
            continue
        found.append((seen.cost(pieces, prior), seen))
        if failure is None and found[0][0] < NEARBY * samples:
            break
    if failure is not None and not any(np.isfinite(cost) for cost, _ in found):
        raise failure
    logger.info("starting candidates: %s", ", ".join(f"{cost:.4g}" for cost, _ in found))
    return min(found, key=lambda f: f[0])[1]


def candidates(described: Parameters, found: Identification | None) -> list[Parameters]:
    """Return where to start: the description, with modes, effects, or all from the linear method.

    Slosh, densities and modes by name, where it calls them identifiable; inertias are those nearest to the
    description that have the total mass and the base combinations found.
    """
    if found is None:
        return [described]
    scalars = _scalars(described, found)
    modes = {k: v for k, v in scalars.items() if ".mode" in k}
    at = described.with_scalars(scalars)
    return [described, described.with_scalars(modes), at, _with_inertias(at, found)]


def _with_inertias(at: Parameters, found: Identification) -> Parameters:
    n = at.inertias.size
    theta, jacobian = at.theta(), at.theta_jacobian()[:, :n]
    rows, rhs = [np.eye(n) / CAD], [np.zeros(n)]
    if found.translation is not None and "M" in found.translation.combined:
        mass, sigma = found.translation.combined["M"]
        weight = 1.0 / max(sigma, 1e-3 * mass)
        rows.append(weight * jacobian[::SIZE].sum(axis=0)[None])
        rhs.append(np.array([weight * (mass - theta[::SIZE].sum())]))
    if found.momentum is not None:
        regressor = Regressor(at.layout.model)
        b = found.momentum.b
        unknown = [regressor.names.index(name) for name in b.theta_names]
        matrix = b.base.matrix @ (np.eye(len(theta)) + carried_matrix(at.layout.model, regressor))[unknown]
        own = matrix @ jacobian
        weight = 1.0 / np.maximum(b.sigma, TRUST * np.abs(own).max(axis=1))
        good = np.isfinite(b.values) & np.isfinite(weight)
        rows.append((weight[:, None] * own)[good])
        rhs.append((weight * (b.values - matrix @ theta))[good])
    step = np.zeros(at.size)
    step[:n] = np.linalg.lstsq(np.vstack(rows), np.concatenate(rhs), rcond=None)[0]
    return at.moved(step)


def _scalars(described: Parameters, found: Identification) -> dict[str, float]:
    """Values by the names of the scalars; a value the logarithm cannot take, or far off, is left out."""
    known = {s.name: s for s in described.scalars}
    out = {}
    for p in found.estimate.parameters:
        if p.name in known and (p.status == "identifiable" or p.note.startswith(BRIDGED)):
            s = known[p.name]
            sane = 0.2 * s.size < p.value < 5.0 * s.size if s.log else 0.0 <= p.value <= 10.0 * s.size
            if sane:
                out[p.name] = p.value
    for name in known:
        if name.endswith(".density_factor") and found.translation is not None:
            symbol = found.translation.density_symbol(name.removesuffix(".density_factor"))
            value, sigma = found.translation.combined[symbol] if symbol else (1.0, 0.0)
            if sigma < 0.1 * value and 0.2 < value < 5.0:
                out[name] = value
    return out
