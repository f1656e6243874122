"""The spacecraft about rest with the identified intervals: M(delta) y'' + D(delta) y' + K(delta) y = B Q.

y are all coordinates, translation and wheels too; M is linear in the inertial parameters, so

    M = M_0 + sum_i delta_i M_i,  D and K alike,  |delta_i| <= 1 at the end of the 95 % interval,

and the loop is a linear fractional transformation of the delta_i (Zhou, Doyle and Glover 1996, chapter 10).
Translation and wheel speeds do not act back (momentum is conserved, wheel speeds do not enter about rest), so
the states are those of attitude, joints, slosh and bending, and the controller's. Slosh and bending are
inside the plant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid._statistics import NORMAL95
from smsid.control._mu import UncertainBlock
from smsid.control._robust import controlled_names, errors_of, law_of, springs
from smsid.control._statespace import StateSpace, lower_lft
from smsid.control._wheels import WheelLayout
from smsid.control.gains import Gains
from smsid.control.identified_model import IdentifiedModel
from smsid.effects.inertial_parameters import pinocchio_inertia
from smsid.errors import ControlError
from smsid.identify.estimate import Estimate
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.pseudo_inertia import SIZE
from smsid.model.spacecraft import SpacecraftModel

SMALLEST = 1e-9
"""Share of a change's largest eigenvalue below which a channel is left out."""


@dataclass(frozen=True)
class ParameterEffect:
    """What one parameter does at the end of its interval: ``mass`` (m, m), ``damping``, ``stiffness`` (m,).

    ``rigid``: a combination of the bodies' inertial parameters; all of those together are one full block of
    the uncertainty.
    """

    name: str
    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    rigid: bool


@dataclass(frozen=True)
class UncertainPlant:
    """See the module: ``mass`` (m, m), ``damping``, ``stiffness`` (m,), ``input`` B (m, k), ``changes``.

    ``kept`` (n,) are the coordinates that are states, attitude and joints first; ``names`` theirs.
    """

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    input: np.ndarray
    kept: np.ndarray
    names: tuple[str, ...]
    changes: tuple[ParameterEffect, ...]

    @property
    def actuated(self) -> int:
        """Number of coordinates that the controller moves, 3 + joints."""
        return self.input.shape[1]

    def rigid_size(self, delta: np.ndarray) -> float:
        """Return the norm of what ``delta`` does to the rigid bodies' mass matrix, in that matrix's norm.

        ``delta`` (changes,), one at the ends of the intervals.
        """
        rigid = self.rigid
        if not len(rigid):
            return 0.0
        change = sum(
            (d * c.mass for d, c in zip(delta, self.changes, strict=True) if c.rigid),
            np.zeros_like(self.mass),
        )
        root = np.linalg.inv(np.linalg.cholesky(self.mass[np.ix_(rigid, rigid)]))
        return float(np.linalg.norm(root @ change[np.ix_(rigid, rigid)] @ root.T, 2))

    @property
    def rigid(self) -> np.ndarray:
        """Indices (k,) of what the bodies' inertial parameters enter: translation, attitude, joints."""
        touched = [np.any(c.mass, axis=0) for c in self.changes if c.rigid]
        return np.flatnonzero(np.any(touched, axis=0)) if touched else np.zeros(0, dtype=int)

    def at(self, delta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return mass (m, m), damping and stiffness (m,) at parameters ``delta`` (changes,), +-1 at the ends.

        Raises `ControlError` when there are not as many.
        """
        if np.shape(delta) != (len(self.changes),):
            raise ControlError(f"{np.shape(delta)} parameters were given, not {len(self.changes)}.")
        mass, damping, stiffness = self.mass.copy(), self.damping.copy(), self.stiffness.copy()
        for d, c in zip(np.asarray(delta, dtype=float), self.changes, strict=True):
            if d:
                mass += d * c.mass
                damping += d * c.damping
                stiffness += d * c.stiffness
        return mass, damping, stiffness

    def closed_loop(
        self, delta: np.ndarray, inertia: np.ndarray, gains: Gains, controller: StateSpace | None = None
    ) -> np.ndarray:
        """Return A of (x, x', controller) at parameters ``delta`` (changes,), +-1 at the ends of intervals.

        Q = H_hat (K_D de + K_P e - u_inf) with ``inertia`` H_hat (k, k). Raises `ControlError` when sizes do
        not fit or the mass matrix is not positive definite.
        """
        mass, damping, stiffness = self.at(delta)
        if np.linalg.eigvalsh(mass)[0] <= 0.0:
            raise ControlError("These parameters are those of no spacecraft: its mass matrix is indefinite.")
        law = law_of(gains, controller, inertia)
        return lower_lft(self._open_loop(mass, damping, stiffness, np.zeros((len(mass), 0)), []), law).a

    def fractional(
        self, inertia: np.ndarray, gains: Gains, controller: StateSpace | None = None, *, level: float
    ) -> tuple[StateSpace, tuple[UncertainBlock, ...], np.ndarray]:
        """Return N of the loop (N, Delta), Delta's blocks, and the parameter of each channel (-1: the block).

        Delta = diag(a full block for the bodies' inertia, real scalars), all within one. The full block
        stands for every change of the rigid bodies' mass matrix within ``level`` in its own norm.
        """
        sources, sinks, blocks, owner = [], [], [], []
        rigid = self.rigid
        if len(rigid) and level > 0.0:
            root = np.linalg.cholesky(self.mass[np.ix_(rigid, rigid)])
            into = np.zeros((len(self.mass), len(rigid)))
            into[rigid] = np.sqrt(level) * root
            sources.append(into)
            sinks.append(("acceleration", into.T))
            blocks.append(UncertainBlock("inertia of bus and links", len(rigid), False))
            owner += [-1] * len(rigid)
        for k, c in enumerate(self.changes):
            if c.rigid:
                continue
            for u, v in _factors(c.mass):
                sources.append(u)
                sinks.append(("acceleration", v))
                owner.append(k)
            for diagonal, what in ((c.damping, "velocity"), (c.stiffness, "position")):
                for i in np.flatnonzero(diagonal):
                    u, v = np.zeros((len(self.mass), 1)), np.zeros((1, len(self.mass)))
                    u[i, 0] = np.sqrt(abs(diagonal[i]))
                    v[0, i] = np.sign(diagonal[i]) * u[i, 0]
                    sources.append(u)
                    sinks.append((what, v))
                    owner.append(k)
        blocks += [UncertainBlock(self.changes[k].name, 1, True) for k in owner if k >= 0]
        loop = self._open_loop(self.mass, self.damping, self.stiffness, np.hstack(sources), sinks)
        return lower_lft(loop, law_of(gains, controller, inertia)), tuple(blocks), np.array(owner)

    def _open_loop(
        self,
        mass: np.ndarray,
        damping: np.ndarray,
        stiffness: np.ndarray,
        sources: np.ndarray,
        sinks: list[tuple[str, np.ndarray]],
    ) -> StateSpace:
        """Return the system of states (x, x') from (w, Q_c) to (z, (e, de)), w taken from the forces by the
        ``sources`` (m, w), z as the ``sinks`` say.
        """
        n, k = len(self.kept), self.actuated
        force = np.zeros((len(mass), 2 * n))
        force[self.kept, np.arange(n)] = -stiffness[self.kept]
        force[self.kept, n + np.arange(n)] = -damping[self.kept]
        moved = np.linalg.solve(mass, np.hstack([force, -sources, self.input]))
        rates = np.eye(n, moved.shape[1], n)
        places = {"position": np.eye(n, moved.shape[1]), "velocity": rates}
        z = [v @ moved if what == "acceleration" else v[:, self.kept] @ places[what] for what, v in sinks]
        states = np.vstack([rates, moved[self.kept]])
        y = np.hstack([errors_of(n, k), np.zeros((2 * k, sources.shape[1] + k))])
        out = np.vstack([*z, y])
        return StateSpace(states[:, : 2 * n], states[:, 2 * n :], out[:, : 2 * n], out[:, 2 * n :])


def uncertain_plant(identified: IdentifiedModel, estimate: Estimate, angles: np.ndarray) -> UncertainPlant:
    """Return the plant with the arm joints at ``angles`` (n,) [rad] and the estimate's 95 % intervals.

    A damping's interval ends at zero: below, there is no such spacecraft; the plant's centre is the middle of
    what is left. Effects' parameters that the estimate does not hold are taken as known.
    """
    model = identified.model
    q = model.set_joint_angles(model.home, angles)
    mass = _mass_matrix(model, q, None)
    stiffness, damping = springs(model)
    zero = np.zeros(model.nv)
    changes = [
        ParameterEffect(name, NORMAL95 * (_mass_matrix(model, q, d) - mass), zero, zero, True)
        for name, d in zip(identified.direction_names, identified.directions, strict=True)
        if d.any()
    ]
    at = Parameters.of(model)
    jacobian, (_, _, by_stiffness, by_damping) = at.theta_jacobian(), at.springs()
    for k, scalar in enumerate(at.scalars, start=at.inertias.size):
        found = _interval(scalar.name, at, estimate)
        if found is None:
            continue
        middle, half = found
        theta = jacobian[:, k] / scalar.slope
        by_k, by_d = np.zeros(model.nv), np.zeros(model.nv)
        by_k[model.spring_v] = by_stiffness[:, k] / scalar.slope
        by_d[model.spring_v] = by_damping[:, k] / scalar.slope
        # a middle that is not the model's value: only for parameters that enter plainly, dampings
        damping = damping + (middle - scalar.value) * by_d
        by_mass = _mass_matrix(model, q, theta) - mass if theta.any() else np.zeros_like(mass)
        changes.append(ParameterEffect(scalar.name, half * by_mass, half * by_d, half * by_k, False))
    kept, names = controlled_names(model)
    actuated = 3 + len(model.arm_joints)
    into = np.zeros((model.nv, actuated))
    into[model.wheels.v, :3] = -WheelLayout.of(model).inverse
    into[model.arm_joints.v, np.arange(3, actuated)] = 1.0
    return UncertainPlant(mass, damping, stiffness, into, np.array(kept), names, tuple(changes))


def _interval(name: str, at: Parameters, estimate: Estimate) -> tuple[float, float] | None:
    """Return middle and half width of a scalar's interval, by the name the estimate has for it."""
    factor = 1.0
    if name.endswith(".density_factor"):
        part = name.removesuffix(".density_factor")
        options = [f"{part}.linear_density", f"{part}.participation_factor"]
        name = next((o for o in options if o in estimate), name)
        factor = estimate[name].value if name in estimate else 1.0
    if name not in estimate:
        return None
    found = estimate[name]
    if not np.isfinite(found.sigma):
        raise ControlError(
            f"'{name}' has no interval; robust analysis needs one for each parameter.",
            advice="Identify again with intervals.",
        )
    half = NORMAL95 * found.sigma
    if name.endswith(".linear_density") or name.endswith(".participation_factor"):
        return 1.0, half / factor
    if ".damping" in name:
        low, high = max(0.0, found.value - half), max(0.0, found.value + half)
        return 0.5 * (low + high), 0.5 * (high - low)
    return at.scalar(name), half


def _mass_matrix(model: SpacecraftModel, q: np.ndarray, change: np.ndarray | None) -> np.ndarray:
    """Return M (nv, nv) with inertial parameters moved by ``change`` (10 bodies,); exact, M being linear."""
    if change is None:
        return np.array(pin.crba(model.pin, model.data, q))
    moved = model.pin.copy()
    # a small step keeps bodies physical; M is linear in it
    step = 1e-3
    for k, own in enumerate(change.reshape(-1, SIZE)):
        if own.any():
            theta = moved.inertias[k + 1].toDynamicParameters() + step * own
            moved.inertias[k + 1] = pinocchio_inertia(theta)
    exact = np.array(pin.crba(model.pin, model.data, q))
    return exact + (np.array(pin.crba(moved, moved.createData(), q)) - exact) / step


def _factors(matrix: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return u (m, 1), v (1, m) with matrix = sum u v, from the eigenvalues of a symmetric matrix."""
    if not matrix.any():
        return []
    values, vectors = np.linalg.eigh(matrix)
    largest = np.abs(values).max()
    found = []
    for value, vector in zip(values, vectors.T, strict=True):
        if abs(value) > SMALLEST * largest:
            size = np.sqrt(abs(value))
            found.append((size * vector[:, None], np.sign(value) * size * vector[None]))
    return found
