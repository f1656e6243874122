"""A filter's run with the motion as all readings have it, of which slopes of a likelihood are exact.

Where the likelihood is compared at the likeliest states and torques, they are at a minimum of what it costs:
that they move with a parameter changes nothing, and its slope is the one along them (the envelope theorem).
So the filter's predictions, which know of earlier readings only, are replaced by smoothed states before
anything is differentiated along them. Smoothing is by disturbances, without a covariance a sample (Koopman,
Biometrika 80 (1993) 117): backwards ``lambda = (I - K H)' F' lambda_next - H' S^-1 r``, then forwards
``d_next = F (d - K r) - Q lambda_next`` from ``d = - P lambda`` at the first sample, with d what is added to
the predictions, Q the noise of the process and the other names as in `smsid.estimation._smoother`.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from smsid.estimation.filter_pass import compiled_pays
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.process_model import ProcessModel
from smsid.kernel.arrays import Kernel
from smsid.kernel.derivatives import accelerations_along
from smsid.simulate.trajectory import States


class SmoothedRun(NamedTuple):
    """A run of a filter, as it ``ran`` and ``along`` the smoothed motion; of that what the k unknown forces
    and rates ``begin`` with (k,), zero after the first run, and what these did to the next states as they
    ``wandered``, and after them the d inputs that err (`erring_inputs`) by their errors (N - 1, k + d, x).
    ``None`` where nothing was smoothed.
    """

    ran: FilterRun
    along: FilterRun
    begin: np.ndarray | None = None
    wandered: np.ndarray | None = None


def smoothed_runs(kalman: KalmanFilter, samples: int) -> Iterator[SmoothedRun]:
    """Yield runs of a filter from its first sample on, so many ``samples`` each, ``states`` and ``middle``
    smoothed by all samples.

    Of more samples than that, the filter runs three times, so that little is in memory. ``errors`` of what is
    smoothed are zero: there is nothing left to correct. Raises `SimulationError` when the filter loses the
    recording.
    """
    count = len(kalman.problem.data.times)
    width, whole = len(kalman.covariance), max(1, -(-count // samples))
    starts: list[KalmanFilter] = []
    for _ in range(whole):
        starts.append(copy(kalman))
        if whole > 1:
            kalman.advance(samples)
    ends = [np.zeros(width)]
    for start in starts[:0:-1]:
        ends.append(_slopes(copy(start).advance(samples), ends[-1])[0])
    plant, change = kalman.base.plant, None
    kernel = plant.kernel() if compiled_pays() else None
    for start, end in zip(starts, ends[::-1], strict=True):
        first = start.covariance
        run = start.advance(samples)
        slopes = np.vstack([_slopes(run, end), end])
        change = -first @ slopes[0] if change is None else change
        walked = _wandered(kalman, run, slopes[1:])
        wandered = np.concatenate([walked, _erred(kalman, run, slopes[1:])], axis=1)
        here, after = _changes(kalman, run, slopes, change, wandered)
        known = slice(2 * plant.nv, 2 * plant.nv + walked.shape[1])
        begin = change[known] if start is starts[0] else np.zeros(walked.shape[1])
        change = here[-1]
        along = _moved(run, here, after, plant, kernel, kalman.forces.acts)
        yield SmoothedRun(run, along, begin, wandered)


def _slopes(run: FilterRun, end: np.ndarray) -> np.ndarray:
    """Return lambda (N, x) at the samples of a run, of ``end`` (x,) at the one after it."""
    pulls = np.einsum("nsx,nrs,nr->nx", run.sensitivity, run.whitening, run.innovations, optimize=True)
    out, now = np.empty_like(pulls), end
    for k in range(len(out) - 1, -1, -1):
        if k < len(run.transition):
            now = run.transition[k].T @ now
        out[k] = now = now - run.sensitivity[k].T @ (run.gain[k].T @ now) - pulls[k]
    return out


def _changes(
    kalman: KalmanFilter, run: FilterRun, slopes: np.ndarray, first: np.ndarray, wandered: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return what smoothing adds to predictions (N, x), also that of a sample after the run, if there is one,
    and to what the filter had after each reading (N, x); ``first`` (x,) is that of the first prediction.
    """
    noise = wandered.sum(axis=1) - _of_biases(kalman, run, slopes[1:]) - _of_jumps(kalman, run, slopes[1:])
    corrections = np.einsum("nxr,nr->nx", run.gain, np.where(run.used, run.errors, 0.0))
    here, after = [first], np.empty_like(corrections)
    for k, correction in enumerate(corrections):
        after[k] = here[k] - correction
        if k < len(run.transition):
            here.append(run.transition[k] @ after[k] + noise[k])
    return np.array(here), after


def _wandered(kalman: KalmanFilter, run: FilterRun, slopes: np.ndarray) -> np.ndarray:
    """Return what the walk of each unknown force or rate does to the next state (N, k, x): - Q lambda for
    ``slopes`` lambda (N, x) at the samples that transitions lead to.
    """
    move, walk, inner = run.transition, kalman.forces.walk, 2 * kalman.model.nv
    known = inner + walk.shape[1]
    lead, passed = slopes[: len(move)], np.diff(run.edges)[: len(move), None]
    moved, onwards = move[:, :inner, inner:known], move[:, inner:known, inner:known]
    own = np.einsum("nij,ni->nj", onwards, lead[:, inner:known])
    drawn = np.einsum("nxj,nx->nj", moved, lead[:, :inner])
    end, common, mean = (row * passed for row in walk)
    out = np.zeros((len(move), walk.shape[1], lead.shape[1]))
    out[:, :, :inner] = -np.einsum("nxj,nj->njx", moved, mean * drawn + common * own)
    out[:, :, inner:known] = -np.einsum("nij,nj->nji", onwards, common * drawn + end * own)
    return out


def erring_inputs(kalman: KalmanFilter) -> np.ndarray:
    """Return the degrees of freedom (d,) whose inputs err by what is held over a sample."""
    return np.flatnonzero(kalman.input_noise)


def _erred(kalman: KalmanFilter, run: FilterRun, slopes: np.ndarray) -> np.ndarray:
    """Return what the error of each input that errs does to the next state (N, d, x): - Q lambda."""
    erring, lead = erring_inputs(kalman), slopes[: len(run.transition)]
    pushed = np.einsum("nxi,nij->njx", run.forcing, run.middle_inverse[:, :, erring])
    drawn = kalman.input_noise[erring] * np.einsum("njx,nx->nj", pushed, lead)
    return -pushed * drawn[:, :, None]


def _of_biases(kalman: KalmanFilter, run: FilterRun, slopes: np.ndarray) -> np.ndarray:
    """Return Q lambda (N, x) of biases that wander."""
    lead = slopes[: len(run.transition)]
    out = np.zeros_like(lead)
    if kalman.walks is not None:
        passed = np.diff(run.edges)[: len(lead), None]
        known = 2 * kalman.model.nv + kalman.forces.walk.shape[1]
        out[:, known:] = kalman.walks.rates * passed * lead[:, known:]
    return out


def _of_jumps(kalman: KalmanFilter, run: FilterRun, slopes: np.ndarray) -> np.ndarray:
    """Return Q lambda (N, x) of commands that jump at an unknown time."""
    lead = slopes[: len(run.transition)]
    out, jumps = np.zeros_like(lead), kalman.jumps(run.edges)
    if jumps is not None:
        at = np.flatnonzero(jumps[: len(lead)].any(axis=1))
        pushed = np.einsum("nxi,nij,nj->nx", run.forcing[at], run.middle_inverse[at], jumps[at])
        out[at] = pushed * np.einsum("nx,nx->n", pushed, lead[at])[:, None]
    return out


def _moved(
    run: FilterRun,
    here: np.ndarray,
    after: np.ndarray,
    plant: ProcessModel,
    kernel: Kernel | None,
    acts: np.ndarray,
) -> FilterRun:
    """Return a run with states at samples changed by ``here`` (N or more, x), and between them by what is
    left of it after readings (``after``) and at the next sample.

    What a force does between samples is by the mean of accelerations there, which is what takes the one rate
    to the next.
    """
    nv, count = plant.nv, len(run.middle.time)
    ends = after[:count], here[1 : count + 1]
    middle = _states(run.middle, 0.5 * (ends[0] + ends[1]), plant, kernel, acts)
    rates = slice(nv, 2 * nv)
    rise = (ends[1][:, rates] - ends[0][:, rates]) / np.diff(run.edges)[:count, None]
    return replace(
        run,
        states=_states(run.states, here[: len(run.states.time)], plant, kernel, acts),
        middle=replace(middle, a=run.middle.a + rise),
        errors=np.zeros_like(run.errors),
    )


def _states(
    states: States, change: np.ndarray, plant: ProcessModel, kernel: Kernel | None, acts: np.ndarray
) -> States:
    """Return states moved by changes (N, x) of the tangent of q, of v and of forces on ``acts`` (k,)."""
    nv = plant.nv
    steps = zip(states.q, change[:, :nv], strict=True)
    q = np.array([pin.integrate(plant.pin, *x) for x in steps]).reshape(states.q.shape)
    v, tau = states.v + change[:, nv : 2 * nv], states.tau.copy()
    tau[:, acts] += change[:, 2 * nv : 2 * nv + len(acts)]
    a = np.empty_like(v)
    if kernel is not None:
        accelerations_along(*kernel.arrays, states.time, q, v, tau, a)
    else:
        for k, (t, *at) in enumerate(zip(states.time, q, v, tau, strict=True)):
            a[k] = plant.acceleration(float(t), *at)
    return replace(states, q=q, v=v, tau=tau, a=a)
