"""Coordinates of the base's attitude for feedback: the paper's Euler angles, or the error quaternion.

Both turn a wanted second derivative of the coordinates into a wanted angular acceleration of the base, which
is all that the model-based controller (43) needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from smsid.errors import ControlError

Coordinates = Literal["euler", "quaternion"]
SMALLEST_COSINE = 0.05
"""Of the pitch (Euler angles) or of half the error angle (quaternion): below, the coordinates are refused."""


@dataclass(frozen=True)
class AttitudeError:
    """Error of the attitude in coordinates of the feedback, all (3,).

    ``error`` e_b and ``rate`` its derivative [rad, rad/s]; ``acceleration`` the wanted second derivative of
    the coordinates. Angular acceleration of the base, body axes: ``jacobian`` (3, 3) times the coordinates'
    second derivative plus ``bias``.
    """

    error: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    jacobian: np.ndarray
    bias: np.ndarray


def attitude_error(
    coordinates: Coordinates,
    rotation: np.ndarray,
    omega: np.ndarray,
    angles: np.ndarray,
    rates: np.ndarray,
    accelerations: np.ndarray,
) -> AttitudeError:
    """Return the error of an attitude against a reference given as Euler angles.

    Args:
        coordinates: ``euler`` (roll, pitch, yaw, the paper's q_b) or ``quaternion`` (twice the vector part of
            the error quaternion: no singularity short of half a turn of error).
        rotation: (3, 3) body to inertial.
        omega: (3,) angular rate of the base, body axes [rad/s].
        angles, rates, accelerations: (3,) reference roll, pitch, yaw and derivatives [rad, rad/s, rad/s^2].

    Raises:
        ControlError: the pitch is near +-90 deg (``euler``), or the error near half a turn.
    """
    if coordinates == "euler":
        return _euler(rotation, omega, angles, rates, accelerations)
    if coordinates == "quaternion":
        return _quaternion(rotation, omega, angles, rates, accelerations)
    raise ControlError(
        f"'{coordinates}' are no coordinates of an attitude.", advice="Use 'quaternion' or 'euler'."
    )


def attitude_errors(
    coordinates: Coordinates,
    rotations: np.ndarray,
    omegas: np.ndarray,
    angles: np.ndarray,
    rates: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return error and its rate, (N, 3) each, as `attitude_error` does, for a whole run at once.

    ``rotations`` (N, 3, 3) body to inertial, ``omegas`` (N, 3) body axes [rad/s], wanted ``angles`` (N, 3)
    [rad] and ``rates`` (N, 3) [rad/s]. Raises nothing: the run has passed the singularities' checks.
    """
    roll, pitch, _ = angles.T
    dr, dp, dy = rates.T
    if coordinates == "euler":
        r = rotations
        roll_, pitch_ = np.arctan2(r[:, 2, 1], r[:, 2, 2]), -np.arcsin(np.clip(r[:, 2, 0], -1.0, 1.0))
        found = np.column_stack([roll_, pitch_, np.arctan2(r[:, 1, 0], r[:, 0, 0])])
        x, y, z = omegas.T
        across = np.sin(roll_) * y + np.cos(roll_) * z
        seen = np.column_stack(
            [x + np.tan(pitch_) * across, np.cos(roll_) * y - np.sin(roll_) * z, across / np.cos(pitch_)]
        )
        return (angles - found + np.pi) % (2.0 * np.pi) - np.pi, rates - seen
    wanted = Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix()
    rate_d = np.column_stack(
        [
            dr - np.sin(pitch) * dy,
            np.cos(roll) * dp + np.cos(pitch) * np.sin(roll) * dy,
            -np.sin(roll) * dp + np.cos(pitch) * np.cos(roll) * dy,
        ]
    )
    relative = wanted.transpose(0, 2, 1) @ rotations
    q = Rotation.from_matrix(relative).as_quat()
    q *= np.where(q[:, 3:] < 0.0, -1.0, 1.0)
    slip = omegas - np.einsum("nji,nj->ni", relative, rate_d)
    return -2.0 * q[:, :3], -(q[:, 3:] * slip + np.cross(q[:, :3], slip))


def euler_angles(rotation: np.ndarray) -> np.ndarray:
    """Return roll, pitch, yaw (3,) [rad] of R = Rz(yaw) Ry(pitch) Rx(roll), body to inertial."""
    r = rotation
    return np.array(
        [
            np.arctan2(r[2, 1], r[2, 2]),
            np.arctan2(-r[2, 0], np.hypot(r[2, 1], r[2, 2])),
            np.arctan2(r[1, 0], r[0, 0]),
        ]
    )


def euler_rotation(angles: np.ndarray) -> np.ndarray:
    """Return R (3, 3), body to inertial, of roll, pitch, yaw (3,) [rad]."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def euler_jacobian(angles: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return E (3, 3) with omega = E rates (body axes), and its time derivative, for roll, pitch, yaw.

    ``angles`` (3,) [rad], ``rates`` (3,) [rad/s] of roll, pitch and yaw.
    """
    (cr, cp, _), (sr, sp, _) = np.cos(angles), np.sin(angles)
    dr, dp, _ = rates
    jacobian = np.array([[1.0, 0.0, -sp], [0.0, cr, cp * sr], [0.0, -sr, cp * cr]])
    change = np.array(
        [
            [0.0, 0.0, -cp * dp],
            [0.0, -sr * dr, -sp * sr * dp + cp * cr * dr],
            [0.0, -cr * dr, -sp * cr * dp - cp * sr * dr],
        ]
    )
    return jacobian, change


def quaternion_of(rotation: np.ndarray) -> np.ndarray:
    """Return the unit quaternion x y z w (4,) with w >= 0 of a rotation matrix (3, 3)."""
    r = rotation
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    k = int(np.argmax([r[0, 0], r[1, 1], r[2, 2], trace]))
    q = np.empty(4)
    if k == 3:
        q[:] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1.0 + trace
    else:
        i, j, l = k, (k + 1) % 3, (k + 2) % 3
        q[i] = 1.0 - trace + 2.0 * r[i, i]
        q[j], q[l], q[3] = r[j, i] + r[i, j], r[l, i] + r[i, l], r[l, j] - r[j, l]
    q /= np.sqrt(q @ q)
    return q if q[3] >= 0.0 else -q


def _euler(
    rotation: np.ndarray, omega: np.ndarray, angles: np.ndarray, rates: np.ndarray, wanted: np.ndarray
) -> AttitudeError:
    found = euler_angles(rotation)
    if np.cos(found[1]) < SMALLEST_COSINE:
        raise ControlError(
            f"The base's pitch is {np.degrees(found[1]):.1f} deg: its Euler angles are singular at 90 deg.",
            advice='Use coordinates = "quaternion".',
            angles=found,
        )
    jacobian, _ = euler_jacobian(found, np.zeros(3))
    found_rates = np.linalg.solve(jacobian, omega)
    _, change = euler_jacobian(found, found_rates)
    error = (angles - found + np.pi) % (2.0 * np.pi) - np.pi
    return AttitudeError(error, rates - found_rates, np.asarray(wanted), jacobian, change @ found_rates)


def _quaternion(
    rotation: np.ndarray, omega: np.ndarray, angles: np.ndarray, rates: np.ndarray, wanted: np.ndarray
) -> AttitudeError:
    jacobian, change = euler_jacobian(angles, rates)
    rate_d, acceleration_d = jacobian @ rates, jacobian @ wanted + change @ rates
    relative = euler_rotation(angles).T @ rotation
    x, y, z, w = quaternion_of(relative)
    if w < SMALLEST_COSINE:
        raise ControlError(
            f"The attitude error is {np.degrees(2.0 * np.arccos(w)):.1f} deg: which way is back?",
            advice="Start nearer to the reference, or give a reference that starts at the spacecraft.",
            quaternion=np.array([x, y, z, w]),
        )
    seen = relative.T @ rate_d
    slip = omega - seen
    drag = _turn(omega[0], omega[1], omega[2], 0.0) @ seen
    turn = _turn(x, y, z, w)
    coordinates_rate = turn @ slip
    # of w I + [e]x, the quaternion being of unit length
    inverse = turn.T + np.outer((x, y, z), (x / w, y / w, z / w))
    dx, dy, dz = 0.5 * coordinates_rate
    turn_rate = _turn(dx, dy, dz, -0.5 * (x * slip[0] + y * slip[1] + z * slip[2]))
    bias = relative.T @ acceleration_d - drag - inverse @ (turn_rate @ slip)
    return AttitudeError(-2.0 * np.array([x, y, z]), -coordinates_rate, np.zeros(3), inverse, bias)


def _turn(x: float, y: float, z: float, w: float) -> np.ndarray:
    """w I + [xyz]x: takes the body's relative rate to the derivative of twice the vector part."""
    return np.array([[w, -z, y], [z, w, -x], [-y, x, w]])
