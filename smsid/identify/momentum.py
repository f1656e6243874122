"""Exp. 2: momentum of the free-floating spacecraft, linear in inertial parameters.

Step A, (33)-(37): the inertial position of the system CM and the first moments of the links, from the
velocity of P. Step B, (38)-(39): inertias from the conserved angular momentum. Here the slosh state is put
back in, so both are linear in ordinary inertial parameters; ``momentum_printed.py`` has Step B as printed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify.modal_state import ModalState
from smsid.identify.momentum_rows import (
    Split,
    carried_by_bus,
    first_moments,
    scaled_tls,
    select_unknowns,
    skew,
)
from smsid.identify.motion import Motion
from smsid.identify.tls import TlsSolution
from smsid.model.identifiable import BaseParameters, base_parameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel


@short_repr
@dataclass(frozen=True)
class HiddenStates:
    """What Exp. 2 does not measure, estimated: slosh by tank, modes by appendage.

    ``slosh`` holds (rho, rho') each (N, 3) bus axes, ``modes`` a `ModalState` each. ``again``: the same from
    the motion with as much noise once more, where there is one.
    """

    slosh: dict[str, tuple[np.ndarray, np.ndarray]]
    modes: dict[str, ModalState]
    again: HiddenStates | None = None

    def without_slosh(self) -> HiddenStates:
        """Return the modes alone: the slosh at rest, as (34) takes it."""
        return HiddenStates({}, self.modes, self.again.without_slosh() if self.again else None)


@short_repr
@dataclass(frozen=True)
class Regression:
    """Base parameters of a linear regression and their total-least-squares estimate.

    ``shares`` (b,): norm of each column times its value, relative to the norm of the measured momentum.
    """

    base: BaseParameters
    solution: TlsSolution
    theta_names: tuple[str, ...]
    shares: np.ndarray | None = None

    @property
    def values(self) -> np.ndarray:
        """Estimated base parameters (b,)."""
        return self.solution.x

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations (b,)."""
        return self.solution.standard_deviation


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


NOTHING = BaseParameters((), (), np.zeros(0, dtype=int), np.zeros((0, 0)), (), 1.0)
"""The base parameters of a spacecraft without arms in Step A."""


def full_states(
    model: SpacecraftModel, motion: Motion, hidden: HiddenStates
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


def step_a(model: SpacecraftModel, motion: Motion, hidden: HiddenStates, mass: float) -> StepA:
    """Estimate the CM's position and the links' first moments from (34)-(37), total mass ``mass`` [kg] given.

    Without slosh in ``hidden`` this is (34) as printed, which neglects m_s rho' / M. Errors of a row are as
    large as ``motion.again`` shows them: nearly all are those of the velocity of P, and total least squares
    that takes all columns for equally uncertain comes out 1 % too large. Raises `NotIdentifiableError` when
    joints or bus do not move enough.
    """
    regressor = Regressor(model)
    parts = Split.of(model, regressor, bus_first=False)

    full, rhs = rows_a(model, regressor, parts, motion, hidden, mass)
    base = NOTHING
    if parts.unknown:
        base = base_parameters(full[:, :, 6:].reshape(-1, len(parts.unknown)), parts.names, parts.units)
    labels = ["v_cm.x", "v_cm.y", "v_cm.z", "r_cm.x", "r_cm.y", "r_cm.z", *base.names]
    kept = [*range(6), *(6 + i for i in base.independent)]

    def stacked(full: np.ndarray, rhs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return full[:, :, kept].reshape(-1, len(kept)), rhs.reshape(-1)

    again = None
    if motion.again:
        other = hidden.again or hidden
        again = stacked(*rows_a(model, regressor, parts, motion.again, other, mass))
    found = scaled_tls(*stacked(full, rhs), labels, motion, again=again)
    return StepA(
        velocity=found.x[:3],
        position=found.x[3:6],
        position_sigma=found.standard_deviation[3:6],
        moments=Regression(base, select_unknowns(found, slice(6, None)), parts.names),
    )


def rows_a(
    model: SpacecraftModel,
    regressor: Regressor,
    parts: Split,
    motion: Motion,
    hidden: HiddenStates,
    mass: float,
    start: float | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Step A's equations: CM velocity, CM position and sought parameters (N, 3, 6 + n), right-hand side.

    The CM of (33) is ``r_cm + v_cm (t - start)``: the print takes r_cm for constant, which it is only while
    v_cm is zero. ``start`` [s] is where r_cm is meant (default: the first sample).
    """
    q, v = full_states(model, motion, hidden)
    v[:, :6] = 0.0  # the momentum of the links relative to the bus is the rate of their first moments
    y = regressor.momentum(q, v)[:, :3]
    to_body = motion.rotation.transpose(0, 2, 1)
    position = np.einsum("nij,nj->ni", to_body, motion.position)
    known = y[:, :, parts.known] @ regressor.parameters[parts.known]
    turning = -skew(motion.rate) @ to_body
    elapsed = motion.time - (motion.time[0] if start is None else start)
    columns = [to_body + elapsed[:, None, None] * turning, turning, -y[:, :, parts.unknown] / mass]
    seen = motion.velocity - np.cross(motion.rate, position)
    return np.concatenate(columns, axis=2), seen + known / mass


def step_b(
    model: SpacecraftModel,
    motion: Motion,
    hidden: HiddenStates,
    mass: float,
    centre: np.ndarray,
    *,
    prior: tuple[np.ndarray, np.ndarray] | None = None,
) -> Regression:
    """Estimate the inertial parameters of bus and links from (38)-(39) with the slosh state put back in.

    Total mass ``mass`` [kg] from Exp. 1 and the CM ``centre`` (3,) [m, inertial] from Step A. The equations,
    per sample: the angular momentum about the CM is zero, and the CM (6) is where Step A found it (its offset
    is left free). Taken about the CM, errors of the measured velocity cancel. Wheels, slosh and modes are
    known and go to the right-hand side. Errors of a row are as large, and go together, as ``motion.again``
    and ``hidden.again`` show them, if they are there. ``prior`` (mean (b,), covariance (b, b)) of the base
    parameters enters through recursive TLS. In the result, and in the prior, "bus" includes its wheels and
    undeformed appendages (`carried_by_bus`).

    Raises `NotIdentifiableError` when no known momentum is exchanged, `SmsidError` for a prior that does not
    fit the base parameters of this motion.
    """
    regressor = Regressor(model)
    n = len(motion)
    parts = Split.of(model, regressor, bus_first=True)
    full, rhs = rows_b(model, regressor, parts, motion, hidden, mass, centre)
    count = len(parts.names)
    both = np.concatenate([full[:, :3, :count].reshape(3 * n, -1), full[:, 3:, :count].reshape(3 * n, -1)])
    base = base_parameters(both, parts.names, parts.units)
    kept = [*base.independent, *range(count, count + 3)]

    def stacked(full: np.ndarray, rhs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return full[:, :, kept].reshape(6 * n, -1), rhs.reshape(-1)

    columns, target = stacked(full, rhs)
    again = None
    if motion.again is not None:
        other = hidden.again or hidden
        again = stacked(*rows_b(model, regressor, parts, motion.again, other, mass, centre))
    labels = [*base.names, "r_cm.x", "r_cm.y", "r_cm.z"]
    carried = base.matrix @ carried_by_bus(model, regressor)[parts.unknown]
    if prior is not None:
        prior = _with_offset(prior, carried, base)
    weights = np.ones(6 * n)
    found = None
    for k in range(2):  # weigh the two kinds of equation by what they leave
        found = scaled_tls(
            columns, target, labels, motion, weights=weights, prior=prior if k else None, again=again
        )
        left = (target - columns @ found.x).reshape(n, 6)
        size = np.sqrt(np.mean(left**2, axis=0))
        weights = np.tile(1.0 / np.maximum(size, 1e-9 * size.max()), n)
    assert found is not None
    size = np.linalg.norm(full[:, :3, base.independent], axis=(0, 1)) * np.abs(found.x[: len(base)])
    shares = size / np.linalg.norm(rhs[:, :3])
    solution = select_unknowns(found, slice(0, len(base)))
    solution = replace(solution, x=solution.x + carried)
    return Regression(base, solution, parts.names, shares)


def rows_b(
    model: SpacecraftModel,
    regressor: Regressor,
    parts: Split,
    motion: Motion,
    hidden: HiddenStates,
    mass: float,
    centre: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Step B's equations: sought parameters and CM offset (N, 6, n + 3), right-hand side (N, 6).

    Three of momentum, three of place.

    Raises `NotIdentifiableError` when no known momentum is exchanged.
    """
    n = len(motion)
    q, v = full_states(model, motion, hidden)
    theta = regressor.parameters
    y = regressor.momentum(q, v)
    if np.linalg.norm(y[:, 3:][:, :, parts.known] @ theta[parts.known]) < 1e-9:
        raise NotIdentifiableError(
            "No known momentum is exchanged: wheels, slosh and panel stay still, so inertias are known "
            "only up to a common factor.",
            advice="Spin a wheel of known inertia during Exp. 2.",
        )
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


def _with_offset(
    prior: tuple[np.ndarray, np.ndarray], carried: np.ndarray, base: BaseParameters
) -> tuple[np.ndarray, np.ndarray]:
    """Add the CM's offset, unknown within a kilometre, to a prior of the base parameters."""
    mean, covariance = np.asarray(prior[0], dtype=float), np.asarray(prior[1], dtype=float)
    if mean.shape != (len(base),) or covariance.shape != (len(base), len(base)):
        raise SmsidError(
            f"The prior has mean {mean.shape} and covariance {covariance.shape}; this motion has {len(base)} "
            "base parameters.",
            advice="Take the prior from the same spacecraft moving the same joints.",
            names=base.names,
        )
    out = np.zeros((len(base) + 3, len(base) + 3))
    out[:-3, :-3], out[-3:, -3:] = covariance, 1e6 * np.eye(3)
    return np.concatenate([mean - carried, np.zeros(3)]), out
