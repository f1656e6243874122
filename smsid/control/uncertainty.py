"""A controller's model with wrong parameters: what "5 % uncertainty" can mean, kept physical."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin

from smsid.control.reduced import ReducedDynamics
from smsid.errors import ControlError

Draw = Literal["uniform", "signs", "common"]


def perturbed(
    dynamics: ReducedDynamics, level: float, rng: np.random.Generator, draw: Draw = "uniform"
) -> ReducedDynamics:
    """Return the dynamics with every body's mass, centre of mass and inertia off by up to ``level``.

    Per body one factor on the mass, one on the lever to the centre of mass, one on the inertia about it: each
    body stays one that can exist. ``uniform`` draws each factor within 1 +- level, ``signs`` takes one of the
    two ends, ``common`` one uniform factor for all masses and inertias. The wheels are known (section V). The
    same generator state gives the same pattern at any level.

    Raises `ControlError` for a level outside [0, 1) or an unknown way to draw.
    """
    if not 0.0 <= level < 1.0:
        raise ControlError(f"An uncertainty of {level} is not in [0, 1).", advice="Give 0.05 for 5 %.")
    wheels = set(dynamics.wheels.joints.tolist())
    inertias = []
    bodies = dynamics.pin.njoints - 1
    if draw == "uniform":
        pattern = rng.uniform(-1.0, 1.0, (bodies, 3))
    elif draw == "signs":
        pattern = rng.choice([-1.0, 1.0], (bodies, 3))
    elif draw == "common":
        pattern = np.tile([1.0, 0.0, 1.0], (bodies, 1)) * rng.uniform(-1.0, 1.0)
    else:
        raise ControlError(f"There is no way to draw '{draw}'.", advice="Use uniform, signs or common.")
    for k in range(bodies):
        body = dynamics.pin.inertias[k + 1]
        mass, lever, inertia = 1.0 + level * pattern[k]
        changed = pin.Inertia(mass * body.mass, lever * body.lever, inertia * body.inertia)
        inertias.append(body.copy() if k + 1 in wheels else changed)
    return dynamics.with_inertias(inertias)
