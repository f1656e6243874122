"""Rigid-body inertias that are physically consistent whatever the parameters: log-Cholesky.

The pseudo-inertia J (4, 4) of a rigid body is positive definite exactly when the body can exist. As in Rucker
and Wensing (2022), *Smooth parameterization of rigid-body inertia*, J = U U^T with U upper triangular and the
logarithms of its diagonal as parameters. Here U acts on the body's own factor, J = L U(phi) U(phi)^T L^T, so
phi = 0 is the present inertia and a unit of phi is of the body's own size; after a step L takes up U.
"""

from __future__ import annotations

import numpy as np

from smsid.effects.inertial_parameters import pseudo_inertia
from smsid.errors import DescriptionError

SIZE = 10
PLACES = ((0, 0), (1, 1), (2, 2), (3, 3), (0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3))
"""Where the ten components of phi stand in U: logarithms of the diagonal, then what is above it."""


def factor(theta: np.ndarray, name: str = "") -> np.ndarray:
    """Return L (4, 4), lower triangular, with L L^T the pseudo-inertia of parameters theta (10,) [kg, m].

    Raises `DescriptionError` when no body of finite extent has these parameters.
    """
    try:
        return np.linalg.cholesky(pseudo_inertia(theta))
    except np.linalg.LinAlgError as cause:
        raise DescriptionError(
            f"The inertia of body '{name}' is not that of a rigid body with extent in three directions.",
            advice="Give it a mass and moments of inertia of which any two add up to more than the third.",
            parameters=theta,
        ) from cause


def is_body(theta: np.ndarray) -> bool:
    """Return whether parameters theta (10,) are those of a rigid body with extent in three directions."""
    j = pseudo_inertia(theta)
    size = np.sqrt(np.maximum(np.diag(j), 0.0))
    return bool(size.min() > 0.0 and np.linalg.eigvalsh(j / np.outer(size, size))[0] > 1e-9)


def inertial_parameters(pseudo: np.ndarray) -> np.ndarray:
    """Return (m, mc, Ixx, Ixy, Iyy, Ixz, Iyz, Izz) of a pseudo-inertia (..., 4, 4); linear."""
    s = pseudo[..., :3, :3]
    trace = np.trace(s, axis1=-2, axis2=-1)
    return np.stack(
        [
            pseudo[..., 3, 3],
            pseudo[..., 0, 3],
            pseudo[..., 1, 3],
            pseudo[..., 2, 3],
            trace - s[..., 0, 0],
            -s[..., 0, 1],
            trace - s[..., 1, 1],
            -s[..., 0, 2],
            -s[..., 1, 2],
            trace - s[..., 2, 2],
        ],
        axis=-1,
    )


def parameters_of(lower: np.ndarray) -> np.ndarray:
    """Return the inertial parameters (10,) of the body with factor L (4, 4)."""
    return inertial_parameters(lower @ lower.T)


def tangent(lower: np.ndarray) -> np.ndarray:
    """Return d theta / d phi (10, 10) at phi = 0 for the factor L (4, 4)."""
    i, j = np.array(PLACES).T
    change = lower.T[i][:, :, None] * lower.T[j][:, None, :]
    return inertial_parameters(change + change.transpose(0, 2, 1)).T


def parameters_at(lower: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return theta (10,) of the body at phi (10,) away from the one with factor L, ``lower`` (4, 4), and its
    derivative d theta / d phi (10, 10) there.
    """
    i, j = np.array(PLACES).T
    on_diagonal = i == j
    grown = np.where(on_diagonal, np.exp(np.where(on_diagonal, phi, 0.0)), 1.0)
    upper = np.zeros((4, 4))
    upper[i, j] = np.where(on_diagonal, grown, phi)
    changed = lower @ upper
    change = grown[:, None, None] * lower.T[i][:, :, None] * changed.T[j][:, None, :]
    return parameters_of(changed), inertial_parameters(change + change.transpose(0, 2, 1)).T


def step_factor(lower: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return the factor (4, 4) of the body at phi (10,) away from the one with factor L, ``lower`` (4, 4)."""
    upper = np.zeros((4, 4))
    for value, (i, j) in zip(phi, PLACES, strict=True):
        upper[i, j] = np.exp(value) if i == j else value
    changed = lower @ upper
    # the triangular factor of J without forming J: thin bodies keep their digits
    r = np.linalg.qr(changed.T, mode="r")
    return r.T * np.sign(np.diag(r))
