"""Units of what is about a joint: radians and newton metres if it turns, metres and newtons if it slides."""

from __future__ import annotations

from smsid.effects.spatial import turns
from smsid.errors import DescriptionError
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording.channels import SLIDING


def slides(model: SpacecraftModel, joint: str) -> bool:
    """Whether a joint of the model slides; one that the model does not have turns."""
    if not model.pin.existJointName(joint):
        return False
    number = int(model.pin.getJointId(joint))
    return model.pin.joints[number].nv == 1 and not turns(model.pin, number)


def joint_unit(unit: str, model: SpacecraftModel, *joints: str) -> str:
    """Return the unit of a quantity of joints, of which ``unit`` is that of joints that turn.

    Raises:
        DescriptionError: the joints share a parameter, and one slides while another turns.
    """
    kinds = {slides(model, j) for j in joints}
    if len(kinds) > 1:
        raise DescriptionError(
            f"Joints {', '.join(joints)} share a parameter, but one slides and another turns.",
            advice="Give each an effect of its own.",
            joints=joints,
        )
    return SLIDING.get(unit, unit) if kinds == {True} else unit
