"""Velocities of a recorded motion: as measured where they were, else the slope of what was."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.view.channels import Samples, hidden_coordinates, measured_samples
from smsid.view.motion import interpolate

SMOOTHED = 0.5  # [s] over which slopes are averaged: a rate differentiated from noisy samples is noise


def slopes(model: SpacecraftModel, times: np.ndarray, q: np.ndarray, smoothed: float = 0.0) -> np.ndarray:
    """Return velocities (N, nv) of configurations q (N, nq) at times (N,) [s], by central differences."""
    if len(times) < 2 or times[-1] <= times[0]:
        return np.zeros((len(times), model.nv))
    before, after = np.maximum(np.arange(len(q)) - 1, 0), np.minimum(np.arange(len(q)) + 1, len(q) - 1)
    step = times[after] - times[before]
    pairs = zip(q[before], q[after], strict=True)
    v = (
        np.array([pin.difference(model.pin, a, b) for a, b in pairs])
        / np.where(step > 0.0, step, np.inf)[:, None]
    )
    width = round(smoothed / float(np.median(np.diff(times))))
    return uniform_filter1d(v, width, axis=0, mode="nearest") if width > 1 else v


def recorded_velocity(
    model: SpacecraftModel, recording: Recording, times: np.ndarray, q: np.ndarray
) -> np.ndarray:
    """Return velocities (N, nv) at times (N,) [s] of configurations q (N, nq), body axes first.

    Rates of the bus, joints, wheels, slosh and modes are taken from their channels; the rest is the slope of
    q, smoothed.
    """
    v = slopes(model, times, q, SMOOTHED)

    def put(found: Samples | None, index: np.ndarray | slice, factor: np.ndarray | float = 1.0) -> None:
        if found is not None and found[1].shape[1:] == v[0, index].shape:
            v[:, index] = interpolate(*found, times) * factor

    def measured(kind: str, default: str, quantity: str) -> Samples | None:
        found = measured_samples(model, recording, kind, default, quantity)
        return None if found is None else found[0]

    if model.free:
        put(measured("imu", "imu", "angular_rate"), slice(3, 6))
        velocity = measured_samples(model, recording, "pose", "pose", "velocity")
        if velocity is not None:
            samples, lever = velocity
            turn = Rotation.from_quat(q[:, 3:7])
            v[:, :3] = turn.inv().apply(interpolate(*samples, times)) - np.cross(v[:, 3:6], lever)
    put(measured("encoder", "encoder", "joint_velocity"), model.arm_joints.v)
    put(measured("tachometer", "tachometer", "wheel_rate"), model.wheels.v)
    put(
        hidden_coordinates(recording, "modal_velocity", together=False), model.modes.v, 1.0 / model.mode_scale
    )
    columns = np.concatenate([np.arange(s.v.start, s.v.stop) for s in model.slosh] or [np.zeros(0)])
    put(hidden_coordinates(recording, "slosh_velocity", together=True), columns.astype(int))
    return v
