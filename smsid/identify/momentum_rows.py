"""What the regressions of Exp. 2 share: which parameters are sought, and first moments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.effects.inertial_parameters import move_parameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel

CORRELATION_TIME = 2.0  # [s] over which equation errors are taken as correlated


def carried_by_bus(model: SpacecraftModel, regressor: Regressor) -> np.ndarray:
    """Return the inertial parameters (10 bodies,) that wheels and undeformed appendages add to the bus.

    With them "bus" means everything that is rigid with it while nothing turns or bends; how the model splits
    an appendage into modes and remainder does not show.
    """
    return carried_matrix(model, regressor) @ regressor.parameters


def whole_bodies(model: SpacecraftModel) -> np.ndarray:
    """Return the inertial parameters (10 bodies,), the bus with its wheels and undeformed appendages."""
    regressor = Regressor(model)
    return regressor.parameters + carried_by_bus(model, regressor) if model.free else regressor.parameters


def carried_matrix(model: SpacecraftModel, regressor: Regressor) -> np.ndarray:
    """Return the matrix (10 bodies, 10 bodies) from parameters of bodies to what `carried_by_bus` gives."""
    out = np.zeros((regressor.columns, regressor.columns))
    tanks = {j.joint for j in model.slosh}
    modes = {int(j) for g in (model.modes, model.further_modes, model.wheels) for j in g.joints}
    for j in modes - tanks:
        if model.pin.parents[j] == 1:
            place = model.pin.jointPlacements[j]
            out[:10, 10 * (j - 1) : 10 * j] = np.array([move_parameters(place, e) for e in np.eye(10)]).T
    return out


def first_moments(model: SpacecraftModel, regressor: Regressor, q: np.ndarray) -> np.ndarray:
    """Return Y with Y theta = sum m c about the bus origin in bus axes, (N, 3, 10 bodies) [kg m].

    Pinocchio's static regressor gives the centre of mass by masses and first moments.
    """
    out = np.zeros((len(q), 3, regressor.columns // 10, 10))
    data, mass = model.pin.createData(), pin.computeTotalMass(model.pin)
    q = np.array(q)
    q[:, :7] = pin.neutral(model.pin)[:7]  # with the bus at the origin
    for into, q_i in zip(out, q, strict=True):
        into[..., :4] = mass * pin.computeStaticRegressor(model.pin, data, q_i).reshape(3, -1, 4)
    return out.reshape(len(q), 3, -1)


@dataclass(frozen=True)
class ParameterSplit:
    """Which inertial parameters are sought and which are known."""

    unknown: list[int]
    known: list[int]
    names: tuple[str, ...]
    units: tuple[str, ...]

    @classmethod
    def of(cls, model: SpacecraftModel, regressor: Regressor, *, bus_first: bool) -> ParameterSplit:
        """Return the split of Step B (``bus_first``: all of bus and links but the bus's mass) or Step A.

        Step A seeks masses and first moments of the links; what belongs to neither is known.
        """
        bodies = regressor.bodies
        rigid = {bodies[0], *(bodies[int(j) - 1] for j in model.arm_joints.joints)}
        body = [name.rsplit(".", 1)[0] for name in regressor.names]
        kind = [name.rsplit(".", 1)[1] for name in regressor.names]
        if bus_first:
            unknown = [
                i
                for i in range(len(body))
                if body[i] in rigid and not (body[i] == bodies[0] and kind[i] == "m")
            ]
            known = [i for i in range(len(body)) if body[i] not in rigid]
        else:
            moments = ("m", "mx", "my", "mz")
            unknown = [i for i in range(len(body)) if body[i] in rigid - {bodies[0]} and kind[i] in moments]
            known = [i for i in range(len(body)) if body[i] not in rigid and kind[i] in moments]
        return cls(
            unknown,
            known,
            tuple(regressor.names[i] for i in unknown),
            tuple(regressor.units[i] for i in unknown),
        )


def skew(x: np.ndarray) -> np.ndarray:
    """Return matrices (..., 3, 3) with skew(x) y = x cross y."""
    out = np.zeros((*x.shape, 3))
    a, b, c = np.moveaxis(x, -1, 0)
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -c, b, -a
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = c, -b, a
    return out
