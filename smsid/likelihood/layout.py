"""What does not change while parameters do: which bodies there are, and what slosh and appendages add."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from smsid.effects.assembly import AppendageJoints
from smsid.effects.inertial_parameters import move_parameters
from smsid.likelihood.pseudo_inertia import SIZE
from smsid.model.regressor import body_names, dynamic_parameters
from smsid.model.spacecraft import SpacecraftModel


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
