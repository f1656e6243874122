"""Torques that follow what is read, as lively as that says: in units of a reading whose scale is unknown.

How far such a torque wanders is told by the reading that follows it. Of a reading 1 % too large, so is its
walk. Were the walk held when the scale is searched, the cost of what has wandered would tell the scale: it
falls with the torques' squares, and over minutes a scale that nothing tells would lean to small torques.

By what a model errs goes the same way: errors are of accelerations, and the forces that make them are as much
larger as the craft is heavier. Were these held, a light craft would err at less cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.estimation._smoothed_motion import SmoothedRun, erring_inputs
from smsid.estimation.kalman import KalmanFilter, input_covariance
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Problem
from smsid.estimation.sensitivities import DIFFERENCE_STEP, Sensitivity


def walks_as_read(problem: Problem) -> Problem:
    """Return the problem with walks as lively as readings say through their gains, where it is `profiled` at
    the likeliest motion.
    """
    if not problem.at_likeliest_motion:
        return problem
    gains = _gains(problem)
    inputs = tuple(
        replace(u, sigma=u.sigma / g, walk=u.walk / g, slope=u.slope / g)
        for u, g in zip(problem.unknown_inputs, gains, strict=True)
    )
    return replace(problem, unknown_inputs=inputs)


@dataclass(frozen=True)
class WalkDerivatives:
    """By which ``shares`` (m, k + d) of themselves walks change with parameters, forces, then rates of some,
    and after these the noise of inputs.
    """

    shares: np.ndarray

    @classmethod
    def of(cls, here: Point, unknowns: Sequence[Unknown], kalman: KalmanFilter) -> WalkDerivatives:
        """Return those at the point that a filter is of."""
        problem, erring = kalman.problem, erring_inputs(kalman)
        errs = bool(problem.noise.accelerations)  # other noise is of forces, whatever the craft weighs
        inputs = problem.unknown_inputs
        sloped = [i for i, u in enumerate(inputs) if u.slope]
        walks = len(inputs) + len(sloped)
        shares = np.zeros((len(unknowns), walks + len(erring)))
        if problem.at_likeliest_motion:
            gains = _gains(problem)
            for i, u in enumerate(unknowns):
                step = DIFFERENCE_STEP * u.scale
                step = step if here.value(u) + step <= here.bounds(u)[1] else -step
                if u.kind in ("sensor", "effect"):  # scales of readings are either
                    sensors = here.moved([u], np.array([step])).sensors()
                    moved = _gains(replace(problem, data=problem.data.with_blocks(sensors)))
                    own = (gains / moved - 1.0) / step
                    shares[i, :walks] = np.concatenate([own, own[sloped]])
                if u.kind in ("inertial", "effect") and errs:
                    model = here.moved([u], np.array([step])).model()
                    larger = input_covariance(model, problem)[erring] / kalman.input_noise[erring]
                    shares[i, walks:] = 0.5 * (larger - 1.0) / step
        return cls(shares)

    def with_walks(
        self, changes: Sequence[Sensitivity], smoothed: SmoothedRun, delta: np.ndarray
    ) -> list[Sensitivity]:
        """Return changes along a smoothed run with those of its walks; those of the first state are added to
        ``delta`` (x, m).
        """
        out = list(changes)
        if smoothed.wandered is None or smoothed.begin is None:
            return out
        known = slice(smoothed.ran.by_a.shape[2] * 2, None)
        walks = len(smoothed.begin)
        for i in np.flatnonzero(self.shares.any(axis=1)):
            delta[known, i][:walks] += self.shares[i, :walks] * smoothed.begin
            ahead = np.einsum("k,nkx->nx", self.shares[i], smoothed.wandered)
            if (own := out[i].ahead) is not None:
                ahead[:, : own.shape[1]] += own
            out[i] = replace(out[i], ahead=ahead)
        return out


def _gains(problem: Problem) -> np.ndarray:
    """Return by how much more is read than there is, of what each unknown input drives (k,)."""
    blocks = problem.data.blocks
    out = np.ones(len(problem.unknown_inputs))
    for i, u in enumerate(problem.unknown_inputs):
        for b in blocks:
            if b.rows.start <= u.row < b.rows.stop:
                k = u.row - b.rows.start
                out[i] = abs(b.gain[k, k])
    return out
