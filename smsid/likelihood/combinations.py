"""What is reported: parameters by name, as functions of the parameter vector with their gradients.

Inertias are reported as the base parameters of Step B (`smsid.identify.step_b`), by the same names: total
mass given, the combinations that angular momentum about the CM and the place of the CM depend on; "bus"
includes its wheels and undeformed appendages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.identify.momentum_rows import ParameterSplit, carried_matrix, first_moments, skew
from smsid.identify.paper.exp2_result import kind_of
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction
from smsid.likelihood.pseudo_inertia import SIZE
from smsid.model.identifiable import BaseParameters, base_parameters
from smsid.model.regressor import Regressor

SAMPLES = 300  # of a motion, from which the identifiable combinations are read
SMALL = 0.01  # share of the momentum below which a parameter is judged against its peers


@dataclass(frozen=True)
class Combination:
    """A reported parameter: value, its gradient by the step of the parameters (size,), and what describes it.

    ``reference`` is what a small value is judged against, else None.
    """

    name: str
    unit: str
    value: float
    gradient: np.ndarray
    nominal: float
    reference: float | None = None


def effects_and_mass(at: Parameters, described: Parameters) -> list[Combination]:
    """Return total mass, slosh, densities and modes, named as the linear method names them."""
    masses = np.arange(0, len(at.layout.fixed), SIZE)
    gradient = at.theta_jacobian()[masses].sum(axis=0)
    nominal = float(described.theta()[masses].sum())
    found = [Combination("total.mass", "kg", float(at.theta()[masses].sum()), gradient, nominal)]
    parts = {a.appendage.name: a.appendage for a in at.layout.model.appendages}
    for k, s in enumerate(at.scalars, start=at.inertias.size):
        own = np.zeros(at.size)
        own[k] = s.slope
        if s.name.endswith(".density_factor"):
            part = parts[s.name.removesuffix(".density_factor")]
            p = part.mass_parameter()
            found.append(Combination(p.name, p.unit, s.value * p.value, own * p.value, s.reference * p.value))
        else:
            found.append(Combination(s.name, s.unit, s.value, own, s.reference))
    return found


def inertial(
    at: Parameters, described: Parameters, predictions: Sequence[Prediction], *, translation: bool = True
) -> tuple[list[Combination], BaseParameters | None, tuple[str, ...]]:
    """Return the identifiable inertial combinations of free-floating motions, their base and its columns.

    Without ``translation`` nothing measures where the spacecraft is or how it accelerates, and mass and
    centre of mass show in nothing: the angular momentum about it alone tells combinations apart. Of a lone
    bus these are the inertias about its centre of mass, ``bus.Icxx``.
    """
    if not predictions:
        return [], None, ()
    model = at.layout.model
    regressor = Regressor(model)
    theta, jacobian = at.theta(), at.theta_jacobian()
    parts = ParameterSplit.of(model, regressor, bus_first=True)
    bus = regressor.names.index(f"{regressor.bodies[0]}.m")
    if not translation:
        columns = [bus, *parts.unknown]
        names, units = ([every[i] for i in columns] for every in (regressor.names, regressor.units))
        parts = replace(parts, unknown=columns, names=tuple(names), units=tuple(units))
    total = float(theta[::SIZE].sum())
    rows, spins, known = [], [], []
    for prediction in predictions:
        q, v = prediction.q, prediction.v
        chosen = np.unique(np.linspace(0, len(q) - 1, SAMPLES).astype(int))
        y = regressor.momentum(q[chosen], v[chosen])
        moments = first_moments(model, regressor, q[chosen])
        cm = moments @ theta / total
        spin = y[:, 3:] - skew(cm) @ y[:, :3]
        for full in (spin, moments) if translation else (spin,):
            free = full[:, :, parts.unknown].copy()
            for k, i in enumerate(parts.unknown):
                if translation and regressor.names[i].endswith(".m"):  # the total mass is told
                    free[:, :, k] -= full[:, :, bus]
            rows.append(free.reshape(-1, len(parts.unknown)))
            if full is spin:
                spins.append(rows[-1])
        known.append((spin[:, :, parts.known] @ theta[parts.known]).ravel())
    own = {f"{regressor.bodies[0]}.{x}" for x in ("m", "mx", "my", "mz")}  # lumped where they are not told
    prefer = () if translation else [i for i, name in enumerate(parts.names) if name not in own]
    base = base_parameters(np.vstack(rows), parts.names, parts.units, prefer=prefer)
    to_bus = carried_matrix(model, regressor)
    matrix = base.matrix @ (np.eye(len(theta)) + to_bus)[parts.unknown]
    values, nominal = matrix @ theta, matrix @ described.theta()
    sizes = np.linalg.norm(np.vstack(spins)[:, base.independent], axis=0) * np.abs(values)
    # without wheels, slosh and modes no momentum is known: judged against the largest share of it
    shares = sizes / (float(np.linalg.norm(np.concatenate(known))) or float(sizes.max()))
    kinds = [kind_of(name) for name in base.names]
    found = []
    for i, name in enumerate(base.names if translation else _about_centre(base.names, parts.names)):
        reference = None
        if shares[i] < SMALL:
            reference = max(abs(x) for x, other in zip(values, kinds, strict=True) if other == kinds[i])
        found.append(
            Combination(
                name,
                base.units[i],
                float(values[i]),
                matrix[i] @ jacobian,
                float(nominal[i]),
                None if reference is None else float(reference),
            )
        )
    return found, base, parts.names


def _about_centre(combinations: Sequence[str], names: Sequence[str]) -> Sequence[str]:
    """Return the names of inertias of a lone bus, its ``names`` (10,), with mass and first moments lumped."""
    leads = [name.split(" ")[0] for name in combinations]
    if len(names) > SIZE or any(".I" not in lead for lead in leads):
        return combinations
    return [lead.replace(".I", ".Ic") for lead in leads]
