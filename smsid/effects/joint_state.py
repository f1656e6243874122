"""What effects say of joints: torques at N instants by the joint's state, and what other simulators have."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from smsid._short_repr import short_repr
from smsid.errors import DescriptionError


@short_repr
@dataclass(frozen=True)
class JointState:
    """``rate`` and ``acceleration`` (N,) of a joint [rad/s | m/s, per s].

    ``angle`` (N,) [rad | m], ``load`` (N,), the torque that drives it [N m | N], and ``temperature`` (N,)
    [degC] are ``None`` where they are not known.
    """

    rate: np.ndarray
    acceleration: np.ndarray
    angle: np.ndarray | None = None
    load: np.ndarray | None = None
    temperature: np.ndarray | None = None

    def known(self, what: str, effect: str) -> np.ndarray:
        """Return ``angle``, ``load`` or ``temperature`` (N,); raises `DescriptionError` if not known."""
        if (value := getattr(self, what)) is None:
            raise DescriptionError(
                f"'{effect}' needs the {what} of its joint.",
                advice=f"Measure it (a channel 'joint_{'position' if what == 'angle' else what}'), or leave "
                "that law or effect out.",
                effect=effect,
            )
        return value


JointStateOf = Callable[[str], JointState]
"""The state of a joint by its name."""

TorqueColumns = dict[str, dict[str, np.ndarray]]
"""Torques (N,) [N m | N] per unit of a parameter, by field and joint."""


@dataclass(frozen=True)
class Counterpart:
    """What acts on a weighted sum of joints, in the terms that other simulators have.

    ``weights`` are those of the joints in the sum, by name. ``torque`` [N m | N] pushes it;
    ``stiffness`` [N m/rad | N/m] is against it, ``damping`` [N m s/rad | N s/m] and ``dry`` friction [N m |
    N] against its rate; ``inertia`` [kg m^2 | kg] is of a
    rotor that turns with it, single joints' shares included. Springs and dampers that the model has as such
    are not counted again. ``note`` says what was left out, and how far off the rest is.
    """

    weights: Mapping[str, float]
    torque: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    dry: float = 0.0
    inertia: float = 0.0
    note: str = ""
