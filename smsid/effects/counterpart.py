"""What other simulators have of an effect: constant torque, damper, dry friction, the inertia of a rotor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Counterpart:
    """What acts on a weighted sum of joints, in the terms that other simulators have.

    ``weights`` are those of the joints in the sum, by name. ``torque`` [N m | N] pushes it; ``damping``
    [N m s/rad | N s/m] and ``dry`` friction [N m | N] are against its rate; ``inertia`` [kg m^2 | kg] is of a
    rotor that turns with it, single joints' shares included. Springs and dampers that the model has as such
    are not counted again. ``note`` says what was left out, and how far off the rest is.
    """

    weights: Mapping[str, float]
    torque: float = 0.0
    damping: float = 0.0
    dry: float = 0.0
    inertia: float = 0.0
    note: str = ""
