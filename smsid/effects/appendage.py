"""Flexible appendages: bending modes as joints, from beam data or from finite-element modal data.

A mass-normalised mode with translational participation L_t (3,) and rotational participation L_r (3,) about
the root is a screw: the point mass |L_t|^2 sits where L_r = r x L_t and slides along L_t. Reproduces (5),
(7), (9) and (13): linear momentum and first moments exactly, the inertia to first order for bending of a
straight beam.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, Literal, cast

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.base import Effect, Vector3, physical, register
from smsid.effects.beam import Cantilever
from smsid.effects.table import Table
from smsid.errors import DescriptionError
from smsid.parameter import Parameter

if TYPE_CHECKING:
    from smsid.effects.assembly import Assembly


class Mode(Table):
    """One mass-normalised mode as a finite-element program delivers it.

    ``frequency`` [Hz], ``damping`` ratio, ``translation`` L_t [kg^.5] and ``rotation`` L_r about the root
    [kg^.5 m] in appendage axes, ``shape`` at the appendage's stations (stations, 3) [kg^-.5].
    """

    frequency: float = Field(gt=0.0, description="of the clamped mode [Hz]")
    damping: float = Field(ge=0.0, description="damping ratio [1]")
    translation: Vector3 = Field(description="L_t, translational participation, appendage axes [kg^.5]")
    rotation: Vector3 = Field(description="L_r, rotational participation about the root [kg^.5 m]")
    shape: tuple[Vector3, ...] = Field(
        default=(), description="mass-normalised displacement at each station, appendage axes [kg^-.5]"
    )


class Appendage(Effect):
    """What beam and modal appendages share: root placement, rigid properties, modes, stations."""

    nominal: ClassVar[bool] = True
    family: ClassVar[str] = "appendage"
    changes: ClassVar[Mapping[str, tuple[str, str]]] = {
        "frequency": ("it has stiffened", "it has softened"),
        "youngs_modulus": ("it has stiffened", "it has softened"),
        "damping": ("its bending is damped more", "its bending is damped less"),
        "density": ("it has become heavier", "it has become lighter"),
        "linear_density": ("it has become heavier", "it has become lighter"),
    }
    frame: str | None = Field(
        default=None, description="frame it is mounted on; the bus frame when not given"
    )
    position: Vector3 = Field(description="root of the appendage in `frame` [m]")
    rpy: Vector3 = Field(
        default=(0.0, 0.0, 0.0), description="roll, pitch, yaw of the appendage axes in `frame` [rad]"
    )

    @property
    def placement(self) -> pin.SE3:
        """Pose of the appendage's root axes in the frame it is mounted on."""
        return pin.SE3(pin.rpy.rpyToMatrix(*self.rpy), np.asarray(self.position))

    def modal_data(self) -> tuple[Mode, ...]:
        """Return the modes."""
        raise NotImplementedError

    def mass_parameter(self) -> Parameter:
        """Return by what an estimate says how heavy it is: a factor on the described modal masses."""
        return Parameter(f"{self.name}.participation_factor", 1.0, "1", 0.0)

    def rigid_inertia(self) -> pin.Inertia:
        """Return the rigid-body inertia in appendage axes, about the root."""
        raise NotImplementedError

    def station_positions(self) -> np.ndarray:
        """Return the stations in appendage axes, (stations, 3) [m]."""
        raise NotImplementedError

    def attach(self, assembly: Assembly) -> None:
        """Add a joint per mode, and the rigid remainder to the body that carries the appendage."""
        rigid, modes, root = self.rigid_inertia(), self.modal_data(), self.placement
        parts, remainder = _mode_joints(modes, tuple(rigid.toDynamicParameters().tolist()))
        joints, scales = [], []
        for k, (mode, part) in enumerate(zip(modes, parts, strict=True), start=1):
            joint_model, inertia, placement, scale = part
            name = f"{self.name}.mode{k}"
            joint = assembly.add_joint(self.frame, joint_model, root * placement, name)
            assembly.add_inertia(joint, inertia)
            # coordinate s = delta / scale carries the modal mass scale^2
            omega = 2 * np.pi * mode.frequency
            assembly.add_springs(joint, (scale**2 * omega**2,), (2 * mode.damping * omega * scale**2,))
            joints.append(joint)
            scales.append(scale)
        assembly.add_remainder(self.frame, remainder, root)
        assembly.note_appendage(self, joints, scales)


ModeJoint = tuple[pin.JointModel, pin.Inertia, pin.SE3, float]


@lru_cache(maxsize=64)
def _mode_joints(
    modes: tuple[Mode, ...], parameters: tuple[float, ...]
) -> tuple[tuple[ModeJoint, ...], np.ndarray]:
    """Return what `mode_joint` gives for every mode, and the parameters (10,) of the rigid remainder."""
    remainder = np.array(parameters)
    rigid = pin.Inertia.FromDynamicParameters(remainder)
    parts = tuple(mode_joint(mode, rigid) for mode in modes)
    for _, inertia, placement, _ in parts:
        remainder = remainder - placement.act(inertia).toDynamicParameters()
    remainder.setflags(write=False)
    return parts, remainder


def mode_joint(mode: Mode, rigid: pin.Inertia) -> ModeJoint:
    """Return joint, inertia in the joint frame, placement in the appendage axes, and scale ``delta / s``.

    Raises `DescriptionError` for a mode that moves nothing.
    """
    lt, lr = np.asarray(mode.translation), np.asarray(mode.rotation)
    size = np.linalg.norm(lt)
    lever = rigid.inertia.trace() ** 0.5 / rigid.mass**0.5
    if size * lever < 1e-9 * np.linalg.norm(lr) or size == 0.0:
        moment = np.linalg.norm(lr)
        if moment == 0.0:
            raise DescriptionError(
                "A mode without translational and rotational participation moves nothing.",
                advice="Remove the mode, or give its participation factors.",
            )
        axis = lr / moment
        inertia = pin.Inertia(0.0, np.zeros(3), moment**2 * np.outer(axis, axis))
        return pin.JointModelRevoluteUnaligned(axis), inertia, pin.SE3.Identity(), float(moment)
    n = lt / size
    placement = pin.SE3(np.eye(3), np.cross(lt, lr) / size**2)
    twist = float(lr @ n)
    if abs(twist) <= 1e-9 * size * lever:
        inertia = pin.Inertia(float(size**2), np.zeros(3), np.zeros((3, 3)))
        return pin.JointModelPrismaticUnaligned(n), inertia, placement, float(size)
    # share the modal energy between translation and twist in the ratio of the effective mass fractions
    about = rigid.inertia + rigid.mass * _point(rigid.lever - placement.translation)
    translation_share = size**2 / rigid.mass
    twist_share = twist**2 / float(n @ about @ n)
    w = translation_share / (translation_share + twist_share)
    mass, spin = size**2 / w, twist**2 / (1.0 - w)
    s_rate, angle_rate = w / size, (1.0 - w) / twist  # per unit delta rate
    inertia = pin.Inertia(float(mass), np.zeros(3), spin * np.outer(n, n))
    joint = pin.JointModelHelicalUnaligned(n, float(s_rate / angle_rate))
    return joint, inertia, placement, float(1.0 / angle_rate)


def _point(r: np.ndarray) -> np.ndarray:
    return (r @ r) * np.eye(3) - np.outer(r, r)


@register
class BeamAppendage(Appendage):
    """A rectangular plate bending as a cantilever: along its x axis, deflecting along its z axis.

    ``stations`` are distances from the clamp where sensors sit [m].
    """

    summary: ClassVar[str] = "flexible panel: Euler-Bernoulli cantilever plate"
    geometry: ClassVar[tuple[str, ...]] = ("length", "width", "thickness")
    kind: Literal["beam_appendage"] = "beam_appendage"
    length: float = physical("m", lower=0.0, gt=0.0, description="along x, from the clamp")
    width: float = physical("m", lower=0.0, gt=0.0, description="along y")
    thickness: float = physical("m", lower=0.0, gt=0.0, description="along z, the direction it bends")
    density: float = physical("kg/m^3", lower=0.0, gt=0.0, description="mass per volume")
    youngs_modulus: float = physical("Pa", lower=0.0, gt=0.0, description="E")
    damping: float = physical("1", lower=0.0, ge=0.0, description="damping ratio of every mode")
    modes: int = Field(default=3, ge=1, le=20, description="number of bending modes")
    stations: tuple[float, ...] = Field(
        default=(), description="where accelerometers sit, distance from the clamp [m]"
    )

    @model_validator(mode="after")
    def _stations_on_the_plate(self) -> BeamAppendage:
        # a tenth of slack: an estimator may move the length, the sensors stay where they are
        beyond = [x for x in self.stations if not 0.0 <= x <= 1.1 * self.length]
        if beyond:
            raise ValueError(f"stations {beyond} of '{self.name}' are not within its length {self.length} m")
        return self

    @property
    def mass(self) -> float:
        """Mass of the plate [kg]."""
        return self.density * self.length * self.width * self.thickness

    @property
    def linear_density(self) -> float:
        """Mass per length [kg/m], the rho of (27)."""
        return self.mass / self.length

    def mass_parameter(self) -> Parameter:
        """Return the linear density [kg/m]."""
        return Parameter(f"{self.name}.linear_density", self.linear_density, "kg/m", 0.0)

    @property
    def cantilever(self) -> Cantilever:
        """The beam's dimensionless modes."""
        return Cantilever.with_modes(self.length, self.modes)

    def modal_data(self) -> tuple[Mode, ...]:
        """Return the bending modes of the cantilever, mass-normalised."""
        stiffness = self.youngs_modulus * self.width * self.thickness**3 / 12.0
        return _beam_modes(self.length, self.modes, self.mass, stiffness, self.damping, self.stations)

    def rigid_inertia(self) -> pin.Inertia:
        """Return the plate's inertia about the root (pin.Inertia: about its own CM, lever to it)."""
        size = np.array([self.length, self.width, self.thickness]) ** 2
        moments = self.mass / 12.0 * (size.sum() - size)
        return pin.Inertia(self.mass, np.array([self.length / 2, 0.0, 0.0]), np.diag(moments))

    def station_positions(self) -> np.ndarray:
        """Return the stations in appendage axes, (stations, 3) [m]."""
        return np.array([[x, 0.0, 0.0] for x in self.stations]).reshape(-1, 3)


@lru_cache(maxsize=64)
def _beam_modes(
    length: float, count: int, mass: float, stiffness: float, damping: float, stations: tuple[float, ...]
) -> tuple[Mode, ...]:
    beam = Cantilever.with_modes(length, count)
    omega = beam.angular_frequencies(stiffness, mass / length)
    root_mass = np.sqrt(mass)
    lt, first = root_mass * beam.mean_shape, root_mass * beam.mean_moment
    shapes = beam.shape(np.asarray(stations)) / root_mass
    return tuple(
        Mode(
            frequency=float(omega[k] / (2 * np.pi)),
            damping=damping,
            translation=(0.0, 0.0, float(lt[k])),
            rotation=(0.0, -float(first[k]), 0.0),  # x e_x cross e_z = -x e_y
            shape=tuple((0.0, 0.0, float(s[k])) for s in shapes),
        )
        for k in range(count)
    )


@register
class ModalAppendage(Appendage):
    """An appendage given by modal data of a finite-element program.

    ``center_of_mass`` [m] and ``inertia`` (xx, xy, yy, xz, yz, zz) [kg m^2] about the root, in appendage
    axes; ``stations`` are sensor positions in appendage axes [m], at which every mode gives its shape.
    """

    summary: ClassVar[str] = "flexible appendage from finite-element modal data"
    kind: Literal["modal_appendage"] = "modal_appendage"
    geometry: ClassVar[tuple[str, ...]] = ("mass", "participation_factor")
    mass: float = physical("kg", lower=0.0, gt=0.0, description="of the whole appendage, as a rigid body")
    participation_factor: float = physical(
        "1", lower=0.0, gt=0.0, default=1.0, description="modal masses over those of the modes given"
    )
    center_of_mass: Vector3 = Field(description="in appendage axes [m]")
    inertia: tuple[float, ...] = Field(
        min_length=6, max_length=6, description="about the root: xx, xy, yy, xz, yz, zz [kg m^2]"
    )
    mode: tuple[Mode, ...] = Field(default=(), description="list of tables `[[effect.mode]]`, see below")
    stations: tuple[Vector3, ...] = Field(
        default=(), description="where accelerometers sit, appendage axes [m]"
    )

    @model_validator(mode="after")
    def _shapes_match_stations(self) -> ModalAppendage:
        for k, mode in enumerate(self.mode, start=1):
            if len(mode.shape) != len(self.stations):
                raise ValueError(
                    f"mode {k} of '{self.name}' gives its shape at {len(mode.shape)} points, "
                    f"the appendage has {len(self.stations)} stations"
                )
        return self

    def modal_data(self) -> tuple[Mode, ...]:
        """Return the modes, their participation and shapes as `participation_factor` has them."""
        if self.participation_factor == 1.0:
            return self.mode
        root = float(np.sqrt(self.participation_factor))
        return tuple(
            mode.model_copy(
                update={
                    "translation": tuple(root * x for x in mode.translation),
                    "rotation": tuple(root * x for x in mode.rotation),
                    "shape": tuple(tuple(x / root for x in s) for s in mode.shape),
                }
            )
            for mode in self.mode
        )

    def rigid_inertia(self) -> pin.Inertia:
        """Return the rigid inertia (about its CM, lever from the root)."""
        xx, xy, yy, xz, yz, zz = self.inertia
        about_root = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        lever = np.asarray(self.center_of_mass)
        return pin.Inertia(self.mass, lever, about_root - self.mass * _point(lever))

    def station_positions(self) -> np.ndarray:
        """Return the stations in appendage axes, (stations, 3) [m]."""
        return np.asarray(self.stations, dtype=float).reshape(-1, 3)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return mass, and of every mode frequency, damping and the participation that is not zero."""
        found = list(super().parameters())
        for k, mode in enumerate(self.mode, start=1):
            values = [
                (f"{f}", getattr(mode, f), unit, 0.0) for f, unit in (("frequency", "Hz"), ("damping", "1"))
            ]
            for field, unit in (("translation", "kg^0.5"), ("rotation", "kg^0.5 m")):
                parts = zip("xyz", getattr(mode, field), strict=True)
                values += [(f"{field}.{axis}", x, unit, -math.inf) for axis, x in parts if x != 0.0]
            for field, value, unit, lower in values:
                key = f"mode{k}.{field}"
                name = f"{self.name}.{key}"
                found.append(Parameter(name, value, unit, lower, sigma=self.prior.get(key)))
        return tuple(found)

    def with_values(self, values: Mapping[str, float]) -> ModalAppendage:
        """Return the appendage with the named parameters replaced.

        Raises `DescriptionError` for a name it does not have, or a value it cannot have.
        """
        self._check_names(values)
        update: dict[str, Any] = {}
        modes = [dict(mode) for mode in self.mode]
        for name, value in values.items():
            field, _, part = name.removeprefix(f"{self.name}.").partition(".")
            if part:
                own = modes[int(field.removeprefix("mode")) - 1]
                part, _, axis = part.partition(".")
                if axis:
                    vector = list(own[part])
                    vector["xyz".index(axis)] = float(value)
                    own[part] = tuple(vector)
                else:
                    own[part] = float(value)
            else:
                update[field] = float(value)
        return cast(ModalAppendage, self._replaced({**update, "mode": modes}))
