"""Estimates made up from a known truth: base parameters of the paper's craft with a covariance, and draws."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from smsid.description import Description, load_description
from smsid.effects import GraspedBody
from smsid.identify.estimate import Estimate, classify
from smsid.identify.momentum_rows import carried_by_bus
from smsid.model import build_model
from smsid.model.identifiable import base_parameters
from smsid.model.regressor import Regressor

CRAFT = Path(__file__).resolve().parents[2] / "urdf" / "paper_sms.toml"
LINKS = ("joint1", "joint2", "joint3")
EFFECTS = {"tank.mass": 0.1, "tank.stiffness.x": 1e-3, "tank.damping.x": 1e-3, "panel.density": 3.0}


@cache
def craft() -> Description:
    return load_description(CRAFT)


@cache
def structure(tipwards: bool):
    """Return combinations (b, n) of the rigid bodies' parameters with names, columns and information."""
    model = build_model(craft())
    regressor = Regressor(model)
    bodies = [1, *(model.pin.getJointId(j) for j in LINKS)]
    columns = [10 * (j - 1) + i for j in bodies for i in range(10)]
    rng = np.random.default_rng(0)
    q = np.array([pin.integrate(model.pin, model.home, rng.normal(size=model.nv)) for _ in range(40)])
    v, a = 0.3 * rng.normal(size=(2, 40, model.nv))
    rows = regressor.torque(q, v, a)[:, :, columns].reshape(-1, len(columns))
    names = [regressor.names[c] for c in columns]
    units = [regressor.units[c] for c in columns]
    prefer = list(range(len(columns)))[::-1] if tipwards else ()
    base = base_parameters(rows, names, units, prefer=prefer)
    kept = rows[:, base.independent]
    return base, columns, kept.T @ kept


def whole(description: Description) -> np.ndarray:
    model = build_model(description)
    regressor = Regressor(model)
    return regressor.parameters + carried_by_bus(model, regressor)


def estimate(
    description: Description,
    rng: np.random.Generator | None = None,
    *,
    noise: float = 0.05,
    tipwards: bool = False,
    name: str = "flight",
) -> Estimate:
    """Return the estimate of a true spacecraft: exact without ``rng``, else a draw from its covariance."""
    base, columns, information = structure(tipwards)
    mean = [float(x) for x in base.matrix @ whole(description)[columns]]
    covariance = noise**2 * np.linalg.inv(information)
    parameters = {p.name: p for e in description.effect for p in e.parameters()}
    n, more = len(mean), len(EFFECTS)
    full = np.zeros((n + more, n + more))
    full[:n, :n] = covariance
    # effects' errors go together with those of the bodies, as in a real fit
    coupling = 0.1 * np.linalg.cholesky(covariance)[:, :more] @ np.diag(list(EFFECTS.values()))
    full[n:, n:] = np.diag([s**2 for s in EFFECTS.values()])
    full[:n, n:], full[n:, :n] = coupling, coupling.T
    mean += [parameters[k].value for k in EFFECTS]
    names = [*base.names, *EFFECTS]
    units = [*base.units, *(parameters[k].unit for k in EFFECTS)]
    values = np.array(mean)
    if rng is not None:
        values = values + np.linalg.cholesky(full) @ rng.normal(size=len(full))
    sigma = np.sqrt(np.diag(full))
    found = [
        classify(k, float(x), u, float(s), "maximum_likelihood")
        for k, x, u, s in zip(names, values, units, sigma, strict=True)
    ]
    return Estimate(description.name, "maximum_likelihood", tuple(found), (name,), covariance=full)


def grasped(mass: float, centre=(0.9, 0.15, -0.1), link: str = "link3") -> Description:
    """Return the craft with a box of a mass at the centre, in the axes of a link."""
    side = 0.3 * mass ** (1 / 3) * np.array([0.8, 1.0, 1.3])
    x, y, z = mass / 12.0 * side**2
    body = GraspedBody.model_validate(
        {"name": "target", "frame": link, "mass": mass, "centre": centre,
         "central_inertia": (y + z, 0.02 * x, x + z, 0.0, -0.01 * y, x + y)}
    )  # fmt: skip
    return craft().with_effects(body)
