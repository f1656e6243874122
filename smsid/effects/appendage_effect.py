"""Effects on an appendage: errors of its modes, modes left out, and where it comes to rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from smsid.effects.assembly import AppendageJoints, Assembly
from smsid.effects.base import Effect, SigmaOf, Starting, Vector3, physical, register
from smsid.effects.force_laws import ConstantForce, DriftOfSpring
from smsid.effects.payload import point_parameters
from smsid.errors import DescriptionError

if TYPE_CHECKING:
    from smsid.effects.appendage import BeamAppendage, Mode


class AppendageEffect(Effect):
    """An effect on an appendage that stands before it."""

    family = "appendage"
    appendage: str = Field(description="name of the appendage, which stands before this effect")

    def part_of(self) -> str:
        """Return the appendage."""
        return self.appendage

    def panel(self, assembly: Assembly) -> AppendageJoints:
        """Return the appendage as it is attached; raises `DescriptionError` without it."""
        for panel in assembly.appendages:
            if panel.appendage.name == self.appendage:
                return panel
        known = ", ".join(p.appendage.name for p in assembly.appendages) or "none"
        raise DescriptionError(
            f"There is no appendage '{self.appendage}' before this effect.",
            advice=f"So far: {known}.",
            appendage=self.appendage,
        )


class BeamEffect(AppendageEffect):
    """An effect that only a beam can have."""

    appendage: str = Field(description="name of a `beam_appendage`, which stands before this effect")

    def beam(self, assembly: Assembly) -> tuple[AppendageJoints, BeamAppendage]:
        """Return it where it is a beam; raises `DescriptionError` of any other."""
        from smsid.effects.appendage import BeamAppendage

        panel = self.panel(assembly)
        if not isinstance(panel.appendage, BeamAppendage):
            raise DescriptionError(
                f"'{self.appendage}' is no beam_appendage, so {self.needs_beam} not known.",
                advice="Leave the effect out (`extra_mode` adds a mode to any), or describe it as a beam.",
            )
        return panel, panel.appendage


class ModeEffect(AppendageEffect):
    """An effect on one mode of an appendage."""

    mode: int = Field(default=1, ge=1, description="number of the mode, from 1")

    def mode_joint(self, assembly: Assembly) -> tuple[int, Mode, float]:
        """Return the mode's joint, the mode, and its mass by the joint's coordinate [kg | kg m^2].

        Raises `DescriptionError` without such a mode.
        """
        panel = self.panel(assembly)
        modes = panel.appendage.modal_data()
        if self.mode > len(modes):
            raise DescriptionError(
                f"'{self.appendage}' has {len(modes)} modes, not {self.mode}.",
                advice="Count from 1.",
                mode=self.mode,
            )
        k = self.mode - 1
        return panel.joints[k], modes[k], float(panel.scale[k]) ** 2


@register
class ModeError(ModeEffect):
    """A mode's clamped frequency is ``1 + frequency`` times the appendage's, its damping ratio larger by
    ``damping``. A beam's own parameters move all its modes together; this moves one.
    """

    nominal = True
    summary = "frequency and damping of one mode, apart from the appendage's others"
    aliases = ("frequency_drift", "geometric_stiffness")
    strength = ("frequency", "damping")
    in_words = "{place} bends at another frequency or damping than described"
    kind: Literal["mode_error"] = "mode_error"
    frequency: float = physical(
        "1", default=0.0, lower=-0.9, gt=-1.0, description="relative error of its frequency"
    )
    damping: float = physical("1", default=0.0, description="error of its damping ratio")
    by_batch = in_modes = True

    def estimated_as(self, effects: Sequence[Effect]) -> Effect | None:
        """Return nothing where the appendage is estimated by its modes, and so is the error."""
        own = next((e for e in effects if e.name == self.appendage), self)
        return self if own.estimated_as(effects) is own else None

    def estimated_sigmas(self, sigma: SigmaOf, relative: SigmaOf) -> dict[str, float]:
        """Return standard deviations: what the first mode, the beam's, is off by is in them, too."""
        first, own = (f"{self.appendage}.mode{k}" for k in (1, self.mode))
        frequency = [relative(f"{m}.frequency") for m in (first, own)]
        damping = [sigma(f"{m}.damping") for m in (first, own)]
        return {
            "frequency": (1.0 + self.frequency) * float(np.linalg.norm(frequency)),
            "damping": float(np.linalg.norm(damping)),
        }

    def attach(self, assembly: Assembly) -> None:
        """Add the forces of the changed spring and damper. Raises `DescriptionError` without such a mode."""
        joint, mode, mass = self.mode_joint(assembly)
        if self.frequency == 0.0 and self.damping == 0.0:
            return
        omega, grown = 2 * np.pi * mode.frequency, 1.0 + self.frequency
        spring = mass * omega**2 * (grown**2 - 1.0)
        damper = 2.0 * mass * omega * ((mode.damping + self.damping) * grown - mode.damping)
        assembly.add_springs(joint, [spring], [damper])


@register
class FrequencyDrift(ModeEffect, Starting):
    """The clamped frequency of a mode is ``1 + rate (t - start)`` times that of the appendage (start: 0 s).

    Its stiffness goes with the square; the damper stays what it is.
    """

    summary = "bending frequency that drifts"
    aliases = ("geometric_stiffness",)
    grows = True
    strength = ("rate",)
    in_words = "the frequency of {place} drifts"
    kind: Literal["frequency_drift"] = "frequency_drift"
    rate: float = physical("1/s", default=0.0, description="relative change of the frequency per time")

    def attach(self, assembly: Assembly) -> None:
        """Add the force of the change of stiffness; raises `DescriptionError` for a mode there is not."""
        number, mode, mass = self.mode_joint(assembly)
        if self.rate == 0.0:
            return
        joint = assembly.model.joints[number]
        stiffness = mass * (2 * np.pi * mode.frequency) ** 2
        own = stiffness, self.rate, self.start or 0.0
        assembly.add_force(DriftOfSpring(joint.idx_v, joint.idx_q, *own))


@register
class ThermalSnap(BeamEffect, Starting):
    """From ``start`` on, a `beam_appendage` rests bent, its tip by ``deflection`` along its z axis.

    A difference of temperature across a uniform beam bends it by the same curvature ``kappa`` all along,
    ``w = kappa x^2 / 2``. On a mass-normalised mode ``phi`` that is a force ``E I kappa phi'(L)``.

    Source: Boley and Weiner, *Theory of Thermal Stresses* (1960), chapter 10; Thornton and Kim,
    J. Guidance 16 (1993) 1103.
    """

    summary = "a step of where a panel comes to rest, as by heat on one side (thermal snap)"
    needs_beam = "how it bends at rest is"
    aliases = ("external_wrench",)
    strength = ("deflection",)
    in_words = "{place} comes to rest bent, as by heat on one side"
    kind: Literal["thermal_snap"] = "thermal_snap"
    deflection: float = physical("m", default=0.0, description="of the tip at rest, along its z axis")

    def attach(self, assembly: Assembly) -> None:
        """Add the forces on the modes; raises `DescriptionError` unless it is a beam."""
        panel, beam = self.beam(assembly)
        if self.deflection == 0.0:
            return
        curvature = 2.0 * self.deflection / beam.length**2
        slopes = beam.cantilever.slope(beam.length) / np.sqrt(beam.mass)
        forces = beam.bending_stiffness * curvature * slopes * panel.scale
        index = [assembly.model.joints[j].idx_v for j in panel.joints]
        assembly.add_force(ConstantForce(index, forces))


@register
class ExtraMode(AppendageEffect):
    """One more mode of an appendage: ``mass`` of it slides on a spring at ``position`` along ``direction``.

    With n the unit vector of the direction its participation factors are ``L_t = sqrt(mass) n`` and ``L_r =
    position x L_t``. The mass is taken out of the rigid rest. Stations do not see the mode, as its shape is
    not known there.
    """

    nominal = True
    summary = "one more bending mode of an appendage, as a mass on a spring"
    aliases = ("slosh", "frequency_drift")
    strength = ("mass",)
    in_words = "{place} has a mode that the description lacks"
    kind: Literal["extra_mode"] = "extra_mode"
    mass: float = physical("kg", lower=0.0, default=0.0, description="modal mass, the square of L_t")
    position: Vector3 = physical("m", description="where it sits, appendage axes")
    direction: Vector3 = Field(default=(0.0, 0.0, 1.0), description="along which it moves, appendage axes")
    frequency: float = physical("Hz", lower=0.0, gt=0.0, description="of the clamped mode")
    damping: float = physical("1", lower=0.0, may_vanish=True, default=0.005, description="damping ratio")

    @model_validator(mode="after")
    def _moves_somewhere(self) -> ExtraMode:
        if not any(self.direction):
            raise ValueError("`direction` must not be zero")
        return self

    def attach(self, assembly: Assembly) -> None:
        """Add the mass on its spring, and take it from the body that carries the appendage."""
        panel = self.panel(assembly).appendage
        if self.mass == 0.0:
            return
        axis = np.asarray(self.direction) / np.linalg.norm(self.direction)
        place = panel.placement * pin.SE3(np.eye(3), np.asarray(self.position))
        joint = assembly.add_joint(panel.frame, pin.JointModelPrismaticUnaligned(axis), place, self.name)
        assembly.add_inertia(joint, pin.Inertia(self.mass, np.zeros(3), np.zeros((3, 3))))
        omega = 2 * np.pi * self.frequency
        assembly.add_springs(joint, (self.mass * omega**2,), (2 * self.damping * omega * self.mass,))
        assembly.add_remainder(panel.frame, point_parameters(-self.mass, np.zeros(3)), place)
