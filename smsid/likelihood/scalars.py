"""Scalar parameters: slosh masses, springs and dampers, densities, frequencies and damping ratios."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from smsid.model.spacecraft import SpacecraftModel


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
