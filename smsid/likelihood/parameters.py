"""The physical parameters of a spacecraft as one vector: inertias, slosh, appendages, and their Jacobians.

A step delta of the vector moves inertial parameters of rigid bodies linearly, in units of the body's size
(the motion depends on them almost linearly, so Gauss and Newton converge), positive scalars by their
logarithm and dampings plainly. Everything the dynamics needs - inertial parameters of all bodies, spring
constants - follows with its derivative by the chain rule. That the bodies handed out can exist is seen to
afterwards, in `consistent`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from smsid.description.schema import Description
from smsid.effects.assembly import AppendageJoints
from smsid.effects.inertial_parameters import move_parameters, parameters_to_matrix, pinocchio_inertia
from smsid.errors import DescriptionError
from smsid.identify.appendages import as_described
from smsid.likelihood.pseudo_inertia import SIZE, is_body
from smsid.model.regressor import INERTIAL_NAMES, body_names, dynamic_parameters
from smsid.model.spacecraft import SpacecraftModel


@dataclass(frozen=True)
class Parameters:
    """A point in parameter space: inertial parameters of the rigid bodies (bodies, 10), then scalars.

    A body's are as the URDF has them, wheels included, appendages not. ``sizes`` (bodies, 10) is what a unit
    of the step is.
    """

    layout: Layout
    inertias: np.ndarray
    sizes: np.ndarray
    scalars: tuple[Scalar, ...]

    @classmethod
    def of(cls, model: SpacecraftModel) -> Parameters:
        """Return the description's values.

        Bodies without extent in three directions, and wheels that are joints of the URDF, stay as they are.
        Raises `DescriptionError` for an effect the refinement does not know how to estimate with.
        """
        if not model.free or model.pin.gravity.linear.any():
            how = "is under gravity" if model.free else "stands on the ground"
            raise DescriptionError(
                f"'{model.description.name}' {how}: this is for spacecraft that fly freely, without gravity.",
                advice="Put the arm on a bus (`smsid new CRAFT --arm ARM.urdf`) or, of a spacecraft, set "
                '`root = "free"` in its TOML and leave out `gravity`. Of an arm on the ground `smsid '
                "identify` and `smsid diagnose` take the torques.",
            )
        theta = np.concatenate([dynamic_parameters(i) for i in list(model.pin.inertias)[1:]])
        appendages = {a.appendage.name: appendage_parts(model, a) for a in model.appendages}
        rigid = theta - sum(appendages.values(), np.zeros_like(theta))
        spins = wheel_spins(model)
        rigid[:SIZE] += spins
        special = {int(j) for g in (model.wheels, model.modes, model.further_modes) for j in g.joints}
        special |= {s.joint for s in model.slosh}
        candidates = [j for j in range(1, model.pin.njoints) if j not in special]
        bodies = tuple(j for j in candidates if is_body(rigid[SIZE * (j - 1) : SIZE * j]))
        names = body_names(model.pin)
        fixed = rigid.copy()
        for j in [*bodies, *(s.joint for s in model.slosh)]:
            fixed[SIZE * (j - 1) : SIZE * j] = 0.0
        fixed[:SIZE] -= spins
        layout = Layout(
            model,
            bodies,
            tuple(names[j - 1] for j in candidates if j not in bodies),
            fixed,
            appendages,
            theta,
        )
        inertias = np.array([rigid[SIZE * (j - 1) : SIZE * j] for j in bodies]).reshape(-1, SIZE)
        sizes = np.array([body_size(theta) for theta in inertias]).reshape(-1, SIZE)
        return cls(layout, inertias, sizes, tuple(scalars_of(model)))

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.inertias.size + len(self.scalars)

    @property
    def names(self) -> tuple[str, ...]:
        """Names: ``<body>.m`` to ``<body>.Izz``, then the scalars."""
        inertial = [f"{n}.{p}" for n in self.layout.names for p in INERTIAL_NAMES]
        return (*inertial, *(s.name for s in self.scalars))

    def index(self, name: str) -> int:
        """Return where a scalar stands in the vector."""
        return self.inertias.size + [s.name for s in self.scalars].index(name)

    def scalar(self, name: str) -> float:
        """Return the value of a scalar, in its unit."""
        return next(s.value for s in self.scalars if s.name == name)

    def moved(self, step: np.ndarray) -> Parameters:
        """Return the point a step (size,) away."""
        n = self.inertias.size
        inertias = self.inertias + step[:n].reshape(-1, SIZE) * self.sizes
        scalars = tuple(s.moved(float(d)) for s, d in zip(self.scalars, step[n:], strict=True))
        return replace(self, inertias=inertias, scalars=scalars)

    def with_inertias(self, inertias: np.ndarray) -> Parameters:
        """Return the point with other inertial parameters (bodies, 10)."""
        return replace(self, inertias=np.array(inertias, dtype=float).reshape(self.inertias.shape))

    def with_scalars(self, values: Mapping[str, float]) -> Parameters:
        """Return the point with scalars replaced by name.

        Raises `DescriptionError` for a name there is not.
        """
        known = {s.name for s in self.scalars}
        unknown = sorted(set(values) - known)
        if unknown:
            raise DescriptionError(f"No parameter is named {unknown[0]}.", advice=f"Known: {sorted(known)}.")
        return replace(
            self, scalars=tuple(replace(s, value=values.get(s.name, s.value)) for s in self.scalars)
        )

    def theta(self) -> np.ndarray:
        """Return the inertial parameters (10 bodies,) of the model, ordered as `Regressor.names`."""
        out = self.layout.fixed.copy()
        for j, own in zip(self.layout.bodies, self.inertias, strict=True):
            out[SIZE * (j - 1) : SIZE * j] += own
        for tank in self.layout.model.slosh:
            out[SIZE * (tank.joint - 1)] += self.scalar(f"{tank.name}.mass")
        for name, part in self.layout.appendages.items():
            out += self.scalar(f"{name}.density_factor") * part
        return out

    def theta_jacobian(self) -> np.ndarray:
        """Return d theta / d step (10 bodies, size)."""
        out = np.zeros((len(self.layout.fixed), self.size))
        for k, (j, size) in enumerate(zip(self.layout.bodies, self.sizes, strict=True)):
            out[SIZE * (j - 1) + np.arange(SIZE), SIZE * k + np.arange(SIZE)] = size
        for tank in self.layout.model.slosh:
            name = f"{tank.name}.mass"
            out[SIZE * (tank.joint - 1), self.index(name)] = self._slope(name)
        for name, part in self.layout.appendages.items():
            key = f"{name}.density_factor"
            out[:, self.index(key)] = self._slope(key) * part
        return out

    def springs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return stiffness and damping (springs,) of the model and their derivatives (springs, size)."""
        model = self.layout.model
        stiffness, damping = model.stiffness.copy(), model.damping.copy()
        dk, dd = np.zeros((2, len(stiffness), self.size))
        row = {int(v): i for i, v in enumerate(model.spring_v)}
        for tank in model.slosh:
            for axis, v in zip("xyz", range(tank.v.start, tank.v.stop), strict=True):
                i = row[v]
                for field, out, jacobian in (("stiffness", stiffness, dk), ("damping", damping, dd)):
                    name = f"{tank.name}.{field}.{axis}"
                    out[i] = self.scalar(name)
                    jacobian[i, self.index(name)] = self._slope(name)
        for joints in model.appendages:
            name = joints.appendage.name
            key = f"{name}.density_factor"
            for k, (j, scale) in enumerate(zip(joints.joints, joints.scale, strict=True), start=1):
                i = row[model.pin.joints[j].idx_v]
                f_key, z_key = f"{name}.mode{k}.frequency", f"{name}.mode{k}.damping"
                omega, zeta, mass = (
                    2 * np.pi * self.scalar(f_key),
                    self.scalar(z_key),
                    scale**2 * self.scalar(key),
                )
                stiffness[i], damping[i] = mass * omega**2, 2 * zeta * omega * mass
                relative = self._slope(key) / self.scalar(key)
                dk[i, self.index(key)], dd[i, self.index(key)] = (
                    stiffness[i] * relative,
                    damping[i] * relative,
                )
                relative = self._slope(f_key) / self.scalar(f_key)
                dk[i, self.index(f_key)] = 2 * stiffness[i] * relative
                dd[i, self.index(f_key)] = damping[i] * relative
                dd[i, self.index(z_key)] = 2 * omega * mass
            for i in (row[model.pin.joints[m.joint].idx_v] for m in joints.more):
                stiffness[i], damping[i] = stiffness[i] * self.scalar(key), damping[i] * self.scalar(key)
                relative = self._slope(key) / self.scalar(key)
                dk[i, self.index(key)], dd[i, self.index(key)] = (
                    stiffness[i] * relative,
                    damping[i] * relative,
                )
        return stiffness, damping, dk, dd

    def pin_model(self) -> pin.Model:
        """Return the Pinocchio model with these inertias."""
        model, theta = self.layout.model.pin.copy(), self.theta()
        changed = {*self.layout.bodies, *(s.joint for s in self.layout.model.slosh), 1}
        groups = (self.layout.model.modes, self.layout.model.further_modes)
        changed |= {int(j) for g in groups for j in g.joints}
        for j in changed:
            model.inertias[j] = pinocchio_inertia(theta[SIZE * (j - 1) : SIZE * j])
        return model

    def description(self) -> Description:
        """Return the description with slosh and appendages as estimated (a URDF's inertias stay in the URDF).

        Dampings that came out negative are set to zero.
        """
        d = self.layout.model.description
        effects, panels = [], []
        for tank in (s.tank for s in self.layout.model.slosh):
            own = {s.name: s.value for s in self.scalars if s.name.startswith(f"{tank.name}.")}
            effects.append(tank.with_values({k: max(v, 0.0) for k, v in own.items()}))
        for joints in self.layout.model.appendages:
            part = joints.appendage
            own = {s.name: max(s.value, 0.0) for s in self.scalars if s.name.startswith(f"{part.name}.mode")}
            panel = part.as_modal(self.scalar(f"{part.name}.density_factor"), part.described_modes(d.effect))
            panels.append(panel.with_values(own))
        return as_described(d.with_effects(*effects), panels)

    def _slope(self, name: str) -> float:
        return next(s.slope for s in self.scalars if s.name == name)


def body_size(theta: np.ndarray) -> np.ndarray:
    """Return what a body's parameters (10,) are compared with: mass, mass times gyration radius, ..."""
    mass = theta[0]
    gyration = np.sqrt(np.trace(parameters_to_matrix(theta)) / (2.0 * mass))
    return mass * np.concatenate([[1.0], np.full(3, gyration), np.full(6, gyration**2)])


@dataclass(frozen=True)
class Layout:
    """What does not change while parameters do: bodies, and what slosh and appendages contribute.

    ``fixed`` (10 bodies,) inertial parameters nobody estimates; ``appendages`` what each adds to the inertial
    parameters (10 bodies,) at the described density, modes included; ``unseen`` are bodies left as described
    for want of extent; ``theta0`` (10 bodies,) are the described parameters.
    """

    model: SpacecraftModel
    bodies: tuple[int, ...]
    unseen: tuple[str, ...]
    fixed: np.ndarray
    appendages: Mapping[str, np.ndarray]
    theta0: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the estimated bodies."""
        names = body_names(self.model.pin)
        return tuple(names[j - 1] for j in self.bodies)


def appendage_parts(model: SpacecraftModel, joints: AppendageJoints) -> np.ndarray:
    """Return the inertial parameters (10 bodies,) an appendage adds: its modes, and the remainder."""
    out = np.zeros(SIZE * (model.pin.njoints - 1))
    remainder = move_parameters(joints.placement, dynamic_parameters(joints.appendage.rigid_inertia()))
    for j in joints.seen:
        own = dynamic_parameters(model.pin.inertias[j])
        out[SIZE * (j - 1) : SIZE * j] = own
        remainder = remainder - move_parameters(model.pin.jointPlacements[j], own)
    if joints.parent > 0:
        out[SIZE * (joints.parent - 1) : SIZE * joints.parent] += remainder
    return out


def wheel_spins(model: SpacecraftModel) -> np.ndarray:
    """Return the spin inertias (10,) that were taken out of the bus for its wheels."""
    out = np.zeros(SIZE)
    for wheel in model.description.wheel:
        if wheel.joint is None and wheel.inertia_in_bus:
            axis = np.asarray(wheel.axis) / np.linalg.norm(wheel.axis)
            spin = wheel.inertia * np.outer(axis, axis)
            out[4:] += [spin[0, 0], spin[0, 1], spin[1, 1], spin[0, 2], spin[1, 2], spin[2, 2]]
    return out


@dataclass(frozen=True)
class Scalar:
    """A scalar parameter: name, value, unit; ``log``: its step is that of its logarithm.

    ``reference`` is the description's value, ``size`` what a change of it is compared with, ``sigma`` the
    standard deviation of the user's prior.
    """

    name: str
    value: float
    unit: str
    log: bool
    reference: float
    size: float
    sigma: float | None = None

    @property
    def slope(self) -> float:
        """Derivative of the value by the step."""
        return self.value if self.log else 1.0

    def moved(self, step: float) -> Scalar:
        """Return the parameter a step away."""
        return replace(self, value=self.value * float(np.exp(step)) if self.log else self.value + step)


def scalars_of(model: SpacecraftModel) -> list[Scalar]:
    """Return the scalars of a model at the description's values."""
    found = []
    for joint in model.slosh:
        tank = joint.tank
        critical = 2.0 * np.sqrt(tank.mass * max(tank.stiffness))
        for p in tank.parameters():
            log = "damping" not in p.name and p.value > 0.0
            least = 0.01 * critical if "damping" in p.name else p.value or max(tank.stiffness)
            found.append(Scalar(p.name, p.value, p.unit, log, p.value, max(p.value, least), p.sigma))
    for joints in model.appendages:
        part = joints.appendage
        prior = part.prior
        own = {p.name.removeprefix(f"{part.name}."): p.value for p in part.parameters()}
        key = "density" if "density" in own else "mass"
        relative = prior[key] / own[key] if key in prior else None
        found.append(Scalar(f"{part.name}.density_factor", 1.0, "1", True, 1.0, 1.0, relative))
        described = part.described_modes(model.description.effect)
        for k, mode in enumerate(described, start=1):
            name, f, zeta = f"{part.name}.mode{k}", mode.frequency, mode.damping
            sigma = prior.get(f"mode{k}.frequency")
            found.append(Scalar(f"{name}.frequency", f, "Hz", True, f, f, sigma))
            sigma = prior.get(f"mode{k}.damping", prior.get("damping"))
            found.append(Scalar(f"{name}.damping", zeta, "1", False, zeta, max(zeta, 0.01), sigma))
    return found
