"""Step B as printed, (38)-(39): slosh eliminated by the CM (6) and the linear momentum (29).

With everything but the slosh mass ("the rest") having first moments S about the bus origin, momentum P and
angular momentum h about the bus origin, eliminating r_s and v_s from (28) at zero momentum gives, in bus
axes,

    h + (S - M c) x P / m_s = 0,   P = (M - m_s) v + w x S + S',

c the CM seen from the bus origin, known from Step A. S and S' are linear in first moments phi, so the product
holds phi_i phi_j / m_s: those products are the entries of pi_m that the paper does not list.
"""

from __future__ import annotations

import numpy as np

from smsid.errors import NotIdentifiableError
from smsid.identify.momentum import HiddenStates, Regression, full_states
from smsid.identify.momentum_rows import Split, first_moments, scaled_tls, skew
from smsid.identify.motion import Motion
from smsid.model.identifiable import base_parameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel


def step_b_printed(
    model: SpacecraftModel,
    motion: Motion,
    hidden: HiddenStates,
    mass: float,
    slosh_mass: float,
    centre: np.ndarray,
) -> Regression:
    """Estimate pi_m of (38)-(39): inertial parameters and products of first moments over m_s.

    ``hidden`` needs the modal states only. ``mass`` M and ``slosh_mass`` m_s [kg] from Exp. 1, ``centre``
    (3,) the inertial CM from Step A [m]. Names of products read ``(a)*(b)/m_s``.

    Raises `NotIdentifiableError` unless there is one tank.
    """
    if len(model.slosh) != 1:
        raise NotIdentifiableError(
            f"Step B as printed needs one slosh mass, '{model.description.name}' has {len(model.slosh)}.",
            advice="Use Step B with the slosh state.",
        )
    design = printed_regressor(model, motion, hidden, mass, slosh_mass, centre)
    columns, rhs, names, units = design
    base = base_parameters(columns, names, units)
    solution = scaled_tls(columns[:, base.independent], rhs, base.names, motion)
    return Regression(base, solution, names)


def printed_parameters(
    model: SpacecraftModel, motion: Motion, hidden: HiddenStates, slosh_mass: float
) -> np.ndarray:
    """Return the description's values (k,) of the parameters behind `step_b_printed`, products included."""
    regressor = Regressor(model)
    theta = regressor.parameters
    parts = Split.of(model, regressor, bus_first=True)
    q, _ = full_states(model, motion, hidden)
    phi, _, _ = _moment_basis(model, regressor, q)
    values = phi.matrix @ theta[_moment_parameters(model, regressor)]
    i, j = np.triu_indices(len(values))
    return np.concatenate([theta[parts.unknown], values[i] * values[j] / slosh_mass])


def printed_regressor(
    model: SpacecraftModel,
    motion: Motion,
    hidden: HiddenStates,
    mass: float,
    slosh_mass: float,
    centre: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...], tuple[str, ...]]:
    """Return Y (3 N, k), b (3 N,), names and units of pi_m."""
    regressor = Regressor(model)
    n = len(motion)
    q, v = full_states(model, motion, hidden)
    theta = regressor.parameters
    parts = Split.of(model, regressor, bus_first=True)
    tank = {model.slosh[0].name}
    body = [name.rsplit(".", 1)[0] for name in regressor.names]
    rest_known = [i for i in parts.known if body[i] not in tank]
    kind = [name.rsplit(".", 1)[1] for name in regressor.names]
    bus_mass = regressor.names.index(f"{regressor.bodies[0]}.m")
    rest_mass = mass - theta[[i for i in parts.known if kind[i] == "m"]].sum()

    y = regressor.momentum(q, v)
    moved = v.copy()
    moved[:, 0:3] = 0.0
    # momentum of the rest without its translation: w x S + S'
    carried = regressor.momentum(q, moved)[:, :3]
    moments = first_moments(model, regressor, q)
    phi, chosen, _ = _moment_basis(model, regressor, q)
    s_free, p_free = (
        moments[:, :, chosen][:, :, phi.independent],
        carried[:, :, chosen][:, :, phi.independent],
    )
    s_known, p_known = (
        moments[:, :, rest_known] @ theta[rest_known],
        carried[:, :, rest_known] @ theta[rest_known],
    )

    rotated = motion.rotation.transpose(0, 2, 1)
    cm = np.einsum("nij,nj->ni", rotated, centre - motion.position) + motion.pose_point
    arm = s_known - mass * cm
    momentum = (mass - slosh_mass) * v[:, 0:3] + p_known
    # linear in phi: S_free x momentum + arm x P_free
    linear = (skew(arm) @ p_free - skew(momentum) @ s_free) / slosh_mass
    spin = y[:, 3:]
    free = spin[:, :, parts.unknown].copy()
    for k, i in enumerate(parts.unknown):
        if kind[i] == "m":
            free[:, :, k] -= spin[:, :, bus_mass]
    expand = phi.matrix[:, [chosen.index(i) if i in chosen else -1 for i in parts.unknown]]
    expand = expand * np.array([i in chosen for i in parts.unknown])
    free = free + linear @ expand
    i, j = np.triu_indices(len(phi))
    products = np.cross(s_free[:, :, i], p_free[:, :, j], axis=1) + np.where(
        i == j, 0.0, np.cross(s_free[:, :, j], p_free[:, :, i], axis=1)
    )
    columns = np.concatenate([free, products], axis=2).reshape(3 * n, -1)
    known = spin[:, :, rest_known] @ theta[rest_known] + spin[:, :, bus_mass] * rest_mass
    rhs = -(known + np.cross(arm, momentum) / slosh_mass).reshape(-1)
    names = parts.names + tuple(f"({phi.names[a]})*({phi.names[b]})/m_s" for a, b in zip(i, j, strict=True))
    units = parts.units + ("kg m^2",) * len(i)
    return columns, rhs, names, units


def _moment_parameters(model: SpacecraftModel, regressor: Regressor) -> list[int]:
    """Masses of links and first moments of bus and links."""
    parts = Split.of(model, regressor, bus_first=True)
    return [i for i in parts.unknown if regressor.names[i].rsplit(".", 1)[1] in ("m", "mx", "my", "mz")]


def _moment_basis(model: SpacecraftModel, regressor: Regressor, q: np.ndarray):
    chosen = _moment_parameters(model, regressor)
    rows = first_moments(model, regressor, q)[:, :, chosen].reshape(-1, len(chosen))
    names, units = [regressor.names[i] for i in chosen], [regressor.units[i] for i in chosen]
    return base_parameters(rows, names, units), chosen, rows
