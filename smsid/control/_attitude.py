"""Coordinates of the base's attitude for feedback: the paper's Euler angles, or the error quaternion.

Both turn a wanted second derivative of the error into a wanted angular acceleration of the base, which is all
that the model-based controller (43) needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from smsid.errors import ControlError

Coordinates = Literal["euler", "quaternion"]
SMALLEST_COSINE = 0.05
"""Of the pitch (Euler angles) or of half the error angle (quaternion): below, the coordinates are refused."""


@dataclass(frozen=True)
class AttitudeError:
    """Error of the attitude, all (3,): ``error`` e_b and ``rate`` its derivative [rad, rad/s].

    Angular acceleration of the base, body axes: ``jacobian`` (3, 3) times the wanted second derivative of
    -e_b, plus ``bias``.
    """

    error: np.ndarray
    rate: np.ndarray
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
    """Return the error of an attitude against a reference given as roll, pitch and yaw.

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
    if coordinates != "quaternion":
        raise ControlError(
            f"'{coordinates}' are no coordinates of an attitude.", advice="Use 'quaternion' or 'euler'."
        )
    jacobian = pin.rpy.computeRpyJacobian(angles, pin.LOCAL)
    change = pin.rpy.computeRpyJacobianTimeDerivative(angles, rates, pin.LOCAL)
    relative = pin.rpy.rpyToMatrix(angles).T @ rotation
    quaternion = pin.Quaternion(relative).coeffs()
    x, y, z, w = quaternion if quaternion[3] >= 0.0 else -quaternion
    if w < SMALLEST_COSINE:
        raise ControlError(
            f"The attitude error is {np.degrees(2.0 * np.arccos(w)):.1f} deg: which way is back?",
            advice="Start nearer to the reference, or give a reference that starts at the spacecraft.",
            quaternion=np.array([x, y, z, w]),
        )
    seen = relative.T @ (jacobian @ rates)
    slip = omega - seen
    turn = _turn(x, y, z, w)
    error_rate = turn @ slip
    # of w I + [e]x, the quaternion being of unit length
    inverse = turn.T + np.outer((x, y, z), (x / w, y / w, z / w))
    dx, dy, dz = 0.5 * error_rate
    turn_rate = _turn(dx, dy, dz, -0.5 * (x * slip[0] + y * slip[1] + z * slip[2]))
    bias = relative.T @ (jacobian @ accelerations + change @ rates) - pin.skew(omega) @ seen
    return AttitudeError(
        -2.0 * np.array([x, y, z]), -error_rate, inverse, bias - inverse @ (turn_rate @ slip)
    )


def attitude_errors(
    coordinates: Coordinates, rotations: np.ndarray, omegas: np.ndarray, angles: np.ndarray, rates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return error and its rate, (N, 3) each, as `attitude_error` does, for a whole run at once.

    ``rotations`` (N, 3, 3) body to inertial, ``omegas`` (N, 3) body axes [rad/s], wanted ``angles`` (N, 3)
    [rad] and ``rates`` (N, 3) [rad/s]. Raises nothing: the run has passed the singularities' checks.
    """
    if coordinates == "euler":
        each = [_euler(*x, np.zeros(3)) for x in zip(rotations, omegas, angles, rates, strict=True)]
        return np.array([e.error for e in each]), np.array([e.rate for e in each])
    (roll, pitch, _), (dr, dp, dy) = angles.T, rates.T
    rate_d = np.column_stack(
        [
            dr - np.sin(pitch) * dy,
            np.cos(roll) * dp + np.cos(pitch) * np.sin(roll) * dy,
            -np.sin(roll) * dp + np.cos(pitch) * np.cos(roll) * dy,
        ]
    )
    wanted = Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix()
    relative = wanted.transpose(0, 2, 1) @ rotations
    q = Rotation.from_matrix(relative).as_quat(canonical=True)
    slip = omegas - np.einsum("nji,nj->ni", relative, rate_d)
    return -2.0 * q[:, :3], -(q[:, 3:] * slip + np.cross(q[:, :3], slip))


def _euler(
    rotation: np.ndarray, omega: np.ndarray, angles: np.ndarray, rates: np.ndarray, wanted: np.ndarray
) -> AttitudeError:
    found = pin.rpy.matrixToRpy(rotation)
    if np.cos(found[1]) < SMALLEST_COSINE:
        raise ControlError(
            f"The base's pitch is {np.degrees(found[1]):.1f} deg: its Euler angles are singular at 90 deg.",
            advice='Use coordinates = "quaternion".',
            angles=found,
        )
    jacobian = pin.rpy.computeRpyJacobian(found, pin.LOCAL)
    found_rates = np.linalg.solve(jacobian, omega)
    change = pin.rpy.computeRpyJacobianTimeDerivative(found, found_rates, pin.LOCAL)
    error = (angles - found + np.pi) % (2.0 * np.pi) - np.pi
    return AttitudeError(error, rates - found_rates, jacobian, jacobian @ wanted + change @ found_rates)


def _turn(x: float, y: float, z: float, w: float) -> np.ndarray:
    """w I + [xyz]x: takes the body's relative rate to the derivative of twice the vector part."""
    return np.array([[w, -z, y], [z, w, -x], [-y, x, w]])
