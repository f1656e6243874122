"""Estimating the slosh state of Exp. 2 from measured base motion.

The slosh mass obeys (12) whatever the rest of the spacecraft does: m_s r_s'' = -(K rho + B rho'), with rho =
R^T (r_s - r_b) - c_s. Driven by the measured pose and velocity of P it is a stable linear equation, so its
state follows without drift from Exp. 1's m_s, k_s, b_s, by the same kind of estimator as (31)-(32).
"""

from __future__ import annotations

import numpy as np

from smsid.identify.motion import Motion


def estimate_slosh(
    motion: Motion, position: np.ndarray, mass: float, stiffness: np.ndarray, damping: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return rho (N, 3) [m] and rho' (N, 3) [m/s] in bus axes.

    Exp. 2 starts at rest: the mass sits at ``position`` c_s with zero inertial velocity. (Taking its velocity
    from the first measured sample instead would let 0.2 mm/s of noise grow to 16 mm in 80 s.)

    ``position`` (3,) in the bus frame [m]; ``stiffness`` (3,) [N/m]; ``damping`` (3,) [N s/m]; ``mass`` [kg].
    A second-order step per sample, in inertial axes: the slosh period is hundreds of samples.
    """
    arm = position - motion.pose_point
    k, b = stiffness / mass, damping / mass
    rotation, rate = motion.rotation, motion.rate
    pose = motion.position + np.einsum("nij,j->ni", rotation, arm)  # c_s in inertial axes
    velocity = np.einsum("nij,nj->ni", rotation, motion.velocity + np.cross(rate, arm))
    n = len(motion)
    r, v = np.empty((n, 3)), np.empty((n, 3))
    r[0], v[0] = pose[0], 0.0

    def acceleration(i: int, r: np.ndarray, v: np.ndarray) -> np.ndarray:
        to_body = rotation[i].T
        rho = to_body @ (r - pose[i])
        rho_rate = to_body @ (v - velocity[i]) - np.cross(rate[i], rho)
        return -(rotation[i] @ (k * rho + b * rho_rate))

    h = motion.step
    for i in range(n - 1):
        a0 = acceleration(i, r[i], v[i])
        a1 = acceleration(i + 1, r[i] + h * v[i] + 0.5 * h * h * a0, v[i] + h * a0)
        r[i + 1] = r[i] + h * v[i] + h * h * (2 * a0 + a1) / 6
        v[i + 1] = v[i] + 0.5 * h * (a0 + a1)
    rho = np.einsum("nji,nj->ni", rotation, r - pose)
    rho_rate = np.einsum("nji,nj->ni", rotation, v - velocity) - np.cross(rate, rho)
    return rho, rho_rate
