"""What Exp. 2 found, as parameters with status."""

from __future__ import annotations

import numpy as np

from smsid.identify.estimate import AS_PRINTED, IDENTIFIABLE_BELOW, ParameterEstimate, classify
from smsid.identify.momentum_rows import carried_by_bus
from smsid.identify.paper._momentum_printed import printed_parameters
from smsid.identify.paper.hidden_states import HiddenStates
from smsid.identify.paper.momentum import StepA
from smsid.identify.paper.momentum_regression import Regression
from smsid.identify.paper.motion import MeasuredMotion
from smsid.identify.paper.pose_point import PosePoint
from smsid.identify.sensor_roles import Roles
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording


def of_pose_point(model: SpacecraftModel, recording: Recording, found: PosePoint) -> list[ParameterEstimate]:
    """Return the tracked point, ``pose_point.x`` and so on, from the bus origin [m]."""
    pose = Roles.of(model, recording).pose
    assert pose is not None
    size = float(np.linalg.norm(found.position))
    return [
        classify(
            f"pose_point.{axis}",
            found.position[k],
            "m",
            found.sigma[k],
            "exp2.pose_point",
            nominal=float(pose.position[k]),
            reference=size,
            note=f"bus frame; {found.rounds} rounds",
        )
        for k, axis in enumerate("xyz")
    ]


def of_step_a(a: StepA) -> list[ParameterEstimate]:
    """Return the system CM and the first moments of Step A."""
    size = float(np.linalg.norm(a.position))
    found = [
        classify(
            f"system_cm.{axis}",
            a.position[k],
            "m",
            a.position_sigma[k],
            "exp2.step_a",
            reference=size,
            note="inertial axes at the start, from the bus origin then",
        )
        for k, axis in enumerate("xyz")
    ]
    reg = a.moments
    return found + [
        classify(f"step A: {name}", value, unit, sigma, "exp2.step_a")
        for name, value, unit, sigma in zip(
            reg.base.names, reg.values, reg.base.units, reg.sigma, strict=True
        )
    ]


def of_step_b(model: SpacecraftModel, b: Regression) -> list[ParameterEstimate]:
    """Return the base parameters of Step B; nominal values are those of ``model``."""
    regressor = Regressor(model)
    theta = regressor.parameters + carried_by_bus(model, regressor)
    nominal = b.base.values(theta[[regressor.names.index(n) for n in b.theta_names]])
    return [
        classify(name, value, unit, sigma, "exp2.step_b", nominal=float(n), reference=ref)
        for name, value, unit, sigma, n, ref in zip(
            b.base.names, b.values, b.base.units, b.sigma, nominal, references(b, nominal), strict=True
        )
    ]


def of_printed(
    model: SpacecraftModel, motion: MeasuredMotion, hidden: HiddenStates, slosh_mass: float, b: Regression
) -> list[ParameterEstimate]:
    """Return pi_m of Step B as printed; nominal values have the m_s of ``model`` in their products.

    The names begin with "as printed: ": Step B with the slosh state finds combinations of the same terms.
    """
    nominal = b.base.values(printed_parameters(model, motion, hidden, slosh_mass))
    return [
        classify(
            f"{AS_PRINTED}{name}",
            value,
            unit,
            sigma,
            "exp2.step_b_printed",
            nominal=float(n),
            note="for comparison; sigma includes the bias that noise in products gives total least squares",
        )
        for name, value, unit, sigma, n in zip(
            b.base.names, b.values, b.base.units, b.sigma, nominal, strict=True
        )
    ]


def references(b: Regression, nominal: np.ndarray | None = None) -> list[float | None]:
    """Return what a small parameter is judged against: the largest of its kind on its body, else None.

    Small: ``share`` of the measured momentum (column norm times value) below 1 %. What is not known itself
    counts with its ``nominal`` value (b,), if that is smaller: no measure for others is what noise made of
    it.
    """
    kinds = [kind_of(name) for name in b.base.names]
    sizes = np.abs(b.values)
    if nominal is not None:
        known = b.sigma < IDENTIFIABLE_BELOW * sizes
        sizes = np.where(known, sizes, np.minimum(sizes, np.abs(nominal)))
    out: list[float | None] = []
    for i, kind in enumerate(kinds):
        if b.shares[i] >= 0.01:
            out.append(None)
        else:
            out.append(float(max(v for v, other in zip(sizes, kinds, strict=True) if other == kind)))
    return out


def kind_of(name: str) -> tuple[str, str]:
    """Return body and kind (mass, first moment, inertia) of a base parameter, from its leading term."""
    body, symbol = name.split(" ", 1)[0].rsplit(".", 1)
    return body, {"m": "mass"}.get(symbol, "inertia" if symbol.startswith("I") else "moment")
