"""Flexible appendages: bending modes as joints, from beam data or from finite-element modal data."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.appendage_effect import ModeError
from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect, SigmaOf, Vector3, physical, register
from smsid.effects.inertial_parameters import pinocchio_inertia
from smsid.effects.mode import Cantilever, Mode, mode_joints
from smsid.errors import DescriptionError
from smsid.parameter import Parameter

WIDE = 10.0  # standard deviation of a density without a prior, relative to the described one


class Appendage(Effect):
    """What beam and modal appendages share: root placement, rigid properties, modes, stations."""

    nominal = True
    family = "appendage"
    by_batch = True
    changes = {
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

    def higher_mode(self, number: int) -> Mode | None:
        """Return a mode beyond those of `modal_data`, or ``None`` where these are all that is known of it."""
        return None

    def bent_as(self, identified: Appendage) -> list[Effect]:
        """Return the effects that say of it what an identified appendage does: that one."""
        return [identified]

    def mass_parameter(self) -> Parameter:
        """Return by what an estimate says how heavy it is: a factor on the described modal masses."""
        return Parameter(f"{self.name}.participation_factor", 1.0, "1", 0.0)

    def rigid_inertia(self) -> pin.Inertia:
        """Return the rigid-body inertia in appendage axes, about the root."""
        raise NotImplementedError

    def station_positions(self) -> np.ndarray:
        """Return the stations in appendage axes, (stations, 3) [m]."""
        raise NotImplementedError

    def plate(self) -> tuple[tuple[float, float, float], Callable[[np.ndarray], np.ndarray]] | None:
        """Return length, width, thickness [m] of the plate that it is, and how the modes deflect it.

        The plate lies along x with z across it; at distances x (S,) [m] from the root a unit of the modes'
        coordinates moves it along z by (S, modes) [kg^-.5]. ``None``: that is known at the stations alone.
        """
        return None

    def identified_as(self, modal: ModalAppendage, effects: Sequence[Effect]) -> Sequence[Effect]:
        """Return it among effects with the modes and the mass that modal data of it have."""
        return (modal,)

    def as_appendage(self) -> Appendage:
        """Return itself."""
        return self

    def described_modes(self, effects: Sequence[Effect]) -> tuple[Mode, ...]:
        """Return its modes with what `mode_error` effects among others correct.

        Springs and dampers of several errors of one mode add up, as in the simulation. Raises
        `DescriptionError` for an error of a mode that it does not have.
        """
        plain = self.modal_data()
        modes = list(plain)
        springs, dampers = [1.0] * len(modes), [m.damping for m in modes]  # in those of its own frequency
        for error in effects:
            if not isinstance(error, ModeError) or error.appendage != self.name:
                continue
            if error.mode > len(modes):
                raise DescriptionError(
                    f"'{self.name}' has {len(modes)} modes of its own, not {error.mode}.",
                    advice="What a further mode is off by is its own `frequency` and `damping`.",
                    effect=error.name,
                )
            k, grown = error.mode - 1, 1.0 + error.frequency
            springs[k] += grown**2 - 1.0
            dampers[k] += (plain[k].damping + error.damping) * grown - plain[k].damping
            share = float(np.sqrt(max(springs[k], 0.0)))
            update = {"frequency": plain[k].frequency * share, "damping": max(dampers[k] / share, 0.0)}
            modes[k] = plain[k].model_copy(update=update)
        return tuple(modes)

    def as_modal(self, factor: float = 1.0, modes: Sequence[Mode] | None = None) -> ModalAppendage:
        """Return it as modal data, ``factor`` times as dense; ``modes`` stand for its own, at its density."""
        rigid = factor * self.rigid_inertia().toDynamicParameters()
        return ModalAppendage(
            name=self.name,
            frame=self.frame,
            position=self.position,
            rpy=self.rpy,
            mass=float(rigid[0]),
            center_of_mass=tuple((rigid[1:4] / rigid[0]).tolist()),
            inertia=tuple(rigid[4:].tolist()),
            mode=tuple(m.heavier(factor) for m in (self.modal_data() if modes is None else modes)),
            stations=tuple(tuple(float(x) for x in p) for p in self.station_positions()),
        )

    def attach(self, assembly: Assembly) -> None:
        """Add a joint per mode, and the rigid remainder to the body that carries the appendage."""
        rigid, modes, root = self.rigid_inertia(), self.modal_data(), self.placement
        parts, remainder = mode_joints(modes, tuple(rigid.toDynamicParameters().tolist()))
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


@register
class BeamAppendage(Appendage):
    """A rectangular plate bending as a cantilever: along its x axis, deflecting along its z axis.

    ``stations`` are distances from the clamp where sensors sit [m].
    """

    summary = "flexible panel: Euler-Bernoulli cantilever plate"
    geometry = ("length", "width", "thickness")
    in_words = "{place} bends otherwise than described"
    kind: Literal["beam_appendage"] = "beam_appendage"
    length: float = physical("m", lower=0.0, gt=0.0, description="along x, from the clamp")
    width: float = physical("m", lower=0.0, gt=0.0, description="along y")
    thickness: float = physical("m", lower=0.0, gt=0.0, description="along z, the direction it bends")
    density: float = physical("kg/m^3", lower=0.0, gt=0.0, description="mass per volume")
    youngs_modulus: float = physical("Pa", lower=0.0, gt=0.0, description="E")
    damping: float = physical(
        "1", lower=0.0, may_vanish=True, ge=0.0, description="damping ratio of every mode"
    )
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

    @property
    def bending_stiffness(self) -> float:
        """E I [N m^2]."""
        return self.youngs_modulus * self.width * self.thickness**3 / 12.0

    def mass_parameter(self) -> Parameter:
        """Return the linear density [kg/m]."""
        return Parameter(f"{self.name}.linear_density", self.linear_density, "kg/m", 0.0)

    @property
    def cantilever(self) -> Cantilever:
        """The beam's dimensionless modes."""
        return Cantilever.with_modes(self.length, self.modes)

    def estimated_as(self, effects: Sequence[Effect]) -> Effect:
        """Return its modes, frequency and damping of each, and its density: a panel is not quite a beam.

        What corrects single modes goes into them. One that another effect needs as a beam stays a beam.
        """
        if self._is_needed_by(effects):
            return self
        panel = self.as_modal(modes=self.described_modes(effects))
        numbered = [(f"mode{k}", mode) for k, mode in enumerate(panel.mode, start=1)]
        factor = self.prior["density"] / self.density if "density" in self.prior else WIDE
        prior = {"participation_factor": factor}
        if "youngs_modulus" in self.prior:
            relative = 0.5 * float(np.hypot(self.prior["youngs_modulus"] / self.youngs_modulus, factor))
            prior |= {f"{k}.frequency": relative * mode.frequency for k, mode in numbered}
        if "damping" in self.prior:
            prior |= {f"{k}.damping": self.prior["damping"] for k, _ in numbered}
        known = ["mass", *(f"{k}.{x}" for k, _ in numbered for x in ("translation", "rotation"))]
        known += ["participation_factor"] if "density" in self.known else []
        known += [f"{k}.frequency" for k, _ in numbered] if "youngs_modulus" in self.known else []
        known += [f"{k}.damping" for k, _ in numbered] if "damping" in self.known else []
        known = ["all"] if "all" in self.known else known
        own = {**dict(panel), "prior": prior, "known": tuple(known), "linear_density": self.linear_density}
        return BeamModes.model_construct(**own)

    def identified_as(self, modal: ModalAppendage, effects: Sequence[Effect]) -> Sequence[Effect]:
        """Return it as a beam where another effect needs one, else as modal data."""
        return self.bent_as(modal) if self._is_needed_by(effects) else (modal,)

    def _is_needed_by(self, effects: Sequence[Effect]) -> bool:
        return any(e.needs_beam and e.part_of() == self.name for e in effects)

    def bent_as(self, identified: Appendage) -> list[Effect]:
        """Return a beam that bends as an identified appendage does: the beam, and the errors of its modes.

        It has the identified density, Young's modulus from the first mode's frequency and that mode's
        damping; what the other modes are off by then are `mode_error` effects.
        """
        modes = identified.modal_data()
        factor = identified.rigid_inertia().mass / self.mass
        stiffer = factor * (modes[0].frequency / self.modal_data()[0].frequency) ** 2
        own = self.model_copy(
            update={
                "density": self.density * factor,
                "youngs_modulus": self.youngs_modulus * stiffer,
                "damping": modes[0].damping,
            }
        )
        out: list[Effect] = [own]
        for k, (mode, plain) in enumerate(zip(modes, own.modal_data(), strict=True), start=1):
            off = mode.frequency / plain.frequency - 1.0, mode.damping - plain.damping
            if k > 1 and any(off):
                name = re.sub(r"\W+", "_", f"mode_error_{self.name}_{k}")  # as a diagnosis has it
                error = ModeError(name=name, appendage=self.name, mode=k, frequency=off[0], damping=off[1])
                out.append(error)
        return out

    def estimated_sigmas(self, sigma: SigmaOf, relative: SigmaOf) -> dict[str, float]:
        """Return standard deviations: Young's modulus goes as density times frequency squared."""
        # the linear method calls it so where effects correct the beam's modes
        names = [f"{self.name}.{key}" for key in ("linear_density", "participation_factor")]
        density = next((s for n in names if np.isfinite(s := relative(n))), np.nan)
        frequency = relative(f"{self.name}.mode1.frequency")
        return {
            "density": density * self.density,
            "damping": sigma(f"{self.name}.mode1.damping"),
            "youngs_modulus": self.youngs_modulus * float(np.hypot(density, 2.0 * frequency)),
        }

    def plate(self) -> tuple[tuple[float, float, float], Callable[[np.ndarray], np.ndarray]]:
        """Return the plate and the cantilever's shapes."""
        beam, share = self.cantilever, self.mass**-0.5
        return (self.length, self.width, self.thickness), lambda x: beam.shape(x) * share

    def higher_mode(self, number: int) -> Mode:
        """Return mode ``number`` of the uniform beam."""
        return self.model_copy(update={"modes": number}).modal_data()[-1]

    def modal_data(self) -> tuple[Mode, ...]:
        """Return the bending modes of the cantilever, mass-normalised."""
        ei = self.bending_stiffness
        return _beam_modes(self.length, self.modes, self.mass, ei, self.damping, self.stations)

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

    summary = "flexible appendage from finite-element modal data"
    in_words = "{place} bends otherwise than described"
    kind: Literal["modal_appendage"] = "modal_appendage"
    geometry = ("mass", "participation_factor")
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
        return tuple(mode.heavier(self.participation_factor) for mode in self.mode)

    def rigid_inertia(self) -> pin.Inertia:
        """Return the rigid inertia (about its CM, lever from the root)."""
        first = self.mass * np.asarray(self.center_of_mass)
        return pinocchio_inertia(np.array([self.mass, *first, *self.inertia]))

    def station_positions(self) -> np.ndarray:
        """Return the stations in appendage axes, (stations, 3) [m]."""
        return np.asarray(self.stations, dtype=float).reshape(-1, 3)


class BeamModes(ModalAppendage):
    """A beam by its modes, whose participation factor is its density: the whole panel is heavier with it."""

    linear_density: float

    def rigid_inertia(self) -> pin.Inertia:
        """Return the rigid inertia (about its CM, lever from the root) at the density there is."""
        rigid, factor = super().rigid_inertia(), self.participation_factor
        return pin.Inertia(factor * rigid.mass, rigid.lever, factor * rigid.inertia)

    def described_as(self) -> ModalAppendage:
        """Return modal data that say the same without a factor."""
        return self.as_modal().model_copy(update={"known": self.known})

    def reported_as(self) -> dict[str, tuple[str, float]]:
        """Return the linear density [kg/m] as described, for the factor."""
        return {f"{self.name}.participation_factor": (f"{self.name}.linear_density", self.linear_density)}
