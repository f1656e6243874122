"""A motion whose channels agree with each other, in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np

from smsid.recording import Recording

LABELS = {"joint": ["shoulder", "elbow"], "station": ["2 m", "4 m"]}


def motion(t: np.ndarray) -> dict[str, np.ndarray]:
    """Rotation about one tilted axis, oscillation along three; every channel is the exact derivative."""
    axis = np.array([0.48, 0.6, 0.64])
    angle, rate = 0.8 * np.sin(0.3 * t), 0.24 * np.cos(0.3 * t)
    q = np.column_stack([np.sin(angle / 2)[:, None] * axis, np.cos(angle / 2)])
    w = np.array([0.5, 0.7, 1.1])
    p, v, a = np.sin(w * t[:, None]), w * np.cos(w * t[:, None]), -w * w * np.sin(w * t[:, None])
    u = np.array([0.4, 0.9])
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    # Rodrigues' formula with the angle reversed turns inertial into body axes.
    body = c * a - s * np.cross(axis, a) + (1 - c) * np.sum(a * axis, axis=1, keepdims=True) * axis
    return {
        "pose.position": p,
        "pose.velocity": v,
        "pose.attitude": q,
        "imu.angular_rate": rate[:, None] * axis,
        "imu.angular_acceleration": (-0.072 * np.sin(0.3 * t))[:, None] * axis,
        "imu.acceleration": body,
        "encoder.joint_position": np.sin(u * t[:, None]),
        "encoder.joint_velocity": u * np.cos(u * t[:, None]),
        "encoder.joint_acceleration": -u * u * np.sin(u * t[:, None]),
        "panel.acceleration": np.stack([body, 2 * body], axis=1),
    }


def recording(samples: int = 1001, **changes: Any) -> Recording:
    """Build a recording of `motion` at 50 Hz; ``changes`` go to `Recording.from_arrays`."""
    t = np.arange(samples) / 50.0
    return Recording.from_arrays(t, motion(t), **{"labels": LABELS, **changes})
