"""A body by its mass, first moments and inertia, as centre of mass and inertia about it, with covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from smsid.estimation.inertial_combinations import about_centre
from smsid.identify.estimate import Estimate
from smsid.model.regressor import INERTIAL_NAMES

CENTRAL = tuple(f"c{n[1:]}" if n[0] == "m" else f"Ic{n[1:]}" for n in INERTIAL_NAMES[1:])
STEP = 1e-6  # of the parameters, for derivatives


def in_terms_of(estimate: Estimate, other: Estimate) -> Estimate:
    """Return an estimate with bodies about their centre of mass where the ``other`` has them so, only.

    First-order covariance. As it is where mass and all three first moments are not told, each by itself.
    """
    there = {p.name: i for i, p in enumerate(estimate.parameters)}
    for body in dict.fromkeys(p.name.rpartition(".")[0] for p in other.parameters):
        asked = [k for k, c in enumerate(CENTRAL) if f"{body}.{c}" in {p.name for p in other.parameters}]
        names = [f"{body}.{n}" for n in INERTIAL_NAMES]
        if asked and all(n in there for n in names[:4]):
            own = [k for k in asked if names[k + 1] in there and f"{body}.{CENTRAL[k]}" not in there]
            estimate = _about_centre(estimate, body, names, own)
    return estimate


def _about_centre(estimate: Estimate, body: str, names: list[str], own: list[int]) -> Estimate:
    """Return an estimate with elements ``own`` of `CENTRAL` of a body in the place of those by origin."""
    parameters = list(estimate.parameters)
    at = {n: [p.name for p in parameters].index(n) for n in names if n in {p.name for p in parameters}}
    theta = np.array([parameters[at[n]].value if n in at else 0.0 for n in names])
    steps = STEP * np.diag(np.maximum(np.abs(theta), 1e-3 * abs(theta[0])))
    columns = [(about_centre(theta + s) - about_centre(theta - s)) / (2.0 * s.sum()) for s in steps]
    slope = np.eye(len(parameters))
    for k in own:
        row = at[names[k + 1]]
        slope[row] = 0.0
        for n, column in zip(names, columns, strict=True):
            if n in at:
                slope[row, at[n]] = column[k]
    covariance = estimate.covariance
    if covariance is None:
        covariance = np.diag([p.sigma**2 for p in parameters])
    spread = slope @ covariance @ slope.T
    for k in own:
        row = at[names[k + 1]]
        parameters[row] = replace(
            parameters[row],
            name=f"{body}.{CENTRAL[k]}",
            unit="m" if k < 3 else "kg m^2",
            value=float(about_centre(theta)[k]),
            sigma=float(np.sqrt(spread[row, row])),
            profile=None,
        )
    told = None if estimate.covariance is None else spread
    return replace(estimate, parameters=tuple(parameters), covariance=told)
