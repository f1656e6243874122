"""Derivatives of a predicted motion by the parameters: the variational equations along it.

With r = RNEA_f(q, v, a) - forces_f = 0 for the free degrees of freedom f, the acceleration moves by
``da = -M_ff^-1 (Y_f dtheta + dRNEA_f/dq dq + dRNEA_f/dv dv - dforces)``: Y is Pinocchio's torque regressor,
the rest its RNEA derivatives (Carpentier and Mansard 2018). A pose perturbation (rho, phi) lives in the bus
frame, ``xi' = -ad(v_base) xi + dv_base``; without gravity the dynamics does not see it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.likelihood.drive import Drive
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction
from smsid.likelihood.runge_kutta import STAGES, transitions
from smsid.likelihood.spline import WINDOW
from smsid.likelihood.timeline import Timeline

BLOCK = 200  # evaluations linearised at a time: they stay in the cache

POSE = 6


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives at the nodes by P = (parameters, initial position and attitude, thrust gains, motion).

    Motion: the spline coefficients of the measured joint motion, joint after joint, when asked for.

    ``pose`` (nodes, 6, P): (rho, phi) in the bus frame; ``q`` (nodes, nv, P) of joints, ``v``, ``a`` (nodes,
    nv, P).
    """

    pose: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def sensitivity(
    parameters: Parameters,
    drive: Drive,
    prediction: Prediction,
    thrust: np.ndarray | None,
    *,
    motion: bool = False,
) -> Sensitivity:
    """Return the derivatives of a prediction; ``thrust`` (E, nv, 3) is the force per unit gain, by axis."""
    follow = parameters.layout.model.arm_joints.v if motion and drive.joints is not None else np.zeros(0, int)
    linear = _linearised(parameters, drive, prediction, thrust, follow)
    rates, drives = linear.rates, linear.drives
    timeline, free = prediction.timeline, drive.free
    nv, size = parameters.layout.model.nv, parameters.size
    steps, n_rest, n = timeline.steps, len(prediction.rest_v), rates.shape[1]
    active = np.zeros((steps, 0), dtype=int)
    first, coefficients = np.zeros(steps, dtype=int), 0
    if len(follow):
        assert drive.joints is not None
        coefficients = len(drive.joints.coefficients)
        first = drive.joints.windows(timeline.step_starts)
        own = np.arange(len(follow))[:, None] * coefficients + np.arange(WINDOW)
        active = (first[:, None, None] + own).reshape(steps, -1)
        drives = np.concatenate([drives, _following(drive, timeline, first, linear.follow, n)], axis=2)
    inner = steps * STAGES
    phi, gamma, _ = transitions(
        rates[:inner].reshape(steps, STAGES, n, n), drives[:inner].reshape(steps, STAGES, n, -1), timeline.h
    )
    assert gamma is not None
    p = size + 3
    width = p + POSE + coefficients * len(follow)
    x = np.zeros((n, width))
    x[POSE + n_rest :, :p] = linear.start
    x[:POSE, p : p + POSE] = np.eye(POSE)
    active = active + p + POSE
    if len(follow):
        x[POSE + n_rest :, active[0]] += _starting(parameters, drive, prediction, follow, int(first[0]))
    states = np.empty((steps + len(timeline.counts), n, width))
    step, node = 0, 0
    for count in timeline.counts:
        for _ in range(count):
            states[node] = x
            x = phi[step] @ x
            x[:, :p] += gamma[step, :, :p]
            x[:, active[step]] += gamma[step, :, p:]
            step, node = step + 1, node + 1
        states[node] = x
        node += 1
    index = timeline.node_evaluation
    slope = rates[index, POSE + n_rest :] @ states
    slope[:, :, :p] += drives[index, POSE + n_rest :, :p]
    if len(follow):
        at_step = _node_steps(timeline)
        nodes, rows = np.arange(len(index))[:, None, None], np.arange(len(free))[None, :, None]
        slope[nodes, rows, active[at_step][:, None, :]] += drives[index, POSE + n_rest :, p:]
    order = np.concatenate(
        [np.arange(size), p + np.arange(POSE), np.arange(size, p), np.arange(p + POSE, width)]
    )
    states, slope = states[..., order], slope[..., order]
    out_q, out_v, out_a = (np.zeros((len(index), nv, width)) for _ in range(3))
    out_q[:, prediction.rest_v] = states[:, POSE : POSE + n_rest]
    out_v[:, free] = states[:, POSE + n_rest :]
    out_a[:, free] = slope
    return Sensitivity(states[:, :POSE], out_q, out_v, out_a)


def _node_steps(timeline: Timeline) -> np.ndarray:
    """Step that starts at every node; at the end of a segment the one that ends there."""
    parts, first = [], 0
    for count in timeline.counts:
        parts += [np.arange(first, first + count), [first + count - 1]]
        first += int(count)
    return np.concatenate(parts).astype(int)


def _following(
    drive: Drive, timeline: Timeline, first: np.ndarray, response: np.ndarray, n: int
) -> np.ndarray:
    """Rate of the state (E, n, joints WINDOW) per coefficient of the prescribed motion.

    ``response`` (E, free, 3, joints): acceleration per joint angle, rate and acceleration.
    """
    assert drive.joints is not None
    windows = np.concatenate([np.repeat(first, STAGES), first[np.cumsum(timeline.counts) - 1]])
    basis = drive.joints.basis(timeline.evaluations, windows)
    found = np.einsum("efdj,dew->efjw", response, basis)
    out = np.zeros((len(windows), n, found.shape[2] * WINDOW))
    out[:, n - found.shape[1] :] = found.reshape(*found.shape[:2], -1)
    return out


def _starting(
    parameters: Parameters, drive: Drive, prediction: Prediction, follow: np.ndarray, first: int
) -> np.ndarray:
    """Start velocity (free, joints WINDOW) per coefficient: M_ff v_f + M_fp v_p = 0 differentiated."""
    assert drive.joints is not None
    model, free = prediction.model, drive.free
    data = model.createData()
    still = np.zeros(model.nv)
    # at zero rate and acceleration v the RNEA derivative is that of M(q) v
    pin.computeRNEADerivatives(model, data, prediction.q[0], still, prediction.v[0])
    mass = np.triu(data.M) + np.triu(data.M, 1).T
    basis = drive.joints.basis(prediction.timeline.edges[:1], np.array([first]))
    by_angle = data.dtau_dq[np.ix_(free, follow)]
    right = by_angle[:, :, None] * basis[0, 0] + mass[np.ix_(free, follow)][:, :, None] * basis[1, 0]
    return -np.linalg.solve(mass[np.ix_(free, free)], right.reshape(len(free), -1))


@dataclass(frozen=True)
class _Linear:
    """Linear rate (E, n, n) and drive (E, n, p) of x = (pose 6, rest, free velocities).

    p counts parameters and gains.

    ``start`` (free, p): derivative of the start velocity; ``follow`` (E, free, 3, joints): acceleration per
    angle, rate and acceleration of the prescribed joints.
    """

    rates: np.ndarray
    drives: np.ndarray
    start: np.ndarray
    follow: np.ndarray


def _linearised(
    parameters: Parameters,
    drive: Drive,
    prediction: Prediction,
    thrust: np.ndarray | None,
    follow: np.ndarray,
) -> _Linear:
    model, free = prediction.model, drive.free
    rest, rest_v = prediction.rest_q, prediction.rest_v
    nv, n_rest, n_free = parameters.layout.model.nv, len(rest), len(free)
    count, n, size = len(prediction.q), POSE + n_rest + n_free, parameters.size
    p, joints = size + 3, len(follow)
    response = np.zeros((count, n_free, 3, joints))
    rates, drives = np.zeros((count, n, n)), np.zeros((count, n, p))
    v = prediction.v
    rates[:, :POSE, :POSE] = -_small_adjoint(v[:, :6])
    velocity = POSE + n_rest
    base = [int(i) for i in free if i < 6]
    rates[:, base, [velocity + k for k in range(len(base))]] = 1.0
    at_rest = velocity + len(base) + np.arange(n_rest)
    rates[:, POSE + np.arange(n_rest), at_rest] = 1.0
    chain = parameters.theta_jacobian()
    used = np.flatnonzero(chain.any(axis=1))
    chain = chain[used]
    stiffness, damping, dk, dd = parameters.springs()
    spring_row = {int(i): k for k, i in enumerate(parameters.layout.model.spring_v)}
    sprung = [
        (int(np.flatnonzero(free == i)[0]), j, spring_row[int(i)])
        for j, i in enumerate(rest_v)
        if int(i) in spring_row
    ]
    data = model.createData()
    for first in range(0, count, BLOCK):
        chosen = slice(first, min(first + BLOCK, count))
        dq, dv, mass, y = _evaluated(model, data, prediction, chosen, len(used), used)
        left = mass[:, free][:, :, free]
        right = np.zeros((left.shape[0], n_free, n_rest + n_free + p + 3 * joints))
        right[:, :, :n_rest] = dq[:, free][:, :, rest_v]
        right[:, :, n_rest : n_rest + n_free] = dv[:, free][:, :, free]
        right[:, :, n_rest + n_free : n_rest + n_free + size] = y[:, free] @ chain
        for row, j, s in sprung:
            right[:, row, j] += stiffness[s]
            right[:, row, n_rest + row] += damping[s]
            at_q, at_v = prediction.q[chosen, rest[j]], v[chosen, rest_v[j]]
            right[:, row, n_rest + n_free : n_rest + n_free + size] += (
                at_q[:, None] * dk[s] + at_v[:, None] * dd[s]
            )
        if thrust is not None:
            right[:, :, n_rest + n_free + size : n_rest + n_free + p] -= thrust[chosen][:, free]
        for k, matrix in enumerate((dq, dv, mass) if joints else ()):
            start_ = n_rest + n_free + p + k * joints
            right[:, :, start_ : start_ + joints] = matrix[:, free][:, :, follow]
        solved = -np.linalg.solve(left, right)
        rates[chosen, velocity:, POSE:velocity] = solved[:, :, :n_rest]
        rates[chosen, velocity:, velocity:] = solved[:, :, n_rest : n_rest + n_free]
        drives[chosen, velocity:] = solved[:, :, n_rest + n_free : n_rest + n_free + p]
        response[chosen] = solved[:, :, n_rest + n_free + p :].reshape(len(left), n_free, 3, joints)
    start = np.zeros((n_free, p))
    if v[0].any():
        # zero free momentum M_ff v_f + M_fp v_p at the start, with M v = Y(q, 0, v) theta
        data = model.createData()
        y = pin.computeJointTorqueRegressor(model, data, prediction.q[0], np.zeros(nv), v[0])
        mass = pin.crba(model, data, prediction.q[0])
        mass = np.triu(mass) + np.triu(mass, 1).T
        start[:, :size] = -np.linalg.solve(mass[np.ix_(free, free)], y[free][:, used] @ chain)
    return _Linear(rates, drives, start, response)


def _evaluated(
    model: pin.Model, data: pin.Data, prediction: Prediction, chosen: slice, width: int, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """RNEA derivatives, mass matrix (N, nv, nv) and regressor (N, nv, width) at some evaluations."""
    q, v, a = prediction.q[chosen], prediction.v[chosen], prediction.a[chosen]
    n, nv = v.shape
    dq, dv, mass = np.empty((3, n, nv, nv))
    y = np.empty((n, nv, width))
    everything = width == 10 * (model.njoints - 1)
    for i in range(n):
        pin.computeRNEADerivatives(model, data, q[i], v[i], a[i])
        dq[i], dv[i], mass[i] = data.dtau_dq, data.dtau_dv, data.M
        full = pin.computeJointTorqueRegressor(model, data, q[i], v[i], a[i])
        y[i] = full if everything else full[:, used]
    upper = np.triu(mass)
    return dq, dv, upper + np.triu(mass, 1).transpose(0, 2, 1), y


def _small_adjoint(v: np.ndarray) -> np.ndarray:
    """Return ad(v) (N, 6, 6) of twists (N, 6): ad(v) xi = (omega x rho + v x phi, omega x phi)."""
    out = np.zeros((len(v), 6, 6))
    linear, angular = skew(v[:, :3]), skew(v[:, 3:])
    out[:, :3, :3] = out[:, 3:, 3:] = angular
    out[:, :3, 3:] = linear
    return out


def skew(x: np.ndarray) -> np.ndarray:
    """Return matrices (..., 3, 3) with skew(x) y = x cross y."""
    out = np.zeros((*x.shape, 3))
    a, b, c = np.moveaxis(x, -1, 0)
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -c, b, -a
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = c, -b, a
    return out
