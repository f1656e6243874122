"""Equations (7)-(15) made callable: Lagrange in quasi-coordinates from T, V and the dissipation function.

Every part's contribution comes from `derivation.py`; they add up. Ordering of velocities everywhere:
[v_b (3), omega_b (3), wheels (3), arm (3), rho_dot (3), delta_dot (3)]; `accelerations` is the component-wise
derivative of these in body axes (what a rigid-body library calls the spatial acceleration of a free-flyer).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from .derivation import compile_part
from .numbers import PAPER, Spacecraft
from .state import Array, Inputs, State

PanelVariant = Literal["exact", "first_order", "frozen", "point_masses"]


@dataclass(frozen=True)
class Terms:
    """All terms at one state, SI units, body axes."""

    energy: float  # T + V [J]
    momenta: Array  # (18,) dT/du
    mass: Array  # (18, 18)
    bias: Array  # (18,), so that mass @ vdot + bias = generalized forces
    loss: float  # power lost in dampers, 2 F [W]


@dataclass(frozen=True)
class SymbolicTwin:
    """The derived model with numbers put in."""

    numbers: Spacecraft = PAPER
    panel: PanelVariant = "exact"

    def terms(self, state: State) -> Terms:
        """Sum of all parts at `state`; entries may be complex, for complex-step differentiation."""
        u = state.velocity.tolist()
        s = np.concatenate([state.wheel, state.q, state.rho, state.delta]).tolist()
        axes = tuple(link.axis for link in self.numbers.links)
        energy, loss = 0.0, 0.0
        momenta, mass, bias = np.zeros(18), np.zeros((18, 18)), np.zeros(18)
        for part, parameters in self._parameters().items():
            e, p, m, c, d = compile_part(part, axes if part.startswith("link") else ())(u, s, parameters)
            energy, loss = energy + e, loss + d
            momenta, mass, bias = momenta + np.array(p), mass + np.array(m), bias + np.array(c)
        return Terms(energy, momenta, mass, bias, loss)

    def momentum(self, state: State, about: Literal["body", "inertial"] = "body") -> tuple[Array, Array]:
        """Linear (7) and angular (8)-(9) momentum, both (3,) in body axes [N s], [N m s].

        `about`: the body origin, or the inertial origin as (8) has it.
        """
        momenta = self.terms(state).momenta
        p, h = momenta[:3], momenta[3:6]
        if about == "inertial":
            h = h + np.cross(state.attitude.T @ state.position, p)
        return p, h

    def accelerations(self, state: State, inputs: Inputs) -> Array:
        """Solve (10)-(15) for the derivative (18,) of `State.velocity` [m/s2, rad/s2, ...]."""
        terms = self.terms(state)
        return np.linalg.solve(terms.mass, inputs.generalized - terms.bias)

    def mass_matrix(self, state: State) -> Array:
        """(18, 18) mass matrix dual to `State.velocity`."""
        return self.terms(state).mass

    def energy(self, state: State) -> float:
        """T + V [J]."""
        return self.terms(state).energy

    def _parameters(self) -> dict[str, list[float]]:
        """Numbers of each part in the order of `derivation.py`."""
        n, plate = self.numbers, self.numbers.panel
        spin = list(n.wheel_inertia)
        bare = [i - s for i, s in zip(n.base_inertia[:3], spin, strict=True)]
        parts: dict[str, list[float]] = {"base": [n.base_mass, *bare, *n.base_inertia[3:]], "wheels": spin}
        tips: list[float] = []
        for k, link in enumerate(n.links):
            parts[f"link{k}"] = [
                *n.arm_mount,
                *n.arm_rotation.ravel().tolist(),
                *tips,
                link.mass,
                *link.centre,
                *link.inertia,
            ]
            tips += link.tip
        parts["slosh"] = [n.slosh_mass, *n.slosh_stiffness, *n.slosh_damping, *n.slosh_centre]
        mass = plate.mass
        second = [plate.length**2 / 3, plate.width**2 / 12, plate.thickness**2 / 12]
        moments = [mass, mass * plate.length / 2, *(mass * s for s in second)]
        modes = [*plate.translation, *plate.rotation, *plate.omega, plate.damping_ratio]
        parts[f"panel:{self.panel}"] = [*n.panel_root, *moments, *modes]
        return parts
