"""Estimating what Exp. 2 does not measure: slosh of every tank, modes of every appendage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from smsid._short_repr import short_repr
from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify.paper.modal_state import ModalState, integrate_accelerometers, smooth_modes
from smsid.identify.paper.motion import MeasuredMotion
from smsid.identify.paper.slosh_state import estimate_slosh
from smsid.identify.robust import white_sigma
from smsid.model.spacecraft import SpacecraftModel

Modal = Literal["smoother", "printed"]
LEAST_NOISE = 1e-9  # [m/s^2], so that a noise-free recording weighs finitely


@short_repr
@dataclass(frozen=True)
class HiddenStates:
    """What Exp. 2 does not measure, estimated: slosh by tank, modes by appendage.

    ``slosh`` holds (rho, rho') each (N, 3) bus axes, ``modes`` a `ModalState` each. ``again``: the same from
    the motion with as much noise once more, where there is one.
    """

    slosh: dict[str, tuple[np.ndarray, np.ndarray]]
    modes: dict[str, ModalState]
    again: HiddenStates | None = None

    def without_slosh(self) -> HiddenStates:
        """Return the modes alone: the slosh at rest, as (34) takes it."""
        return HiddenStates({}, self.modes, self.again.without_slosh() if self.again else None)

    def only(self, kept: slice) -> HiddenStates:
        """Return some of the samples."""
        slosh = {name: (rho[kept], rate[kept]) for name, (rho, rate) in self.slosh.items()}
        modes = {name: ModalState(m.position[kept], m.velocity[kept]) for name, m in self.modes.items()}
        return HiddenStates(slosh, modes, self.again.only(kept) if self.again else None)


def hidden_states(model: SpacecraftModel, motion: MeasuredMotion, modal: Modal = "smoother") -> HiddenStates:
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
                other_flight=True,
            )
    for appendage in model.appendages:
        if appendage.parent != 1:
            raise NotIdentifiableError(
                f"Appendage '{appendage.appendage.name}' sits on a moving link.",
                advice="The paper's method needs appendages on the bus; use maximum likelihood.",
                other_flight=True,
            )


def _noise(x: np.ndarray) -> float:
    return max(float(np.sqrt(np.mean(white_sigma(x) ** 2))), LEAST_NOISE)
