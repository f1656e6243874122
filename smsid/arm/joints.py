"""Which joints an arm's recording is about."""

from __future__ import annotations

from collections.abc import Sequence

from smsid.errors import DescriptionError, RecordingError
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording


def name_patterns(names: Sequence[str]) -> list[str]:
    """Return patterns for names: ``hand_*`` for three or more that begin alike up to their first
    underscore.
    """
    families: dict[str, list[str]] = {}
    for name in names:
        families.setdefault(name.partition("_")[0], []).append(name)
    return [p for stem, own in families.items() for p in ([f"'{stem}_*'"] if len(own) > 2 else own)]


def unlabelled_error(channel: str) -> RecordingError:
    """Return the error of a channel whose joints have no names."""
    return RecordingError(
        f"The joints of '{channel}' have no names.",
        advice="State labels = [...] in the mapping.",
        channel=channel,
    )


def with_joint_order(model: SpacecraftModel, recording: Recording) -> Recording:
    """Return the recording with its joints in the order of the model's arm joints.

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
    labels = recording.labels
    for name in recording.channels:
        dims = [d for d in recording.columns(name) if d.rpartition(".")[2] == "joint"]
        if any(d not in labels for d in dims):
            raise unlabelled_error(name)
    try:
        ordered = order_columns(recording, model)
    except RecordingError as error:
        lacking = error.evidence.get("lacking", ())
        if not lacking:
            raise
        held = (
            f"Hold joints that were not measured: --hold {' --hold '.join(name_patterns(lacking))}. "
            "Of one that bends and has no motor only the torque may be missing: --passive."
        )
        raise RecordingError(error.message, advice=f"{error.advice} {held}", **error.evidence) from error
    if model.followers is not None:
        led = ", ".join(
            f"'{n}' ('{k}')" for n, k in zip(model.followers.names, model.followers.leaders, strict=True)
        )
        raise DescriptionError(
            f"Joints follow others: {led}. One torque drives both; torques are not shared out among them.",
            advice="Hold the leaders (--hold), or list them in the arm's `fixed`; a free-floating recording "
            "identifies all of them.",
            joints=model.followers.names,
        )
    return ordered
