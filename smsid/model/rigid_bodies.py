"""The rigid bodies of a description alone: links as the URDFs have them, with what effects add to them."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pinocchio as pin

from smsid.description.schema import Description
from smsid.effects.assembly import Assembly
from smsid.effects.base import Effect
from smsid.effects.inertial_parameters import move_parameters
from smsid.model.build import build_model, rebuild
from smsid.model.load import load_bus, mount_arm
from smsid.model.spacecraft import SpacecraftModel


def rigid_model(description: Description) -> SpacecraftModel:
    """Return the model of the bodies alone, those that ``adds_to_body`` in them, which still knows all the
    description's effects.

    Args:
        description: of a spacecraft or an arm; a joint without inertia is no error here.

    Raises:
        DescriptionError: as `smsid.model.build_model`.
    """
    added = tuple(e for e in description.effect if e.adds_to_body)
    model = build_model(_with_scaffold(description, added))
    model.pin.armature[:] = 0.0
    return replace(model, description=description)


def urdf_bodies(description: Description) -> dict[str, np.ndarray]:
    """Return the parameters (10,) of every moving body of the URDFs by joint, without wheels and effects.

    Raises:
        DescriptionError: as `smsid.model.build_model`.
    """
    loaded = load_bus(description, False)
    for arm in description.arm:
        if arm.mounted:
            loaded, _ = mount_arm(loaded, arm, description)
    return _parameters(loaded.model)


def described_bodies(description: Description) -> dict[str, np.ndarray]:
    """Return `urdf_bodies` (10,) with what effects add that are part of a body: payloads, ``body_error``.

    Raises:
        DescriptionError: as `smsid.model.build_model`.
    """
    found = urdf_bodies(description)
    if not any(e.adds_to_body for e in description.effect):
        return found
    full = rigid_model(description)
    bare = _parameters(rebuild(full, _with_scaffold(description)).pin)
    return {name: theta + _parameters(full.pin)[name] - bare[name] for name, theta in found.items()}


def with_shifts_as_numbers(description: Description) -> Description:
    """Return a description whose effects add numbers to its bodies, no shares of them: the bodies may become
    others, as when an identified one is written into a URDF.

    Raises:
        DescriptionError: as `smsid.model.build_model`.
    """
    if not any(e.adds_to_body for e in description.effect):
        return description
    bare = rigid_model(description.model_copy(update={"effect": ()})).pin
    assembly = Assembly(bare, base=1 if description.root == "free" else 0)
    effects = []
    for e in description.effect:
        if e.adds_to_body and e.shifted_body is not None:
            joint, offset = assembly.frame(getattr(e, e.shifted_body))
            own = np.asarray(bare.inertias[joint].toDynamicParameters())
            e = e.without_share(move_parameters(offset.inverse(), own))
        effects.append(e)
    return description.with_effects(*effects)


def _parameters(model: pin.Model) -> dict[str, np.ndarray]:
    return {
        model.names[j]: np.asarray(model.inertias[j].toDynamicParameters()) for j in range(1, model.njoints)
    }


class _Scaffold(Effect):
    """Lets a model be built whose links alone leave a joint without inertia: torques need no forward
    dynamics.
    """

    kind: Literal["scaffold"] = "scaffold"

    def attach(self, assembly: Assembly) -> None:
        assembly.model.armature[:] = 1.0


def _with_scaffold(description: Description, effects: tuple[Effect, ...] = ()) -> Description:
    return description.model_copy(update={"effect": (*effects, _Scaffold(name="scaffold"))})
