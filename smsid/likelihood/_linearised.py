"""The motion's equations linearised along a prediction: how acceleration answers state and parameters.

With r = RNEA_f(q, v, a) - forces_f = 0 for the free degrees of freedom f, the acceleration moves by
``da = -M_ff^-1 (Y_f dtheta + dRNEA_f/dq dq + dRNEA_f/dv dv - dforces)``: Y is Pinocchio's torque regressor,
the rest its RNEA derivatives (Carpentier and Mansard 2018). A pose perturbation (rho, phi) lives in the bus
frame, ``xi' = -ad(v_base) xi + dv_base``; without gravity the dynamics does not see it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.identify.momentum_rows import skew
from smsid.likelihood.inputs import DrivenMotion
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction, symmetric

BLOCK = 200  # nodes linearised at a time: they stay in the cache
POSE = 6


@dataclass(frozen=True)
class LinearisedNodes:
    """Accelerations of the free velocities at the nodes, by x = (pose 6, rest, free velocities) and P.

    P counts those of the parameters that move anything, with thrust three gains, and clocks. ``by_state``
    (nodes, free, n), ``by_parameter`` (nodes, free, P), ``by_motion`` (nodes, free, 3, joints): by angle,
    rate and acceleration of the prescribed joints.
    """

    by_state: np.ndarray
    by_parameter: np.ndarray
    by_motion: np.ndarray


def linearise(
    parameters: Parameters,
    drive: DrivenMotion,
    prediction: Prediction,
    thrust: np.ndarray | None,
    clocks: np.ndarray | None,
    follow: np.ndarray,
    moving: np.ndarray,
) -> LinearisedNodes:
    """Return the linearisation.

    ``thrust`` (nodes, nv, 3) per unit gain, ``clocks`` (nodes, nv, 3, c): what they do to prescribed angle,
    rate and acceleration; ``follow``: prescribed joints; ``moving``: the parameters that move anything.
    """
    model, free = prediction.model, drive.free
    rest, rest_v = prediction.rest_q, prediction.rest_v
    moving = moving[moving < parameters.size]
    n_rest, n_free, size = len(rest), len(free), len(moving)
    with_thrust = size + (0 if thrust is None else 3)
    p, joints = with_thrust + (0 if clocks is None else clocks.shape[3]), len(follow)
    q, v, a = prediction.q, prediction.v, prediction.a
    chain = parameters.theta_jacobian()[:, moving]
    used = np.flatnonzero(chain.any(axis=1))
    chain = chain[used]
    stiffness, damping, dk, dd = parameters.springs()
    dk, dd = dk[:, moving], dd[:, moving]
    spring_row = {int(i): k for k, i in enumerate(parameters.layout.model.spring_v)}
    sprung = [
        (int(np.flatnonzero(free == i)[0]), j, spring_row[int(i)])
        for j, i in enumerate(rest_v)
        if int(i) in spring_row
    ]
    count, state = len(q), n_rest + n_free
    by_state = np.zeros((count, n_free, POSE + state))
    by_parameter = np.empty((count, n_free, p))
    by_motion = np.empty((count, n_free, 3, joints))
    data = model.createData()
    for first in range(0, count, BLOCK):
        chosen = slice(first, min(first + BLOCK, count))
        dq, dv, mass, y = _evaluate_dynamics(model, data, q[chosen], v[chosen], a[chosen], used)
        right = np.empty((len(dq), n_free, state + p + 3 * joints))
        right[:, :, :n_rest] = dq[:, free][:, :, rest_v]
        right[:, :, n_rest:state] = dv[:, free][:, :, free]
        right[:, :, state : state + size] = y[:, free] @ chain
        for row, j, s in sprung:
            right[:, row, j] += stiffness[s]
            right[:, row, n_rest + row] += damping[s]
            at_q, at_v = q[chosen, rest[j]], v[chosen, rest_v[j]]
            right[:, row, state : state + size] += at_q[:, None] * dk[s] + at_v[:, None] * dd[s]
        if thrust is not None:
            right[:, :, state + size : state + with_thrust] = -thrust[chosen][:, free]
        if clocks is not None:
            own = clocks[chosen]
            right[:, :, state + with_thrust : state + p] = sum(
                matrix[:, free] @ own[:, :, k] for k, matrix in enumerate((dq, dv, mass))
            )
        for k, matrix in enumerate((dq, dv, mass) if joints else ()):
            place = state + p + k * joints
            right[:, :, place : place + joints] = matrix[:, free][:, :, follow]
        solved = -np.linalg.solve(mass[:, free][:, :, free], right)
        by_state[chosen, :, POSE:] = solved[:, :, :state]
        by_parameter[chosen] = solved[:, :, state : state + p]
        by_motion[chosen] = solved[:, :, state + p :].reshape(len(dq), n_free, 3, joints)
    return LinearisedNodes(by_state, by_parameter, by_motion)


def start_velocities(
    parameters: Parameters, free: np.ndarray, prediction: Prediction, gains: int, prescribed: np.ndarray
) -> np.ndarray:
    """Return the derivatives of the start velocity (free, all) by parameters, gains, what is prescribed.

    Of zero free momentum M_ff v_f + M_fp v_p at the start, with M v = Y(q, 0, v) theta. ``prescribed`` (nv,
    2, c): what moves prescribed angles and rates.
    """
    model, q, v = prediction.model, prediction.q[0], prediction.v[0]
    data, still = model.createData(), np.zeros(model.nv)
    y = pin.computeJointTorqueRegressor(model, data, q, still, v)[free] @ parameters.theta_jacobian()
    # at zero rate and acceleration v the RNEA derivative is that of M(q) v
    pin.computeRNEADerivatives(model, data, q, still, v)
    mass = symmetric(data.M)
    moved = data.dtau_dq[free] @ prescribed[:, 0] + mass[free] @ prescribed[:, 1]
    right = np.hstack([y, np.zeros((len(free), gains)), moved])
    return -np.linalg.solve(mass[np.ix_(free, free)], right)


def _evaluate_dynamics(
    model: pin.Model, data: pin.Data, q: np.ndarray, v: np.ndarray, a: np.ndarray, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """RNEA derivatives, mass matrix (N, nv, nv) and the columns ``used`` of the regressor (N, nv, k)."""
    n, nv = v.shape
    dq, dv, mass = np.empty((3, n, nv, nv))
    y = np.empty((n, nv, len(used)))
    everything = len(used) == 10 * (model.njoints - 1)
    for i in range(n):
        pin.computeRNEADerivatives(model, data, q[i], v[i], a[i])
        dq[i], dv[i], mass[i] = data.dtau_dq, data.dtau_dv, data.M
        full = pin.computeJointTorqueRegressor(model, data, q[i], v[i], a[i])
        y[i] = full if everything else full[:, used]
    return dq, dv, symmetric(mass), y


def small_adjoint(v: np.ndarray) -> np.ndarray:
    """Return ad(v) (N, 6, 6) of twists (N, 6): ad(v) xi = (omega x rho + v x phi, omega x phi)."""
    out = np.zeros((len(v), 6, 6))
    linear, angular = skew(v[:, :3]), skew(v[:, 3:])
    out[:, :3, :3] = out[:, 3:, 3:] = angular
    out[:, :3, 3:] = linear
    return out
