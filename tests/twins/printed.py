"""Equations (1)-(9) of the paper evaluated as they are printed, in plain numpy.

Shares only the numbers with `derivation.py`: momenta come from masses and velocities, not from derivatives
of T.
"""

from __future__ import annotations

import numpy as np

from .numbers import PAPER, Spacecraft, inertia_matrix
from .state import Array, State

UNIT = dict(zip("xyz", np.eye(3), strict=True))


def _turn(axis: Array, angle: float) -> Array:
    """(3, 3) rotation about a unit axis, Rodrigues."""
    cross = np.cross(np.eye(3), axis)  # the matrix of (axis x)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def printed_momentum(state: State, numbers: Spacecraft = PAPER) -> tuple[Array, Array]:
    """p (3,) by (7) and h (3,) about the inertial origin by (8), (9), body axes [N s], [N m s]."""
    n, v, w = numbers, state.v_b, state.omega_b
    r_b = state.attitude.T @ state.position
    # base, with the wheels' relative spin
    spin = np.array(n.wheel_inertia) * state.wheel_rate
    p = n.base_mass * v
    h = inertia_matrix(n.base_inertia) @ w + spin + np.cross(r_b, p)
    # links: (3), (4) by forward recursion along the arm
    turn, rate = n.arm_rotation, w
    at, speed = r_b + n.arm_mount, v + np.cross(w, n.arm_mount)
    for link, angle, angle_rate in zip(n.links, state.q, state.qd, strict=True):
        rate = rate + turn @ UNIT[link.axis] * angle_rate
        turn = turn @ _turn(UNIT[link.axis], angle)
        arm = turn @ np.array(link.centre)
        p_i = link.mass * (speed + np.cross(rate, arm))
        p = p + p_i
        h = h + turn @ inertia_matrix(link.inertia) @ turn.T @ rate + np.cross(at + arm, p_i)
        along = turn @ np.array(link.tip)
        at, speed = at + along, speed + np.cross(rate, along)
    # slosh: (1), (2)
    r_s = r_b + n.slosh_centre + state.rho
    p_s = n.slosh_mass * (v + state.rho_dot + np.cross(w, np.array(n.slosh_centre) + state.rho))
    p, h = p + p_s, h + np.cross(r_s, p_s)
    # panel: (5), (9); L_t^T delta and L_r^T delta_dot as vectors, I_a,b of the undeformed plate
    plate, r_c = n.panel, np.array(n.panel_root)
    c_a = r_c + np.array([plate.length / 2, 0, 0])
    moment = plate.mass * c_a + [0, 0, plate.translation @ state.delta]
    linear = np.array([0, 0, plate.translation @ state.delta_dot])
    angular = np.array([0, -(plate.rotation @ state.delta_dot), 0])
    a, b, c = (plate.mass * s**2 / 12 for s in (plate.length, plate.width, plate.thickness))
    i_ab = np.diag([b + c, a + c, a + b]) + plate.mass * (c_a @ c_a * np.eye(3) - np.outer(c_a, c_a))
    p_a = plate.mass * v + np.cross(w, moment) + linear
    h_a = i_ab @ w + angular + np.cross(r_c, linear) + np.cross(moment, v) + np.cross(r_b, p_a)
    return p + p_a, h + h_a
