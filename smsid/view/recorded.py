"""The motion that a recording tells of, and what it leaves out."""

from __future__ import annotations

import logging

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from smsid.errors import RecordingError
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel, set_group_angles
from smsid.recording import Recording
from smsid.view.channels import Samples, commanded_samples, hidden_coordinates, measured_samples
from smsid.view.motion import Motion, grid, interpolate
from smsid.view.velocity import SMOOTHED, recorded_velocity

logger = logging.getLogger(__name__)


def recorded_motion(
    model: SpacecraftModel, rec: Recording, step: float, max_frames: int, times: np.ndarray | None = None
) -> Motion:
    """Return the motion of a recording, every ``step`` [s] or at ``times`` (N,) [s].

    What it does not tell stays at rest and is named in the notes. Before its start and after its end it
    stands still.

    Raises `RecordingError` when it tells nothing of the motion, or its clocks do not overlap.
    """
    rec = order_columns(rec, model)
    found: dict[str, Samples] = {}
    lever, notes = np.zeros(3), []

    def look(role: str, what: str, kind: str, default: str, quantity: str) -> np.ndarray | None:
        place = measured_samples(model, rec, kind, default, quantity)
        if place is None:
            notes.append(f"{what} not recorded: drawn at rest")
            return None
        found[role] = place[0]
        return place[1]

    if model.free:
        place = look("position", "position", "pose", "pose", "position")
        lever = lever if place is None else place
        look("attitude", "attitude", "pose", "pose", "attitude")
    if len(model.arm_joints):
        look("joints", "joint angles", "encoder", "encoder", "joint_position")
    if len(model.wheels):
        look("wheels", "wheel rates", "tachometer", "tachometer", "wheel_rate")
    for role, what, quantity, size in (
        ("slosh", "slosh", "slosh_position", model.slosh),
        ("modes", "deflection of appendages", "modal_position", model.modes),
    ):
        samples = hidden_coordinates(rec, quantity, together=role == "slosh")
        if len(size) and samples is None:
            notes.append(f"{what} not recorded: drawn at rest")
        elif len(size) and samples is not None:
            found[role] = samples
    if not found:
        raise RecordingError(
            "The recording tells nothing about the motion.",
            advice="It needs one of position, attitude, joint_position, wheel_rate, slosh_position, "
            "modal_position, from the sources that the description names.",
            channels=rec.channels,
        )
    start, stop = max(t[0] for t, _ in found.values()), min(t[-1] for t, _ in found.values())
    if start > stop:
        raise RecordingError("The clocks of the recording do not overlap.", advice="Check its times.")
    wanted = grid(float(start), float(stop), step, max_frames) if times is None else times
    at = np.clip(wanted, start, stop)
    q = _configurations(model, found, lever, at, notes)
    for note in notes:
        logger.warning("replay: %s", note)

    def applied(quantity: str, size: int) -> np.ndarray | None:
        samples = commanded_samples(rec, quantity)
        fits = samples is not None and samples[1].shape[1:] == (size,)
        return interpolate(*samples, at) if samples is not None and fits else None

    force = applied("force", 3)
    return Motion(
        wanted,
        q,
        np.zeros((len(at), 3)) if force is None else force,
        tuple(notes),
        v=recorded_velocity(model, rec, at, q),
        torque=applied("torque", 3),
        joint_torque=applied("joint_torque", len(model.arm_joints)),
        wheel_torque=applied("wheel_torque", len(model.wheels)),
        smoothed=SMOOTHED,
    )


def _configurations(
    model: SpacecraftModel,
    found: dict[str, Samples],
    lever: np.ndarray,
    times: np.ndarray,
    notes: list[str],
) -> np.ndarray:
    q = np.tile(model.home, (len(times), 1))

    def columns(role: str, count: int, what: str) -> np.ndarray | None:
        if role not in found:
            return None
        t, values = found[role]
        if values.shape[1] < count or (role == "joints" and values.shape[1] != count):
            notes.append(
                f"{what}: {values.shape[1]} columns recorded, the spacecraft has {count}: drawn at rest"
            )
            return None
        if role == "wheels":
            turned = np.cumsum(np.diff(t)[:, None] * (values[1:] + values[:-1]) / 2, axis=0)
            values = np.vstack([np.zeros(values.shape[1]), turned])
        return interpolate(t, values, times)[:, :count]

    if model.free:
        turn = Rotation.identity()
        if "attitude" in found:
            t, attitude = found["attitude"]
            turn = (
                Slerp(t, Rotation.from_quat(attitude))(times)
                if len(t) > 1
                else Rotation.from_quat(attitude[0])
            )
            q[:, 3:7] = turn.as_quat()
        if "position" in found:
            q[:, :3] = interpolate(*found["position"], times) - turn.apply(lever)
    joints = columns("joints", len(model.arm_joints), "joint angles")
    if joints is not None:
        q = np.array(
            [set_group_angles(model.pin, model.arm_joints, a, b) for a, b in zip(q, joints, strict=True)]
        )
    wheels = columns("wheels", len(model.wheels), "wheel rates")
    if wheels is not None:
        q = np.array(
            [set_group_angles(model.pin, model.wheels, a, b) for a, b in zip(q, wheels, strict=True)]
        )
    slosh = columns("slosh", 3 * len(model.slosh), "slosh")
    if slosh is not None:
        for k, joint in enumerate(model.slosh):
            q[:, joint.q] = slosh[:, 3 * k : 3 * k + 3]
    modes = columns("modes", len(model.modes), "deflection of appendages")
    if modes is not None:
        q[:, model.modes.q] = modes / model.mode_scale
    return q
