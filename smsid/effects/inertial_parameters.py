"""Inertial parameters of a rigid body: moved to other axes, as matrices, and whether a body can have them.

The ten are m, first moment m c (3), and Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the frame's origin, as Pinocchio's
``toDynamicParameters`` orders them.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from smsid.errors import DescriptionError


def move_parameters(placement: pin.SE3, theta: np.ndarray) -> np.ndarray:
    """Return inertial parameters (10,) expressed in the parent axes of ``placement``; linear in theta."""
    rotation, shift = placement.rotation, placement.translation
    first = rotation @ theta[1:4]
    about = rotation @ parameters_to_matrix(theta) @ rotation.T
    mass = theta[0]
    # parallel axis, written so that an indefinite theta needs no centre of mass
    cross = np.outer(first, shift) + np.outer(shift, first)
    matrix = about + (2 * first @ shift) * np.eye(3) - cross
    matrix = matrix + mass * ((shift @ shift) * np.eye(3) - np.outer(shift, shift))
    return np.concatenate([[mass], first + mass * shift, matrix_to_parameters(matrix)])


def parameters_to_matrix(theta: np.ndarray) -> np.ndarray:
    """Return the inertia matrix (3, 3) of parameters (m, mc, Ixx, Ixy, Iyy, Ixz, Iyz, Izz)."""
    xx, xy, yy, xz, yz, zz = theta[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def matrix_to_parameters(matrix: np.ndarray) -> np.ndarray:
    """Return (Ixx, Ixy, Iyy, Ixz, Iyz, Izz) of an inertia matrix."""
    return np.array([matrix[0, 0], matrix[0, 1], matrix[1, 1], matrix[0, 2], matrix[1, 2], matrix[2, 2]])


def pseudo_inertia(theta: np.ndarray) -> np.ndarray:
    """Return the pseudo-inertia (4, 4) of parameters (10,); positive definite exactly for a physical body."""
    matrix = parameters_to_matrix(theta)
    sigma = 0.5 * np.trace(matrix) * np.eye(3) - matrix
    return np.block([[sigma, theta[1:4, None]], [theta[None, 1:4], theta[:1, None]]])


def pinocchio_inertia(theta: np.ndarray) -> pin.Inertia:
    """Return the `pin.Inertia` of parameters (10,), physical or not; of a rotor without mass: its moments.

    Pinocchio divides the first moment by the mass. Raises `DescriptionError` for a first moment without mass.
    """
    if theta[0] != 0.0:
        return pin.Inertia.FromDynamicParameters(theta)
    if np.any(theta[1:4]):
        raise DescriptionError(
            f"A body without mass has a first moment of {theta[1:4]} kg m.",
            advice="Give it a mass, or its centre of mass at the origin of its frame.",
            parameters=theta,
        )
    return pin.Inertia(0.0, np.zeros(3), parameters_to_matrix(theta))


def inertia_from_parameters(theta: np.ndarray, name: str, *, trusted: bool = False) -> pin.Inertia:
    """Return the `pin.Inertia` of parameters (10,).

    Raises `DescriptionError` if no body can have them; ``trusted`` asks for a positive mass only.
    """
    physical = trusted or np.linalg.eigvalsh(pseudo_inertia(theta))[0] >= -1e-9 * np.abs(theta).max()
    if theta[0] <= 0.0 or not physical:
        raise DescriptionError(
            f"The inertia left to body '{name}' is not physical (mass {theta[0]:.6g} kg).",
            advice="What wheels and appendages take from it is more than it has: check their mass, "
            "participation factors and spin inertia, and `inertia_in_bus`.",
            parameters=theta,
        )
    return pinocchio_inertia(theta)
