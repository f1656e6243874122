"""Which joints an arm's recording is about."""

from __future__ import annotations

import numpy as np

from smsid.errors import DescriptionError, RecordingError
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording


def recorded_joints(model: SpacecraftModel, recording: Recording) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the joints in the order of the recording, and the place of each among the model's (joints,).

    Raises:
        DescriptionError: the model is not a welded arm, or has degrees of freedom besides its arms'.
        RecordingError: joints are unlabelled, or not exactly the model's.
    """
    if model.free:
        raise DescriptionError(
            f"'{model.description.name}' floats; identification from joint torques takes a welded arm.",
            advice='Set root = "fixed" and its gravity; a floating one is identified by `smsid identify`.',
        )
    if len(model.arm_joints) != model.nv:
        raise DescriptionError(
            f"The model has {model.nv} degrees of freedom, {len(model.arm_joints)} of them joints of an arm.",
            advice="Weld or leave out what is not the arm's.",
        )
    if "joint" not in recording.labels:
        raise RecordingError(
            "The joints of the recording have no names.", advice="State labels = [...] in the mapping."
        )
    labels = recording.labels["joint"]
    place = {name: k for k, name in enumerate(model.arm_joints.names)}
    lacking, strangers = sorted(set(place) - set(labels)), sorted(set(labels) - set(place))
    if lacking or strangers:
        raise RecordingError(
            f"The recording's joints do not fit the model's: lacking {lacking}, unknown {strangers}.",
            advice=f"Joints of the model: {', '.join(place)}. Correct the labels; weld joints that do not "
            "move.",
            lacking=tuple(lacking),
            unknown=tuple(strangers),
        )
    v = model.arm_joints.v
    return labels, np.array([int(v[place[name]]) for name in labels])
