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

BLOCK = 200  # evaluations linearised at a time: they stay in the cache

POSE = 6


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives at the nodes by P = (parameters, initial position 3 and attitude 3, thrust gains 3).

    ``pose`` (nodes, 6, P): (rho, phi) in the bus frame; ``q`` (nodes, nv, P) of joints, ``v``, ``a`` (nodes,
    nv, P).
    """

    pose: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def sensitivity(
    parameters: Parameters, drive: Drive, prediction: Prediction, thrust: np.ndarray | None
) -> Sensitivity:
    """Return the derivatives of a prediction; ``thrust`` (E, nv, 3) is the force per unit gain, by axis."""
    rates, drives, start = _linearised(parameters, drive, prediction, thrust)
    timeline, free = prediction.timeline, drive.free
    nv = parameters.layout.model.nv
    steps, n_rest, n = timeline.steps, len(prediction.rest_v), rates.shape[1]
    width = parameters.size + 3 + POSE
    inner = steps * STAGES
    phi, gamma, _ = transitions(
        rates[:inner].reshape(steps, STAGES, n, n), drives[:inner].reshape(steps, STAGES, n, -1), timeline.h
    )
    assert gamma is not None
    p = drives.shape[2]
    x = np.zeros((n, width))
    x[POSE + n_rest :, :p] = start
    x[:POSE, p:] = np.eye(POSE)
    nodes = []
    step = 0
    for count in timeline.counts:
        for _ in range(count):
            nodes.append(x)
            x = phi[step] @ x
            x[:, :p] += gamma[step]
            step += 1
        nodes.append(x)
    states = np.array(nodes)
    index = timeline.node_evaluation
    slope = rates[index, POSE + n_rest :] @ states
    slope[:, :, :p] += drives[index, POSE + n_rest :]
    out_q, out_v, out_a = np.zeros((3, len(index), nv, width))
    out_q[:, prediction.rest_v] = states[:, POSE : POSE + n_rest]
    out_v[:, free] = states[:, POSE + n_rest :]
    out_a[:, free] = slope
    # columns: parameters, initial pose, gains
    order = np.concatenate([np.arange(parameters.size), np.arange(p, width), np.arange(parameters.size, p)])
    return Sensitivity(states[:, :POSE][..., order], out_q[..., order], out_v[..., order], out_a[..., order])


def _linearised(
    parameters: Parameters, drive: Drive, prediction: Prediction, thrust: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Linear rate (E, n, n) and drive (E, n, p) of x = (pose 6, rest, free velocities), and d start (f, p)."""
    model, free = prediction.model, drive.free
    rest, rest_v = prediction.rest_q, prediction.rest_v
    nv, n_rest, n_free = parameters.layout.model.nv, len(rest), len(free)
    count, n, size = len(prediction.q), POSE + n_rest + n_free, parameters.size
    p = size + 3
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
        right = np.zeros((left.shape[0], n_free, n_rest + n_free + p))
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
            right[:, :, n_rest + n_free + size :] -= thrust[chosen][:, free]
        solved = -np.linalg.solve(left, right)
        rates[chosen, velocity:, POSE:velocity] = solved[:, :, :n_rest]
        rates[chosen, velocity:, velocity:] = solved[:, :, n_rest : n_rest + n_free]
        drives[chosen, velocity:] = solved[:, :, n_rest + n_free :]
    start = np.zeros((n_free, p))
    if v[0].any():
        # zero free momentum M_ff v_f + M_fp v_p at the start, with M v = Y(q, 0, v) theta
        data = model.createData()
        y = pin.computeJointTorqueRegressor(model, data, prediction.q[0], np.zeros(nv), v[0])
        mass = pin.crba(model, data, prediction.q[0])
        mass = np.triu(mass) + np.triu(mass, 1).T
        start[:, :size] = -np.linalg.solve(mass[np.ix_(free, free)], y[free][:, used] @ chain)
    return rates, drives, start


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
