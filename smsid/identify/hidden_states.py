"""Estimating what Exp. 2 does not measure: slosh of every tank, modes of every appendage."""

from __future__ import annotations

from typing import Literal

import numpy as np

from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify.modal_state import integrate_accelerometers, smooth_modes
from smsid.identify.momentum import HiddenStates
from smsid.identify.motion import Motion
from smsid.identify.robust import white_sigma
from smsid.identify.slosh_state import estimate_slosh
from smsid.model.spacecraft import SpacecraftModel

Modal = Literal["smoother", "printed"]
LEAST_NOISE = 1e-9  # [m/s^2], so that a noise-free recording weighs finitely


def hidden_states(model: SpacecraftModel, motion: Motion, modal: Modal = "smoother") -> HiddenStates:
    """Return slosh and modal states from the measured motion and the parameters in the model.

    ``modal``: 'smoother' (`smooth_modes`; without accelerometers the modes follow the base's motion alone) or
    'printed' (`integrate_accelerometers`). Raises `NotIdentifiableError` for 'printed' without
    accelerometers, and for tanks or appendages on a moving link; `SmsidError` for another ``modal``.
    """
    if modal not in ("smoother", "printed"):
        raise SmsidError(f"There is no modal estimator '{modal}'.", advice="Use 'smoother' or 'printed'.")
    check_on_bus(model)
    slosh, modes = {}, {}
    for joint in model.slosh:
        tank = joint.tank
        slosh[joint.name] = estimate_slosh(
            motion, joint.position, tank.mass, np.array(tank.stiffness), np.array(tank.damping)
        )
    imu = _noise(motion.acceleration)
    for joints in model.appendages:
        name = joints.appendage.name
        seen = motion.panels.get(name)
        if modal == "printed":
            if seen is None:
                raise NotIdentifiableError(
                    f"(31)-(32) need accelerometers on '{name}'; the recording has none.",
                    advice="Use the smoother, which can do without, or record them.",
                )
            modes[name] = integrate_accelerometers(motion, joints)
        else:
            noise = imu if seen is None else _noise(seen)
            modes[name] = smooth_modes(motion, joints, accelerometer=noise, imu=imu)
    again = hidden_states(model, motion.again, modal) if motion.again else None
    return HiddenStates(slosh, modes, again)


def check_on_bus(model: SpacecraftModel) -> None:
    """Raise `NotIdentifiableError` unless tanks and appendages sit on the bus, springs along its axes."""
    for joint in model.slosh:
        turned = not np.allclose(model.pin.jointPlacements[joint.joint].rotation, np.eye(3), atol=1e-9)
        if model.pin.parents[joint.joint] != 1 or turned:
            raise NotIdentifiableError(
                f"Tank '{joint.name}' "
                + ("has springs turned from the bus axes." if turned else "sits on a moving link."),
                advice="The paper's method needs tanks on the bus with springs along its axes; use maximum "
                "likelihood.",
            )
    for appendage in model.appendages:
        if appendage.parent != 1:
            raise NotIdentifiableError(
                f"Appendage '{appendage.appendage.name}' sits on a moving link.",
                advice="The paper's method needs appendages on the bus; use maximum likelihood.",
            )


def _noise(x: np.ndarray) -> float:
    return max(float(np.sqrt(np.mean(white_sigma(x) ** 2))), LEAST_NOISE)
