"""What the sensors of the reference recordings would read, from a state and its derivative."""

from __future__ import annotations

import numpy as np

from .numbers import Spacecraft
from .state import Array, Inputs, State


def cross(a: Array, b: Array) -> Array:
    """Of two vectors; numpy's own takes ten times as long for as few."""
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def point_acceleration(
    state: State, vdot: Array, point: Array, relative: tuple[Array, Array, Array]
) -> Array:
    """Inertial acceleration (3,) of a point, body axes [m/s2].

    `point` (3,) [m] is where it is in the body frame without `relative` = (displacement, velocity,
    acceleration), each (3,) in body axes; `vdot` (18,) is the derivative of `State.velocity`.
    """
    displacement, velocity, acceleration = relative
    w, r = state.omega_b, point + displacement
    base = vdot[:3] + cross(w, state.v_b)
    return base + cross(vdot[3:6], r) + cross(w, cross(w, r)) + 2 * cross(w, velocity) + acceleration


def panel_acceleration(numbers: Spacecraft, state: State, vdot: Array) -> Array:
    """Accelerations (3 stations, 3) of the panel's material points, body axes [m/s2]."""
    rows, root = [], np.array(numbers.panel_root)
    for x, phi in zip(numbers.stations, numbers.panel.shape(np.array(numbers.stations)), strict=True):
        moving = [np.array([0.0, 0.0, phi @ z]) for z in (state.delta, state.delta_dot, vdot[15:18])]
        rows.append(point_acceleration(state, vdot, root + np.array([x, 0, 0]), tuple(moving)))
    return np.array(rows)


def sample(numbers: Spacecraft, state: State, vdot: Array, inputs: Inputs, hold: Array) -> dict[str, Array]:
    """All channels at one instant, with the names and conventions of the recordings."""
    point, still = np.array(numbers.point), (np.zeros(3),) * 3
    x, y, z, w = state.quaternion
    return {
        "base_pos_P": state.position + state.attitude @ point,
        "base_vel_P": state.attitude @ (state.v_b + cross(state.omega_b, point)),
        "quat_wxyz": np.array([w, x, y, z]),
        "omega_body": state.omega_b,
        "acc_imu_body": point_acceleration(state, vdot, point, still),
        "domega_body": vdot[3:6],
        "q": state.q,
        "qd": state.qd,
        "qdd": vdot[9:12],
        "tau_arm": inputs.joint_torque,
        "rw_rate": state.wheel_rate,
        "tau_rw": inputs.wheel_torque,
        "force_body": inputs.force_body,
        "tau_hold": hold,
        "panel_acc_base": panel_acceleration(numbers, state, vdot),
        "truth_slosh": state.rho,
        "truth_slosh_vel": state.rho_dot,
        "truth_panel_modal": state.delta,
        "truth_panel_modal_vel": state.delta_dot,
        "truth_force_body": inputs.force_body,
    }
