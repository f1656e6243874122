"""The linear closed loop with slosh and panel inside the plant: poles with the names of what moves in them.

About rest, translation and wheel speeds eliminated by momentum as in `smsid.control.reduced`, but with slosh
and bending free: M x'' + D x' + K x = [Q_c, 0], x = (attitude, joints, slosh, bending). Q_c is the
controller's, (46), with its own (wrong) H.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.control._statespace import StateSpace, lower_lft
from smsid.control.gains import Gains
from smsid.errors import ControlError
from smsid.model.spacecraft import SpacecraftModel

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Pole:
    """A closed-loop pole [rad/s]; ``name`` is the coordinate with the largest ``share`` of its kinetic
    energy.

    Poles of the controller itself are named ``controller``. ``flag`` says what is wrong, or is empty.
    """

    value: complex
    name: str
    share: float
    flag: str = ""

    @property
    def damping(self) -> float:
        """Damping ratio; negative for an unstable pole."""
        return float(-self.value.real / abs(self.value)) if self.value else 1.0


@dataclass(frozen=True)
class FlexiblePlant:
    """M x'' + D x' + K x = [Q_c, 0]: ``mass``, ``damping``, ``stiffness`` (m, m), ``names`` (m,).

    The first ``actuated`` coordinates are the attitude and the joints.
    """

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    names: tuple[str, ...]
    actuated: int


def flexible_plant(model: SpacecraftModel, angles: np.ndarray) -> FlexiblePlant:
    """Return the linear plant about rest with the arm joints at ``angles`` (n,) [rad].

    Raises `ControlError` for a welded base.
    """
    if not model.free:
        raise ControlError("The base is welded to the ground.", advice='Describe it with root = "free".')
    q = model.set_joint_angles(model.home, angles)
    upper = pin.crba(model.pin, model.data, q)
    mass = np.triu(upper) + np.triu(upper, 1).T
    kept, names = controlled_names(model)
    reduced = reduced_mass(mass, kept, [0, 1, 2, *model.wheels.v.tolist()])
    stiffness, damping = (np.diag(x[kept]) for x in springs(model))
    return FlexiblePlant(reduced, damping, stiffness, names, 3 + len(model.arm_joints))


def reduced_mass(mass: np.ndarray, kept: Sequence[int], out: Sequence[int]) -> np.ndarray:
    """Return the mass matrix (k, k) of the coordinates ``kept``, those ``out`` eliminated by momentum."""
    coupling = mass[np.ix_(kept, out)]
    return mass[np.ix_(kept, kept)] - coupling @ np.linalg.solve(mass[np.ix_(out, out)], coupling.T)


def springs(model: SpacecraftModel) -> np.ndarray:
    """Return stiffness and damping of all coordinates, (2, nv)."""
    found = np.zeros((2, model.nv))
    found[:, model.spring_v] = model.stiffness, model.damping
    return found


def controlled_names(model: SpacecraftModel) -> tuple[list[int], tuple[str, ...]]:
    """Return places in v and names of attitude, joints, slosh and bending, in this order."""
    kept = [3, 4, 5, *model.arm_joints.v.tolist()]
    names = ["attitude x", "attitude y", "attitude z", *model.arm_joints.names]
    for joint in model.slosh:
        kept += range(joint.v.start, joint.v.stop)
        names += [f"{joint.name} {axis}" for axis in "xyz"]
    for group in (model.modes, model.further_modes):
        kept += group.v.tolist()
        names += list(group.names)
    return kept, tuple(names)


def law_of(gains: Gains, controller: StateSpace | None, inertia: np.ndarray) -> StateSpace:
    """Return Q_c = H_hat (K_D de + K_P e - u_inf) as a system from (e, de); ``inertia`` (k, k) is H_hat."""
    c = controller or StateSpace.zero_system(gains.size, 2 * gains.size)
    through = inertia @ (np.hstack([gains.proportional, gains.derivative]) - c.d)
    return StateSpace(c.a, c.b, -inertia @ c.c, through)


def errors_of(coordinates: int, actuated: int) -> np.ndarray:
    """Return (2 k, 2 m): (e, de) of the first k of m coordinates, from (x, x')."""
    one = np.eye(actuated, coordinates)
    return -np.block([[one, np.zeros_like(one)], [np.zeros_like(one), one]])


def closed_loop_matrix(
    plant: FlexiblePlant, inertia: np.ndarray, gains: Gains, controller: StateSpace | None = None
) -> np.ndarray:
    """Return A of (x, x', controller) under Q_c = H_hat (K_D de + K_P e - u_inf).

    ``inertia`` (k, k) is H_hat. Raises `ControlError` when sizes do not fit.
    """
    k = plant.actuated
    if inertia.shape != (k, k) or gains.size != k:
        raise ControlError(
            f"An inertia of shape {inertia.shape} and gains of {gains.size} coordinates do not fit a "
            f"plant with {k} actuated ones."
        )
    return lower_lft(_open_loop(plant), law_of(gains, controller, inertia)).a


def named_poles(
    plant: FlexiblePlant, inertia: np.ndarray, gains: Gains, controller: StateSpace | None = None
) -> tuple[Pole, ...]:
    """Return the closed-loop poles, upper half plane, slowest first, with what is wrong flagged.

    ``inertia`` (k, k) is the controller's H_hat [kg m^2].

    Flagged: ``unstable``; ``driven``, a slosh or bending pole that the controller takes damping from: more
    than 1 % less than with the base free and than with base and joints held. Raises `ControlError` when
    sizes do not fit.
    """
    least = least_damping(plant)
    flagged = []
    for p in _poles(plant, closed_loop_matrix(plant, inertia, gains, controller)):
        flag = ""
        if p.value.real >= 0.0:
            flag = "unstable"
        elif p.value.imag > 0.0 and p.name in plant.names[plant.actuated :]:
            flag = "driven" if p.damping < 0.99 * least.get(p.name, 0.0) else ""
        flagged.append(Pole(p.value, p.name, p.share, flag))
    return tuple(flagged)


def least_damping(plant: FlexiblePlant) -> dict[str, float]:
    """Return by mode the least damping ratio it has without controller, base free or base and joints held."""
    k = plant.actuated
    held = FlexiblePlant(
        plant.mass[k:, k:], plant.damping[k:, k:], plant.stiffness[k:, k:], plant.names[k:], 0
    )
    least: dict[str, float] = {}
    for uncontrolled in (plant, held):
        for p in _poles(uncontrolled, _open_loop(uncontrolled).a):
            if p.value.imag > 0.0:
                least[p.name] = min(p.damping, least.get(p.name, np.inf))
    return least


def refuse_unstable(poles: tuple[Pole, ...]) -> tuple[Pole, ...]:
    """Return the poles, flags logged; raises `ControlError` naming the mode when one is unstable."""
    for p in poles:
        if p.flag:
            logger.warning("the controller makes %s at %.4g rad/s %s", p.name, abs(p.value), p.flag)
    bad = [p for p in poles if p.flag == "unstable"]
    if bad:
        raise ControlError(
            f"The design destabilises {bad[0].name}: a pole at {bad[0].value:.4g} rad/s.",
            advice="Lower the gains or the crossover, or identify the mode better.",
            poles=poles,
        )
    return poles


def _open_loop(plant: FlexiblePlant) -> StateSpace:
    """Return the system of states (x, x') from Q_c to (e, de)."""
    m, k = len(plant.mass), plant.actuated
    forces = np.hstack([-plant.stiffness, -plant.damping, np.eye(m, k)])
    moved = np.vstack([np.eye(m, 2 * m + k, m), np.linalg.solve(plant.mass, forces)])
    return StateSpace(moved[:, : 2 * m], moved[:, 2 * m :], errors_of(m, k), np.zeros((2 * k, k)))


def _poles(plant: FlexiblePlant, a: np.ndarray) -> list[Pole]:
    """Name every pole by the share of each coordinate in x'^* M x', diagonal terms; M-normalised motion."""
    m = len(plant.mass)
    values, vectors = np.linalg.eig(a)
    found = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag < 0.0:
            continue
        shares = np.abs(vector[m : 2 * m]) ** 2 * np.diag(plant.mass)
        inside = float(np.linalg.norm(vector[2 * m :]))
        if shares.sum() == 0.0:
            found.append(Pole(complex(value), "controller" if inside else "rest", 1.0))
            continue
        best = int(np.argmax(shares))
        found.append(Pole(complex(value), plant.names[best], float(shares[best] / shares.sum())))
    return sorted(found, key=lambda p: abs(p.value))
