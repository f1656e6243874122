"""Rigid bodies that can exist, nearest to an estimate in the sense of its own uncertainty.

Unconstrained maximum likelihood may put a thin link's moments a little outside of what a rigid body can have:
noise does not know the triangle inequality. The inertias handed out minimise ``(theta - theta^)^T Lambda
(theta - theta^)`` over log-Cholesky coordinates (`pseudo_inertia`), Lambda the posterior's information with
everything else marginalised: the constrained estimate, to second order. A weak barrier, `BARRIER` times the
logarithm of the pseudo-inertia's determinant - in log-Cholesky coordinates simply the sum of four of them -
keeps bodies off the very boundary. Every iterate is physical; bodies that already are do not move.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from smsid.effects.inertial_parameters import pseudo_inertia
from smsid.likelihood.pseudo_inertia import SIZE, factor, is_body, parameters_of, step_factor, tangent

ITERATIONS = 200
ENOUGH = 1e-4  # decrease of half the sum of squares that no longer matters
BARRIER = 0.05  # half a sum of squares per factor of e in the determinant
ROUNDING = 1e-12  # of the largest eigenvalue: what smaller ones are raised to
FLOOR = 1e-3  # smallest eigenvalue a start may have, relative to the described body


class Bodies(Protocol):
    """Inertial parameters of rigid bodies (bodies, 10), and what a unit of a step of them is."""

    @property
    def inertias(self) -> np.ndarray:
        """Inertial parameters (bodies, 10)."""
        ...

    @property
    def sizes(self) -> np.ndarray:
        """What a unit of a step is (bodies, 10)."""
        ...


def consistent_inertias(found: Bodies, described: Bodies, covariance: np.ndarray) -> np.ndarray:
    """Return inertial parameters (bodies, 10) of bodies that can exist.

    ``covariance`` (10 bodies, 10 bodies) is that of the steps of the inertial parameters.
    """
    if all(is_body(theta) for theta in found.inertias):
        return found.inertias.copy()
    weight = _root_of_inverse(covariance)
    factors = [_start(a, b) for a, b in zip(found.inertias, described.inertias, strict=True)]

    def residual(at: list[np.ndarray]) -> np.ndarray:
        off = (np.array([parameters_of(f) for f in at]) - found.inertias) / found.sizes
        return weight @ off.ravel()

    logarithms = SIZE * np.arange(len(factors))[:, None] + np.arange(4)  # of the diagonal of each factor
    now, damping = residual(factors), 1e-3
    for _ in range(ITERATIONS):
        jacobian = np.zeros((len(now), len(now)))
        for k, (f, size) in enumerate(zip(factors, found.sizes, strict=True)):
            own = slice(SIZE * k, SIZE * (k + 1))
            jacobian[:, own] = weight[:, own] @ (tangent(f) / size[:, None])
        slope = jacobian.T @ now
        curve = np.diag(jacobian.T @ jacobian).copy()
        # theta goes with exp(2 phi) along the logarithms: their second derivative is twice the first
        extra = np.zeros(len(now))
        extra[logarithms] = 2.0 * np.maximum(slope[logarithms], 0.0)
        slope[logarithms] -= BARRIER
        hessian = jacobian.T @ jacobian + np.diag(extra)
        gained = 0.0
        while damping < 1e12:
            step = -np.linalg.solve(hessian + damping * np.diag(curve + extra + BARRIER), slope)
            step = np.clip(step, -1.0, 1.0)
            trial = [step_factor(f, p) for f, p in zip(factors, step.reshape(-1, SIZE), strict=True)]
            new = residual(trial)
            gained = 0.5 * float(now @ now - new @ new) + BARRIER * float(step[logarithms].sum())
            if gained > 0.0:
                factors, now, damping = trial, new, damping / 10.0
                break
            damping *= 10.0
        if gained < ENOUGH:
            break
    return np.array([parameters_of(f) for f in factors])


def _root_of_inverse(covariance: np.ndarray) -> np.ndarray:
    """Return W (n, n) with W^T W the inverse of a covariance, also where that is all but singular.

    Data fix some combinations 1e4 times better than the prior the others: what rounding leaves of the
    smallest eigenvalues, after scaling to unit diagonal, is not trusted below the floor.
    """
    scale = 1.0 / np.sqrt(np.diag(covariance))
    size, vectors = np.linalg.eigh(covariance * np.outer(scale, scale))
    return (vectors / np.sqrt(np.maximum(size, ROUNDING * size[-1]))).T * scale


def _start(theta: np.ndarray, described: np.ndarray) -> np.ndarray:
    """Factor of the body nearest to theta in the metric of the described one, eigenvalues floored."""
    lower = factor(described)
    scaled = np.linalg.solve(lower, np.linalg.solve(lower, pseudo_inertia(theta)).T)
    size, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    half = lower @ vectors * np.sqrt(np.maximum(size, FLOOR))
    r = np.linalg.qr(half.T, mode="r")
    return r.T * np.sign(np.diag(r))
