"""Exp. 2: momentum of the free-floating spacecraft, linear in inertial parameters.

Step A, (33)-(37): the inertial position of the system CM and the first moments of the links, from the
velocity of P. Step B, (38)-(39): inertias from the conserved angular momentum. Here the slosh state is put
back in, so both are linear in ordinary inertial parameters; ``_momentum_printed.py`` has Step B as printed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid.errors import NotIdentifiableError
from smsid.identify.momentum_rows import ParameterSplit, carried_by_bus, first_moments, skew
from smsid.identify.paper.hidden_states import HiddenStates
from smsid.identify.paper.momentum_regression import BLOCK, Regression, regress
from smsid.identify.paper.motion import MeasuredMotion
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel

AXES = ("x", "y", "z")


@short_repr
@dataclass(frozen=True)
class StepA:
    """Result of Step A.

    ``velocity`` (3,) and ``position`` (3,) of the system CM at the first sample, inertial axes, from the
    inertial origin [m/s, m]; ``moments``: identifiable first moments of the links [kg m].
    """

    velocity: np.ndarray
    position: np.ndarray
    position_sigma: np.ndarray
    moments: Regression


def full_states(
    model: SpacecraftModel, motion: MeasuredMotion, hidden: HiddenStates
) -> tuple[np.ndarray, np.ndarray]:
    """Return q (N, nq), v (N, nv) of the model with measured motion and estimated hidden states."""
    q, v = motion.states(model)
    for joint in model.slosh:
        if joint.name in hidden.slosh:
            q[:, joint.q], v[:, joint.v] = hidden.slosh[joint.name]
    for panel in model.appendages:
        state = hidden.modes.get(panel.appendage.name)
        if state is None:
            continue
        for k, j in enumerate(panel.joints):
            q[:, model.pin.joints[j].idx_q] = state.position[:, k] / panel.scale[k]
            v[:, model.pin.joints[j].idx_v] = state.velocity[:, k] / panel.scale[k]
    return q, v


def step_a(model: SpacecraftModel, motion: MeasuredMotion, hidden: HiddenStates, mass: float) -> StepA:
    """Estimate the CM's position and the links' first moments from (34)-(37), total mass ``mass`` [kg] given.

    Without slosh in ``hidden`` this is (34) as printed, which neglects m_s rho' / M. Errors of a row are as
    large as ``motion.again`` shows them: nearly all are those of the velocity of P, and total least squares
    that takes all columns for equally uncertain comes out 1 % too large. Raises `NotIdentifiableError` when
    joints or bus do not move enough.
    """
    regressor = Regressor(model)
    parts = ParameterSplit.of(model, regressor, bus_first=False)
    start = float(motion.time[0])

    def equations(part: MeasuredMotion, states: HiddenStates) -> tuple[np.ndarray, np.ndarray]:
        return rows_a(model, regressor, parts, part, states, mass, start)

    labels = [f"{what}.{axis}" for what in ("v_cm", "r_cm") for axis in AXES]
    moments, found = regress(motion, hidden, equations, parts.names, parts.units, labels)
    return StepA(found.x[-6:-3], found.x[-3:], found.standard_deviation[-3:], moments)


def rows_a(
    model: SpacecraftModel,
    regressor: Regressor,
    parts: ParameterSplit,
    motion: MeasuredMotion,
    hidden: HiddenStates,
    mass: float,
    start: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Step A's equations: sought parameters, CM velocity and position (N, 3, n + 6), right-hand side (N, 3).

    The CM of (33) is ``r_cm + v_cm (t - start)``: the print takes r_cm for constant, which it is only while
    v_cm is zero. ``start`` [s] is where r_cm is meant.
    """
    q, v = full_states(model, motion, hidden)
    v[:, :6] = 0.0  # the momentum of the links relative to the bus is the rate of their first moments
    y = regressor.momentum(q, v)[:, :3]
    to_body = motion.rotation.transpose(0, 2, 1)
    position = np.einsum("nij,nj->ni", to_body, motion.position)
    known = y[:, :, parts.known] @ regressor.parameters[parts.known]
    turning = -skew(motion.rate) @ to_body
    elapsed = (motion.time - start)[:, None, None]
    columns = [-y[:, :, parts.unknown] / mass, to_body + elapsed * turning, turning]
    seen = motion.velocity - np.cross(motion.rate, position)
    return np.concatenate(columns, axis=2), seen + known / mass


def step_b(
    model: SpacecraftModel, motion: MeasuredMotion, hidden: HiddenStates, mass: float, centre: np.ndarray
) -> Regression:
    """Estimate the inertial parameters of bus and links from (38)-(39) with the slosh state put back in.

    Total mass ``mass`` [kg] from Exp. 1 and the CM ``centre`` (3,) [m, inertial] from Step A. The equations,
    per sample: the angular momentum about the CM is zero, and the CM (6) is where Step A found it (its offset
    is left free). Taken about the CM, errors of the measured velocity cancel. Wheels, slosh and modes are
    known and go to the right-hand side. Errors of a row are as large, and go together, as ``motion.again``
    and ``hidden.again`` show them, if they are there. In the result "bus" includes its wheels and undeformed
    appendages (`carried_by_bus`).

    Raises `NotIdentifiableError` when no known momentum is exchanged.
    """
    regressor = Regressor(model)
    parts = ParameterSplit.of(model, regressor, bus_first=True)
    _check_exchange(model, regressor, parts, motion, hidden)

    def equations(part: MeasuredMotion, states: HiddenStates) -> tuple[np.ndarray, np.ndarray]:
        return rows_b(model, regressor, parts, part, states, mass, centre)

    labels = [f"r_cm.{axis}" for axis in AXES]
    found, _ = regress(motion, hidden, equations, parts.names, parts.units, labels, reweight=True)
    carried = found.base.matrix @ carried_by_bus(model, regressor)[parts.unknown]
    return replace(found, solution=replace(found.solution, x=found.solution.x + carried))


def thinned(motion: MeasuredMotion, hidden: HiddenStates) -> tuple[MeasuredMotion, HiddenStates]:
    """Return at most `BLOCK` samples, evenly spread over a motion: enough to see what moves in it."""
    every = slice(None, None, -(-len(motion) // BLOCK))
    return motion.only(every), hidden.only(every)


def _check_exchange(
    model: SpacecraftModel,
    regressor: Regressor,
    parts: ParameterSplit,
    motion: MeasuredMotion,
    hidden: HiddenStates,
) -> None:
    """Raise `NotIdentifiableError` when what is known carries no angular momentum."""
    y = regressor.momentum(*full_states(model, *thinned(motion, hidden)))[:, 3:]
    if np.linalg.norm(y[:, :, parts.known] @ regressor.parameters[parts.known]) < 1e-9:
        raise NotIdentifiableError(
            "No known momentum is exchanged: wheels, slosh and panel stay still, so inertias are known "
            "only up to a common factor.",
            advice="Spin a wheel of known inertia during Exp. 2.",
        )


def rows_b(
    model: SpacecraftModel,
    regressor: Regressor,
    parts: ParameterSplit,
    motion: MeasuredMotion,
    hidden: HiddenStates,
    mass: float,
    centre: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Step B's equations: sought parameters and CM offset (N, 6, n + 3), right-hand side (N, 6).

    Three of momentum, three of place.
    """
    n = len(motion)
    q, v = full_states(model, motion, hidden)
    theta = regressor.parameters
    y = regressor.momentum(q, v)
    rotated = motion.rotation.transpose(0, 2, 1)
    cm = np.einsum("nij,nj->ni", rotated, centre - motion.position) + motion.pose_point  # from the bus origin
    equations = np.concatenate([y[:, 3:] - skew(cm) @ y[:, :3], first_moments(model, regressor, q)], axis=1)
    # the bus' mass is what the others leave of M
    bus = regressor.names.index(f"{regressor.bodies[0]}.m")
    rest = mass - theta[[i for i in parts.known if regressor.names[i].endswith(".m")]].sum()
    free = equations[:, :, parts.unknown].copy()
    for k, i in enumerate(parts.unknown):
        if regressor.names[i].endswith(".m"):
            free[:, :, k] -= equations[:, :, bus]
    rhs = -(equations[:, :, parts.known] @ theta[parts.known]) - equations[:, :, bus] * rest
    rhs[:, 3:] += mass * cm
    offset = mass * np.concatenate([np.zeros((n, 3, 3)), -rotated], axis=1)
    return np.concatenate([free, offset], axis=2), rhs
