"""Estimating the slosh state of Exp. 2 from measured base motion.

The slosh mass obeys (12) whatever the rest of the spacecraft does: m_s r_s'' = -(K rho + B rho'), with rho =
R^T (r_s - r_b) - c_s. Driven by the measured pose and velocity of P it is a stable linear equation, so its
state follows without drift from Exp. 1's m_s, k_s, b_s, by the same kind of estimator as (31)-(32).
"""

from __future__ import annotations

import numpy as np

from smsid.errors import NotIdentifiableError
from smsid.identify.paper.motion import MeasuredMotion

FASTEST = 0.5  # step times natural frequency, step times damping rate: twice that and the steps blow up


def estimate_slosh(
    motion: MeasuredMotion,
    position: np.ndarray,
    mass: float,
    stiffness: np.ndarray,
    damping: np.ndarray,
    *,
    start: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return rho (N, 3) [m] and rho' (N, 3) [m/s] in bus axes.

    Exp. 2 starts at rest: the mass sits at ``position`` c_s with zero inertial velocity. (Taking its velocity
    from the first measured sample instead would let 0.2 mm/s of noise grow to 16 mm in 80 s.)

    ``position`` (3,) in the bus frame [m]; ``stiffness`` (3,) [N/m]; ``damping`` (3,) [N s/m]; ``mass`` [kg].
    ``start``: rho and rho' (3,) at the first sample, for a motion that goes on from another one.

    A second-order step per sample, in inertial axes: the slosh period is hundreds of samples.

    Raises `NotIdentifiableError` for a mass that is not positive, or slosh too fast or too heavily damped for
    the sampling: what Exp. 1 leaves when it has not seen the slosh.
    """
    _check(motion.step, mass, stiffness, damping)
    arm = position - motion.pose_point
    rotation, rate = motion.rotation, motion.rate
    pose = motion.position + np.einsum("nij,j->ni", rotation, arm)  # c_s in inertial axes
    velocity = np.einsum("nij,nj->ni", rotation, motion.velocity + np.cross(rate, arm))
    # r'' = by_position (r - pose) + by_velocity (v - velocity)
    turn = np.einsum("nij,j,nkj->nik", rotation, damping / mass, rotation)
    spin = np.einsum("nij,nj->ni", rotation, rate)
    by_velocity = -turn
    by_position = np.cross(turn, spin[:, None, :], axis=2) - np.einsum(
        "nij,j,nkj->nik", rotation, stiffness / mass, rotation
    )
    constant = -np.einsum("nij,nj->ni", by_position, pose) - np.einsum("nij,nj->ni", by_velocity, velocity)
    n, h, eye = len(motion), motion.step, np.eye(3)
    now, then = slice(None, -1), slice(1, None)
    # a0 = A0 (r, v) + c0 at a sample, a1 = A1 (r + h v + h^2/2 a0, v + h a0) + c1 at the next
    first = np.concatenate([by_position[now], by_velocity[now]], axis=2)
    ahead = np.zeros((n - 1, 6, 6))
    ahead[:, :3] = np.hstack([eye, h * eye]) + 0.5 * h * h * first
    ahead[:, 3:] = np.hstack([0.0 * eye, eye]) + h * first
    shift = np.concatenate([0.5 * h * h * constant[now], h * constant[now]], axis=1)
    second = np.concatenate([by_position[then], by_velocity[then]], axis=2)
    at_next = second @ ahead
    extra = np.einsum("nij,nj->ni", second, shift) + constant[then]
    step = np.zeros((n - 1, 6, 6))
    step[:, :3] = np.hstack([eye, h * eye]) + h * h / 6 * (2 * first + at_next)
    step[:, 3:] = np.hstack([0.0 * eye, eye]) + 0.5 * h * (first + at_next)
    push = np.concatenate(
        [h * h / 6 * (2 * constant[now] + extra), 0.5 * h * (constant[now] + extra)], axis=1
    )
    state = np.empty((n, 6))
    state[0] = *pose[0], 0.0, 0.0, 0.0
    if start is not None:
        moving = start[1] + np.cross(rate[0], start[0])
        state[0] = np.concatenate([pose[0] + rotation[0] @ start[0], velocity[0] + rotation[0] @ moving])
    for i in range(n - 1):
        state[i + 1] = step[i] @ state[i] + push[i]
    r, v = state[:, :3], state[:, 3:]
    rho = np.einsum("nji,nj->ni", rotation, r - pose)
    rho_rate = np.einsum("nji,nj->ni", rotation, v - velocity) - np.cross(rate, rho)
    return rho, rho_rate


def _check(step: float, mass: float, stiffness: np.ndarray, damping: np.ndarray) -> None:
    """Refuse slosh that a step per sample cannot follow."""
    advice = "Exp. 1 has not seen the slosh: look at its intervals, or describe the tank as it is known."
    if not (np.isfinite(mass) and mass > 0.0):
        raise NotIdentifiableError(
            f"A slosh mass of {mass:.3g} kg cannot be followed.", advice=advice, mass=mass
        )
    frequency = float(np.sqrt(max(np.max(stiffness), 0.0) / mass)) / (2.0 * np.pi)
    rate = float(np.max(np.abs(damping))) / mass
    if not max(2.0 * np.pi * frequency * step, rate * step) < FASTEST:
        raise NotIdentifiableError(
            f"A slosh mass of {mass:.3g} kg swings at {frequency:.3g} Hz and is damped by {rate:.3g} 1/s: "
            f"too fast to be followed at {1.0 / step:.3g} Hz.",
            advice=advice,
            frequency=frequency,
            damping_rate=rate,
        )
