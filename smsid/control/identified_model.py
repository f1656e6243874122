"""The spacecraft with an estimate's values in it: what the controller's model is built from.

It is the H_hat and c_hat of (43). Slosh and appendages take the estimate's values by name; bodies are those
of an export (`smsid.estimation.bodies`): of all that have the estimate's combinations the nearest to the
description, and ones that can exist. Two descriptions that differ in what the data do not see so give the
same controller.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid.control.reduced import ReducedDynamics
from smsid.description.schema import Description
from smsid.effects.inertial_parameters import pinocchio_inertia
from smsid.errors import ControlError
from smsid.estimation.bodies import (
    identified_bodies,
    inertial_equations,
    left_note,
    linear_terms,
    with_estimate,
)
from smsid.identify.estimate import BY_PRODUCT_GROUPS, Estimate
from smsid.identify.momentum_rows import whole_bodies
from smsid.likelihood.pseudo_inertia import SIZE
from smsid.model import build_model
from smsid.model.regressor import Regressor
from smsid.model.rigid_bodies import urdf_bodies
from smsid.model.spacecraft import SpacecraftModel

logger = logging.getLogger(__name__)


@short_repr
@dataclass(frozen=True)
class IdentifiedModel:
    """``model``: the spacecraft as identified, slosh and appendages included.

    ``applied`` names the estimate's parameters in it, ``left`` those that stay as described because the data
    do not hold them; ``misfit`` is the root mean square deviation of inertial combinations from their
    estimates, in standard deviations (bodies that can exist may not meet all of them). ``directions``
    (k, 10 bodies) say by how much the inertial parameters of all bodies, ordered as `Regressor.names`, move
    for one standard deviation of each combination in ``direction_names``.
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
        for name, inertia in found.bodies.items():
            own = change[names.index(name)]
            theta = inertia.toDynamicParameters() + own
            inertias.append(pinocchio_inertia(theta) if own.any() else inertia.copy())
        return found.with_inertias(inertias)


def identified_model(description: Description, estimate: Estimate) -> IdentifiedModel:
    """Return the description's spacecraft with the values of an estimate, linear or maximum likelihood.

    Raises:
        ControlError: the estimate is of another spacecraft, or holds no inertial parameters.
        DescriptionError: as `with_estimate` and `identified_bodies`.
    """
    if estimate.description != description.name:
        raise ControlError(
            f"The estimate is of '{estimate.description}', the description of '{description.name}'.",
            advice="Give the description that was identified.",
        )
    with_effects, notes = with_estimate(description, estimate)
    model = build_model(with_effects)
    _, _, _, told = inertial_equations(model, estimate)
    if set(told) <= {"total.mass"}:
        raise ControlError(
            f"The estimate of '{estimate.description}' holds no inertial parameters of Exp. 2.",
            advice="Identify with a recording of Exp. 2.",
            groups=sorted({p.group for p in estimate.parameters}),
        )
    bodies, urdf = identified_bodies(model, estimate), urdf_bodies(with_effects)
    changed = model.pin.copy()
    for name, theta in bodies.parameters.items():
        joint = changed.getJointId(name)
        if joint < changed.njoints:
            own = changed.inertias[joint].toDynamicParameters() + theta - urdf[name]
            changed.inertias[joint] = pinocchio_inertia(own)
    names, own_terms = set(Regressor(model).names), linear_terms(estimate, whole_bodies(model)[:10])
    untold = [
        p.name
        for p in estimate.parameters
        if p.group not in BY_PRODUCT_GROUPS and np.isfinite(p.value) and not np.isfinite(p.sigma)
        if p.name in own_terms and set(own_terms[p.name][0]) <= names
    ]
    known = _effect_names(description)
    left = [p.name for p in estimate.parameters if left_note(p.name) in notes]
    applied = [p.name for p in estimate.parameters if p.name in known and p.name not in left]
    applied += [name for name in told if name != "total.mass"]
    logger.info("the controller's model: %d parameters identified, left: %s", len(applied), left or "none")
    return IdentifiedModel(
        replace(model, pin=changed, data=changed.createData()),
        tuple(applied),
        tuple(left),
        bodies.misfit,
        np.vstack([bodies.directions, np.zeros((len(untold), bodies.directions.shape[1]))]),
        (*bodies.combinations, *untold),
    )


def _effect_names(description: Description) -> set[str]:
    """Return the names that estimates have for parameters of effects."""
    names: set[str] = set()
    for effect in description.effect:
        names |= {p.name for p in effect.parameters()}
        if (panel := effect.as_appendage()) is not None:
            names |= {panel.mass_parameter().name, f"{effect.name}.participation_factor"}
            for k, _ in enumerate(panel.described_modes(description.effect), start=1):
                names |= {f"{effect.name}.mode{k}.{field}" for field in ("frequency", "damping")}
    return names


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
