"""The spacecraft with an estimate's values in it: what the controller's model is built from.

It is the H_hat and c_hat of (43). Slosh and appendages take the estimate's values by name. Exp. 2 does not
give each body's inertia but combinations, ``link2.mx + 2 link3.m = ...``, which with the total mass are all
that the motion depends on: the bodies taken are those nearest to the description that have them, each weighed
by its standard deviation against 50 % of the body's size, and ones that can exist. Two descriptions that
differ in what the data do not see so give the same controller. (Combinations are read from their names; their
factors have four digits there.)
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from smsid._short_repr import short_repr
from smsid.control.reduced import ReducedDynamics
from smsid.description.schema import Description
from smsid.errors import ControlError
from smsid.identify.estimate import BY_PRODUCT_GROUPS, Estimate, ParameterEstimate
from smsid.identify.momentum_rows import carried_matrix
from smsid.identify.parameter_estimate import parse_combination
from smsid.likelihood.consistent import consistent_inertias
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prior import CAD
from smsid.likelihood.pseudo_inertia import SIZE
from smsid.model import build_model
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel

logger = logging.getLogger(__name__)
SHARPEST = 1e-4
"""Smallest standard deviation, relative to the body's size, that a combination is weighed with: rounding."""


@short_repr
@dataclass(frozen=True)
class IdentifiedModel:
    """``model``: the spacecraft as identified, slosh and appendages included.

    ``applied`` names the estimate's parameters in it, ``left`` those that stay as described because the data
    do not hold them; ``misfit`` is the largest deviation of an inertial combination from its estimate, in
    standard deviations (bodies that can exist may not meet all of them). ``directions`` (k, 10 bodies) say by
    how much the inertial parameters of all bodies, ordered as `Regressor.names`, move for one standard
    deviation of each combination in ``direction_names``.
    """

    model: SpacecraftModel
    applied: tuple[str, ...]
    left: tuple[str, ...]
    misfit: float
    directions: np.ndarray
    direction_names: tuple[str, ...]

    def dynamics(self, deviations: np.ndarray | None = None) -> ReducedDynamics:
        """Return the controller's model, combinations moved by ``deviations`` (k,) standard deviations."""
        found = ReducedDynamics(self.model)
        if deviations is None:
            return found
        change = (deviations @ self.directions).reshape(-1, SIZE)
        names = list(self.model.pin.names)[1:]
        inertias = []
        for name, inertia in zip(list(found.pin.names)[1:], list(found.pin.inertias)[1:], strict=True):
            own = change[names.index(name)]
            theta = inertia.toDynamicParameters() + own
            inertias.append(pin.Inertia.FromDynamicParameters(theta) if own.any() else inertia.copy())
        return found.with_inertias(inertias)


def identified_model(description: Description, estimate: Estimate) -> IdentifiedModel:
    """Return the description's spacecraft with the values of an estimate, linear or maximum likelihood.

    Raises:
        ControlError: the estimate is of another spacecraft, or holds no inertial parameters.
        DescriptionError: a spacecraft whose parameters are no vector (welded, or without inertia).
    """
    if estimate.description != description.name:
        raise ControlError(
            f"The estimate is of '{estimate.description}', the description of '{description.name}'.",
            advice="Give the description that was identified.",
        )
    described = Parameters.of(build_model(description))
    at, applied, left = _with_effects(described, estimate)
    regressor = Regressor(at.layout.model)
    rows, found = combinations(estimate, regressor.names)
    if not found:
        raise ControlError(
            f"The estimate of '{estimate.description}' holds no inertial parameters of Exp. 2.",
            advice="Identify with a recording of Exp. 2.",
            groups=sorted({p.group for p in estimate.parameters}),
        )
    at, misfit, directions, names = _with_inertias(at, described, regressor, rows, found, estimate)
    applied += [p.name for p in found]
    model = build_model(at.description())
    changed = model.pin.copy()
    for joint, inertia in enumerate(at.pin_model().inertias):
        changed.inertias[joint] = inertia
    logger.info("the controller's model: %d parameters identified, left: %s", len(applied), left or "none")
    return IdentifiedModel(
        replace(model, pin=changed, data=changed.createData()),
        tuple(applied),
        tuple(left),
        misfit,
        directions,
        names,
    )


def identified_level(
    identified: IdentifiedModel,
    rng: np.random.Generator,
    *,
    angles: Sequence[np.ndarray] | None = None,
    draws: int = 200,
) -> float:
    """Return the uncertainty level of an identified model: which |H^-1 H_hat - I| its intervals allow.

    The 95 % quantile over ``draws`` of the combinations, Gaussian with the estimate's standard deviations and
    independent (an estimate's file does not hold correlations), of the norm of L^-1 (H_hat - H) L^-T,
    H = L L^T, the largest over arm joint ``angles`` (each (n,) [rad]; home by default).

    Raises `ControlError` when a combination has no interval: weights cannot be made up.
    """
    without = [
        n for n, d in zip(identified.direction_names, identified.directions, strict=True) if not d.any()
    ]
    if without:
        raise ControlError(
            f"{len(without)} parameters have no interval, the first is '{without[0]}'; weights "
            "need one for each.",
            advice="Identify again with intervals, or state a level with --uncertainty.",
            parameters=without,
        )
    model = identified.model
    at = [model.joint_angles(model.home)] if angles is None else list(angles)
    exact = identified.dynamics()
    roots = [np.linalg.inv(np.linalg.cholesky(inertia_at(exact, x))) for x in at]
    levels = []
    for _ in range(draws):
        moved = identified.dynamics(rng.standard_normal(len(identified.directions)))
        levels.append(
            max(
                np.linalg.norm(r @ inertia_at(moved, x) @ r.T - np.eye(len(r)), 2)
                for r, x in zip(roots, at, strict=True)
            )
        )
    return float(np.quantile(levels, 0.95))


def inertia_at(dynamics: ReducedDynamics, angles: np.ndarray) -> np.ndarray:
    """Return H (3 + n, 3 + n) of (40) in body axes with the arm joints at ``angles`` (n,) [rad]."""
    return dynamics.body_terms(np.zeros(3), angles, np.zeros(len(angles))).inertia


def combinations(
    estimate: Estimate, names: tuple[str, ...]
) -> tuple[np.ndarray, tuple[ParameterEstimate, ...]]:
    """Return the matrix (k, names) of an estimate's inertial combinations, and the parameters themselves."""
    index = {name: k for k, name in enumerate(names)}
    rows, found = [], []
    for p in estimate.parameters:
        if p.group in BY_PRODUCT_GROUPS or not np.isfinite(p.value):
            continue
        terms = parse_combination(p.name)
        if terms and all(name in index for name in terms):
            row = np.zeros(len(names))
            for name, factor in terms.items():
                row[index[name]] = factor
            rows.append(row)
            found.append(p)
    return np.array(rows).reshape(-1, len(names)), tuple(found)


def _with_effects(described: Parameters, estimate: Estimate) -> tuple[Parameters, list[str], list[str]]:
    """Put slosh, densities and modes by name; what is not identifiable stays as described."""
    known = {s.name: s for s in described.scalars}
    for joints in described.layout.model.appendages:
        part = joints.appendage
        for name in (part.mass_parameter().name, f"{part.name}.participation_factor"):
            known[name] = known[f"{part.name}.density_factor"]
    heavy = [a.appendage.mass_parameter() for a in described.layout.model.appendages]
    sizes = {p.name: p.value for p in heavy}
    values: dict[str, float] = {}
    applied, left = [], []
    for p in estimate.parameters:
        if p.name not in known or p.group in BY_PRODUCT_GROUPS:
            continue
        scalar = known[p.name]
        value = p.value / sizes.get(p.name, 1.0)
        if p.status != "identifiable" or (scalar.log and value <= 0.0):
            left.append(p.name)
            continue
        values[scalar.name] = value
        applied.append(p.name)
    return described.with_scalars(values), applied, left


def _with_inertias(
    at: Parameters,
    described: Parameters,
    regressor: Regressor,
    combined: np.ndarray,
    found: tuple[ParameterEstimate, ...],
    estimate: Estimate,
) -> tuple[Parameters, float, np.ndarray, tuple[str, ...]]:
    n = at.inertias.size
    theta, jacobian = at.theta(), at.theta_jacobian()[:, :n]
    matrix = combined @ (np.eye(len(theta)) + carried_matrix(at.layout.model, regressor))
    values = np.array([p.value for p in found])
    sigma = np.array([p.sigma for p in found])
    names = [p.name for p in found]
    if "total.mass" in estimate and np.isfinite(estimate["total.mass"].value):
        total = np.zeros(len(theta))
        total[::SIZE] = 1.0
        matrix = np.vstack([matrix, total])
        values = np.append(values, estimate["total.mass"].value)
        sigma = np.append(sigma, estimate["total.mass"].sigma)
        names.append("total.mass")
    own = matrix @ jacobian
    known = np.isfinite(sigma) & (sigma > 0.0)
    weight = 1.0 / np.maximum(np.where(known, sigma, 0.0), SHARPEST * np.abs(own).max(axis=1))
    rows = np.vstack([np.eye(n) / CAD, weight[:, None] * own])
    rhs = np.concatenate([np.zeros(n), weight * (values - matrix @ theta)])
    step = np.zeros(at.size)
    step[:n] = np.linalg.lstsq(rows, rhs, rcond=None)[0]
    moved = at.moved(step)
    covariance = np.linalg.inv(rows.T @ rows)
    moved = moved.with_inertias(consistent_inertias(moved, described, covariance))
    misfit = float(np.abs(weight * (values - matrix @ moved.theta())).max(initial=0.0))
    gain = covariance @ (weight[:, None] * own).T  # of the step, by what each estimate is off in sigmas
    directions = np.where(known, weight * sigma, 0.0)[:, None] * (jacobian @ gain).T
    return moved, misfit, directions, tuple(names)
