"""Joints that follow another and are not in a log: their columns are those of what they follow."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from smsid.recording.channels import split_channel
from smsid.recording.recording import Recording

if TYPE_CHECKING:
    from smsid.model.spacecraft import SpacecraftModel

MOVED = ("joint_position", "joint_velocity", "joint_acceleration")


def with_followers(recording: Recording, model: SpacecraftModel) -> Recording:
    """Return the recording with columns of the followers it lacks, where it has their leaders by label.

    Positions, rates, accelerations follow, with the leader's noise; a torque is zero, as the leader's motor
    drives both.
    """
    followers = model.followers
    labels = {
        k: [str(x) for x in own] for k, own in recording.labels.items() if k.rpartition(".")[2] == "joint"
    }
    if followers is None or not labels:
        return recording
    added: dict[str, list[tuple[int, float, float]]] = {}
    extended: dict[str, list[str]] = {}
    for key, own in labels.items():
        for name, leader, ratio, offset in zip(
            followers.names, followers.leaders, followers.ratio, followers.offset, strict=True
        ):
            place = _place(leader, own)
            if place is not None and _place(name, own) is None:
                added.setdefault(key, []).append((place, float(ratio), float(offset)))
                extended.setdefault(key, list(own)).append(name)
    if not added:
        return recording
    changed: dict[str, Any] = {}
    for channel in recording.channels:
        values = recording[channel]
        quantity = split_channel(channel)[1]
        for axis, dim in enumerate(recording.channel(channel).dims[1:], start=1):
            more = [
                (ratio * np.take(values, [k], axis=axis) + (offset if quantity == "joint_position" else 0.0))
                * (1.0 if quantity in MOVED else 0.0)
                for k, ratio, offset in added.get(str(dim), ())
            ]
            values = np.concatenate([values, *more], axis=axis)
        changed[channel] = (recording.time(channel), values)
    return Recording.from_arrays(
        recording.time() if "time" in recording.clocks else None,
        changed,
        labels={**recording.labels, **extended},
        units={n: u for n, u in recording.units.items() if n.startswith("extra.")},
        provenance=recording.provenance,
        role=recording.role,
        name=recording.name,
    )


def _place(name: str, labels: list[str]) -> int | None:
    for text in (name, name.rpartition("/")[2]):
        if text in labels:
            return labels.index(text)
    return None
