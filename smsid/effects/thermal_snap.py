"""A panel that comes to rest elsewhere: heated on one side, as when it leaves the shadow."""

from __future__ import annotations

from typing import Literal

import numpy as np

from smsid.effects.appendage_effect import BeamEffect
from smsid.effects.assembly import Assembly
from smsid.effects.base import Starting, physical, register


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
        length, shapes = beam.length, beam.cantilever
        omega = 2.0 * np.pi * beam.modal_data()[0].frequency
        bending = beam.linear_density * omega**2 * (length / shapes.roots[0]) ** 4  # E I [N m^2]
        curvature = 2.0 * self.deflection / length**2
        forces = bending * curvature * shapes.slope(length) / np.sqrt(beam.mass) * panel.scale
        index = [assembly.model.joints[j].idx_v for j in panel.joints]

        def force(t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
            tau[index] += forces

        assembly.add_force(force, ((), ()))
