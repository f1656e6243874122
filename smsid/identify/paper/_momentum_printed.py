"""Step B as printed, (38)-(39): slosh eliminated by the CM (6) and the linear momentum (29).

With everything but the slosh mass ("the rest") having first moments S about the bus origin, momentum P and
angular momentum h about the bus origin, eliminating r_s and v_s from (28) at zero momentum gives, in bus
axes,

    h + (S - M c) x P / m_s = 0,   P = (M - m_s) v + w x S + S',

c the CM seen from the bus origin, known from Step A. S and S' are linear in first moments phi, so the product
holds phi_i phi_j / m_s: those products are the entries of pi_m that the paper does not list.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from smsid.errors import NotIdentifiableError
from smsid.identify.momentum_rows import ParameterSplit, first_moments, skew
from smsid.identify.paper.hidden_states import HiddenStates
from smsid.identify.paper.momentum import full_states, thinned
from smsid.identify.paper.momentum_regression import Regression, regress
from smsid.identify.paper.motion import MeasuredMotion
from smsid.model.identifiable import BaseParameters, base_parameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel


def step_b_printed(
    model: SpacecraftModel,
    motion: MeasuredMotion,
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
    terms = PrintedTerms.of(model, motion, hidden)

    def equations(part: MeasuredMotion, states: HiddenStates) -> tuple[np.ndarray, np.ndarray]:
        return terms.rows(part, states, mass, slosh_mass, centre)

    found, _ = regress(replace(motion, again=None), hidden, equations, terms.names, terms.units)
    return found


def printed_parameters(
    model: SpacecraftModel, motion: MeasuredMotion, hidden: HiddenStates, slosh_mass: float
) -> np.ndarray:
    """Return the description's values (k,) of the parameters behind `step_b_printed`, products included."""
    terms = PrintedTerms.of(model, motion, hidden)
    theta = terms.regressor.parameters
    values = terms.moments.matrix @ theta[terms.chosen]
    i, j = np.triu_indices(len(values))
    return np.concatenate([theta[terms.parts.unknown], values[i] * values[j] / slosh_mass])


@dataclass(frozen=True)
class PrintedTerms:
    """What pi_m consists of: parameters of bus and links, and products of first moments over m_s.

    ``moments`` are the first moments that the motion tells apart, combinations of the ``chosen`` parameters:
    masses of links and first moments of bus and links.
    """

    model: SpacecraftModel
    regressor: Regressor
    parts: ParameterSplit
    chosen: list[int]
    moments: BaseParameters

    @classmethod
    def of(cls, model: SpacecraftModel, motion: MeasuredMotion, hidden: HiddenStates) -> PrintedTerms:
        """Return the terms that a motion tells apart."""
        regressor = Regressor(model)
        parts = ParameterSplit.of(model, regressor, bus_first=True)
        kinds = ("m", "mx", "my", "mz")
        chosen = [i for i in parts.unknown if regressor.names[i].rsplit(".", 1)[1] in kinds]
        q, _ = full_states(model, *thinned(motion, hidden))
        rows = first_moments(model, regressor, q)[:, :, chosen].reshape(-1, len(chosen))
        names, units = [regressor.names[i] for i in chosen], [regressor.units[i] for i in chosen]
        return cls(model, regressor, parts, chosen, base_parameters(rows, names, units))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of pi_m (k,)."""
        a, phi = np.triu_indices(len(self.moments)), self.moments.names
        return self.parts.names + tuple(f"({phi[i]})*({phi[j]})/m_s" for i, j in zip(*a, strict=True))

    @property
    def units(self) -> tuple[str, ...]:
        """Units of pi_m (k,)."""
        return self.parts.units + ("kg m^2",) * (len(self.names) - len(self.parts.names))

    def rows(
        self, motion: MeasuredMotion, hidden: HiddenStates, mass: float, slosh_mass: float, centre: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Y (N, 3, k) and b (N, 3) of pi_m, arguments as those of `step_b_printed`."""
        model, regressor, parts = self.model, self.regressor, self.parts
        chosen, phi = self.chosen, self.moments
        q, v = full_states(model, motion, hidden)
        theta = regressor.parameters
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
        columns = np.concatenate([free, products], axis=2)
        known = spin[:, :, rest_known] @ theta[rest_known] + spin[:, :, bus_mass] * rest_mass
        return columns, -(known + np.cross(arm, momentum) / slosh_mass)
