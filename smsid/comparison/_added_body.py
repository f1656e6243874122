"""A rigid body added to a link, or taken from it: mass, centre and inertia from changes of ten parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from smsid.comparison._common_basis import slope_of
from smsid.comparison._explanations import Explained
from smsid.comparison.result import Finding, FindingKind, FindingQuantity
from smsid.effects.inertial_parameters import pseudo_inertia
from smsid.effects.payload import point_parameters

SURE = 4.0  # standard deviations beyond which a mass is not zero
SAME_PLACE = 1e-3  # probability above which two places may be one
MATRIX = ("xx", "xy", "yy", "xz", "yz", "zz")


@dataclass(frozen=True)
class Propellant:
    """Where a body holds propellant: effect, body and place (3,) in the body's joint frame [m]."""

    name: str
    body: str
    place: np.ndarray


def added_body(found: Explained, tanks: tuple[Propellant, ...] = ()) -> Finding:
    """Return a change of a link's ten parameters (10,) as a finding, with intervals.

    Centre and inertia about it follow from mass and moments to first order of their uncertainty. They are in
    the axes of the link's joint, whose origin the centre is from.
    """
    theta, covariance, told = found.values, found.covariance, found.told
    body = found.hypothesis.subject
    mass, sigma = float(theta[0]), float(np.sqrt(covariance[0, 0]))
    quantities = [FindingQuantity("mass", "kg", mass, sigma, bool(told[0]))]
    sure = bool(told[0]) and abs(mass) > SURE * sigma
    names = (*(f"first_moment.{a}" for a in "xyz"), *(f"inertia.{a}" for a in MATRIX))
    units = (*3 * ("kg m",), *6 * ("kg m^2",))
    for i, (name, unit) in enumerate(zip(names, units, strict=True), start=1):
        quantities.append(
            FindingQuantity(name, unit, float(theta[i]), float(np.sqrt(covariance[i, i])), bool(told[i]))
        )
    centre, spread = np.full(3, np.nan), np.full((3, 3), np.nan)
    if sure:
        centre, spread = _propagate(lambda x: x[1:4] / x[0], theta, covariance)
        central, wide = _propagate(
            lambda x: x[4:] - point_parameters(x[0], x[1:4] / x[0])[4:], theta, covariance
        )
        for k, axis in enumerate("xyz"):
            known = bool(told[0] and told[1 + k])
            quantities.append(
                FindingQuantity(f"centre.{axis}", "m", float(centre[k]), float(np.sqrt(spread[k, k])), known)
            )
        for k, axes in enumerate(MATRIX):
            known = bool(told[:4].all() and told[4 + k])
            spreads = float(np.sqrt(wide[k, k]))
            quantities.append(
                FindingQuantity(f"central_inertia.{axes}", "kg m^2", float(central[k]), spreads, known)
            )
    kind, text = _words(found, mass, sigma, sure, centre, spread, tanks)
    if sure and told.all() and not _may_exist(theta, covariance):
        text += ". No rigid body has these ten parameters: more has changed than this"
    return Finding(kind, body, text + ".", tuple(quantities), found.p_value, found.rivals)


def _words(
    found: Explained,
    mass: float,
    sigma: float,
    sure: bool,
    centre: np.ndarray,
    spread: np.ndarray,
    tanks: tuple[Propellant, ...],
) -> tuple[FindingKind, str]:
    body = found.hypothesis.subject
    rivals = f" (or on {', '.join(found.rivals)}: the data do not tell)" if found.rivals else ""
    if not sure:
        heavier = "" if found.told[0] else "; its mass by itself is not told"
        return "body_changed", f"The inertia of {body} has changed{rivals}{heavier}"
    size = f"{abs(mass):.4g} ± {1.96 * sigma:.2g} kg"
    known = found.told[1:4]
    where = ", ".join(
        f"{c:.3f} ± {1.96 * np.sqrt(s):.2g}" if k else "not told"
        for c, s, k in zip(centre, np.diag(spread), known, strict=True)
    )
    at = f"centre ({where}) m in the frame of its joint"
    if mass > 0.0:
        return "body_grasped", f"A body of {size} has been grasped by, or fixed to, {body}{rivals}: {at}"
    for tank in tanks:
        if tank.body == body and known.all():
            off = centre - tank.place
            if chi2.sf(float(off @ np.linalg.solve(spread, off)), 3) > SAME_PLACE:
                return "mass_left", f"{size} of fuel has been used from '{tank.name}': {at}"
    if any(t.body == body for t in tanks):
        return "mass_left", f"{size} has left {body}{rivals}, not from one tank alone: {at}"
    return "body_released", f"A body of {size} has been released from, or has left, {body}{rivals}: {at}"


def _propagate(
    function: Callable[[np.ndarray], np.ndarray], theta: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return a function of parameters (10,) and its covariance, to first order."""
    slope = slope_of(function, theta)
    return function(theta), slope @ covariance @ slope.T


def _may_exist(theta: np.ndarray, covariance: np.ndarray) -> bool:
    """Return whether a rigid body has these parameters (10,), or some within their uncertainty."""
    theta = theta * np.sign(theta[0])
    size, basis = np.linalg.eigh(pseudo_inertia(theta))
    worst = basis[:, 0]
    row = np.array([worst @ pseudo_inertia(unit) @ worst for unit in np.eye(10)])
    return bool(size[0] > -SURE * np.sqrt(row @ covariance @ row))
