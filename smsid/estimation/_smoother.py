"""Fixed-interval smoothing of a filter's run: states at every sample from all samples, with covariances.

The modified Bryson-Frazier smoother (Bierman, *Factorization Methods for Discrete Sequential Estimation*
(1977), chapter 10) runs backwards over what the filter kept and inverts no covariance, which here is singular
where a joint is locked. With predictions ``x``, ``P``, innovations ``r`` of covariance S, gain K and
transition F: ``lambda = (I - K H)' F' lambda_next - H' S^-1 r``, ``Lambda = (I - K H)' F' Lambda_next F
(I - K H) + H' S^-1 H``, and the smoothed state is ``x - P lambda`` with covariance ``P - P Lambda P``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from smsid.estimation.filter_pass import walk_covariance
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.problem import Problem
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate.trajectory import States


@dataclass(frozen=True)
class SmoothedStates:
    """States at the samples given all of them.

    ``states`` has q (N, nq) and v (N, nv); accelerations and forces are the filter's predictions.
    ``unknown`` (N, k) are the unknown inputs and their rates. ``covariance`` (N, x, x) is that of the tangent
    of q, of v and of these, x = 2 nv + k; of the parameters it knows nothing: they are taken as exact.
    """

    states: States
    unknown: np.ndarray
    covariance: np.ndarray


def smoothed_states(model: SpacecraftModel, problem: Problem) -> SmoothedStates:
    """Return the smoothed states of a recording under a model.

    The whole run is kept in memory: some (2 nv)^2 numbers a sample, four times. Raises `SimulationError`
    when the filter loses the recording.
    """
    filtering = KalmanFilter(model, problem)
    first, noise, walk = filtering.covariance, filtering.input_noise, filtering.forces.walk
    jumps = filtering.jumps(np.asarray(problem.data.times, dtype=float))
    wander = np.zeros(0) if filtering.walks is None else filtering.walks.rates
    run = filtering.advance(len(problem.data.times))
    change, covariance = bryson_frazier(
        predicted_covariances(run, first, problem.data.sigma**2, noise, walk, wander, jumps),
        run.transition,
        run.sensitivity,
        run.whitening,
        run.gain,
        run.innovations,
    )
    nv, known = model.nv, 2 * model.nv + walk.shape[1]
    predicted = _unknown_inputs(run, slice(2 * nv, known))
    q = np.array([pin.integrate(model.pin, a, d) for a, d in zip(run.states.q, change[:, :nv], strict=True)])
    states = replace(run.states, q=q, v=run.states.v + change[:, nv : 2 * nv])
    return SmoothedStates(states, predicted + change[:, 2 * nv : known], covariance[:, :known, :known])


def predicted_covariances(
    run: FilterRun,
    first: np.ndarray,
    variance: np.ndarray,
    input_noise: np.ndarray,
    walk: np.ndarray,
    wander: np.ndarray | tuple[()] = (),
    jumps: np.ndarray | None = None,
) -> np.ndarray:
    """Return the covariances (N, x, x) of the predictions, which a run does not keep.

    ``first`` (x, x) is that at the first sample, ``variance`` (rows,) that of readings, ``input_noise`` (nv,)
    that of inputs over a sample, ``walk`` (3, k) by how much the unknown inputs' variance grows in a second
    (`UnknownForces`), ``wander`` (m,) the same of biases that wander; ``jumps`` (N - 1, nv) as in
    `KalmanFilter.jumps`.
    Joseph's form, in which rounding dies out: the gains are the run's own.
    """
    n, width = len(run.gain), first.shape[0]
    out = np.empty((n, width, width))
    p = first
    for k in range(n):
        out[k] = p
        if k == n - 1:
            break
        there = run.used[k]
        gain = run.gain[k][:, there]
        left = np.eye(width) - gain @ run.sensitivity[k][there]
        p = left @ p @ left.T + (gain * variance[there]) @ gain.T
        b = run.forcing[k] @ run.middle_inverse[k]
        p = run.transition[k] @ p @ run.transition[k].T + (b * input_noise) @ b.T
        if jumps is not None:
            p += np.outer(b @ jumps[k], b @ jumps[k])
        passed, known = float(run.edges[k + 1] - run.edges[k]), width - len(wander)
        if walk.size:
            inner = known - walk.shape[1]
            added = walk_covariance(run.transition[k][:inner, inner:known], walk * passed)
            onwards = run.transition[k][inner:known, inner:known]  # inputs by their rates
            added[inner:] = onwards @ added[inner:]
            added[:, inner:] = added[:, inner:] @ onwards.T
            p[:known, :known] += added
        p[range(known, width), range(known, width)] += np.asarray(wander) * passed
        p = 0.5 * (p + p.T)
    return out


def bryson_frazier(
    predicted: np.ndarray,
    transition: np.ndarray,
    sensitivity: np.ndarray,
    whitening: np.ndarray,
    gain: np.ndarray,
    innovations: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return what smoothing adds to predictions (N, x), and its covariances (N, x, x).

    Args:
        predicted: covariances (N, x, x) of the predictions.
        transition: F (N - 1, x, x) from sample to sample.
        sensitivity: H (N, m, x).
        whitening: W (N, m, m) with ``W' W`` the inverse of the innovations' covariance; zero rows and columns
            where nothing was measured.
        gain: K (N, x, m) from errors of the prediction to states.
        innovations: whitened (N, m).
    """
    n, width = predicted.shape[:2]
    change, covariance = np.empty((n, width)), np.empty((n, width, width))
    slope, curvature = np.zeros(width), np.zeros((width, width))
    for k in range(n - 1, -1, -1):
        if k < n - 1:
            slope = transition[k].T @ slope
            curvature = transition[k].T @ curvature @ transition[k]
        white = whitening[k] @ sensitivity[k]
        kept = np.eye(width) - gain[k] @ sensitivity[k]
        slope = kept.T @ slope - white.T @ innovations[k]
        curvature = kept.T @ curvature @ kept + white.T @ white
        curvature = 0.5 * (curvature + curvature.T)
        p = predicted[k]
        change[k] = -p @ slope
        covariance[k] = p - p @ curvature @ p
        covariance[k] = 0.5 * (covariance[k] + covariance[k].T)
    return change, covariance


def _unknown_inputs(run: FilterRun, own: slice) -> np.ndarray:
    """Return the unknown inputs and their rates (N, k) as predicted, from where corrections left them."""
    corrections = np.einsum("nxr,nr->nx", run.gain[:, own], np.where(run.used, run.errors, 0.0))
    out = np.zeros_like(corrections)
    for k in range(1, len(out)):
        out[k] = run.transition[k - 1][own, own] @ (out[k - 1] + corrections[k - 1])
    return out
