"""Derivatives of a predicted motion by everything that moves it: the variational equations along it.

Linearised at the nodes of the grid only; inside a step the coefficients are interpolated as the outputs are,
and the steps' transition maps come from the Runge-Kutta rule of the prediction. The equations are linear: the
state of all derivatives is carried on by one matrix product a step. A coefficient of the measured joint
motion has no effect before the first of its knots, so coefficients are ordered by time and only those begun
are carried.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from smsid.likelihood.inputs import Drive
from smsid.likelihood.linearised import POSE, Linear, linearise, small_adjoint
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction, symmetric
from smsid.likelihood.runge_kutta import STAGES, transitions
from smsid.likelihood.spline import WINDOW

CHUNK = 32  # nodes handed out at a time


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives at the nodes by P columns, as `Kinematics.jacobian` takes them.

    ``pose`` (nodes, 6, P): (rho, phi) in the bus frame; ``q`` (nodes, nv, P) of joints, ``v``, ``a`` (nodes,
    nv, P).
    """

    pose: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


@dataclass(frozen=True)
class Variation:
    """Transition maps of the derivatives of x = (pose 6, rest, free velocities): n rows.

    Columns: the moving ones among parameters, thrust gains and running clocks (``moving`` (k,) of them,
    numbered in this order), the initial pose (6), and coefficients of the measured joint motion, joint by
    joint within each.
    ``phi`` (steps, n, n), ``gamma`` (steps, n, k) and of the motion (steps, n, WINDOW joints) for
    coefficients from ``first`` (nodes,) on. ``slope_state`` (nodes, free, n), ``slope_moving`` (nodes, free,
    k) and ``slope_motion`` (nodes, free, WINDOW joints): free accelerations.
    """

    prediction: Prediction
    free: np.ndarray
    moving: np.ndarray
    joints: int
    coefficients: int
    phi: np.ndarray
    gamma: np.ndarray
    gamma_motion: np.ndarray
    first: np.ndarray
    start: np.ndarray
    slope_state: np.ndarray
    slope_moving: np.ndarray
    slope_motion: np.ndarray

    @property
    def front(self) -> int:
        """Number of columns ahead of the motion's."""
        return len(self.moving) + POSE

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.front + self.joints * self.coefficients

    def begun(self, node: int) -> int:
        """Return the number of columns that may differ from zero at a node."""
        return self.front + (self.joints * (int(self.first[node]) + WINDOW) if self.joints else 0)

    def window(self, node: int) -> slice:
        """Return the columns of the motion that act at a node."""
        place = self.front + self.joints * int(self.first[node])
        return slice(place, place + self.joints * WINDOW)

    def states(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield, chunk by chunk, nodes and the derivatives of x there (chunk, n, columns begun)."""
        timeline, k = self.prediction.timeline, len(self.moving)
        last = np.cumsum(timeline.counts + 1) - 1
        ends, nodes = set(last.tolist()), int(last[-1]) + 1
        x, step = self.start.copy(), 0
        for begin in range(0, nodes, CHUNK):
            chunk = slice(begin, min(begin + CHUNK, nodes))
            out = np.zeros((chunk.stop - begin, len(x), self.begun(chunk.stop - 1)))
            for node in range(begin, chunk.stop):
                width = self.begun(node)
                out[node - begin, :, :width] = x[:, :width]
                if node in ends:
                    continue
                x[:, :width] = self.phi[step] @ x[:, :width]
                x[:, :k] += self.gamma[step]
                if self.joints:
                    x[:, self.window(node)] += self.gamma_motion[step]
                step += 1
            yield chunk, out


def variation(
    parameters: Parameters,
    drive: Drive,
    prediction: Prediction,
    thrust: np.ndarray | None,
    clocks: np.ndarray | None,
    *,
    motion: bool,
) -> Variation:
    """Return the variational equations of a prediction.

    ``thrust`` (nodes, nv, 3): force per unit gain, by axis, when gains are sought. ``clocks`` (nodes, nv, 3,
    c): prescribed angle, rate and acceleration by offsets and drifts of the clocks they run by, when those
    are. ``motion``: with the coefficients of the measured joint motion.
    """
    timeline, free = prediction.timeline, drive.free
    follow = parameters.layout.model.arm_joints.v if motion and drive.joints is not None else np.zeros(0, int)
    linear = linearise(parameters, drive, prediction, thrust, clocks, follow)
    moving = np.flatnonzero(linear.by_parameter.any(axis=(0, 1)) | linear.start.any(axis=0))
    by_parameter = linear.by_parameter[:, :, moving]
    n_rest, k = len(prediction.rest_v), len(moving)
    n = POSE + n_rest + len(free)
    first, coefficients = np.zeros(timeline.steps, dtype=int), 0
    windows = [np.zeros((timeline.steps, len(free), 0))] * STAGES
    slope_motion = np.zeros((len(by_parameter), len(free), 0))
    if len(follow):
        assert drive.joints is not None
        coefficients = len(drive.joints.coefficients)
        first = drive.joints.windows(timeline.step_starts)
        windows, slope_motion = _following(drive, prediction, linear, first)
    rates, drives = _rates(prediction, linear, free), []
    for own, window in zip(timeline.at_stages(by_parameter), windows, strict=True):
        full = np.zeros((timeline.steps, n, k + window.shape[2]))
        full[:, POSE + n_rest :, :k] = own
        full[:, POSE + n_rest :, k:] = window
        drives.append(full)
    phi, gamma, _ = transitions(rates, drives, timeline.h)
    assert gamma is not None
    start = np.zeros((n, k + POSE + len(follow) * coefficients))
    start[POSE + n_rest :, :k] = linear.start[:, moving]
    start[:POSE, k : k + POSE] = np.eye(POSE)
    if len(follow):
        place = k + POSE + len(follow) * int(first[0])
        start[POSE + n_rest :, place : place + WINDOW * len(follow)] = _starting(
            drive, prediction, follow, int(first[0])
        )
    return Variation(
        prediction,
        free,
        moving,
        len(follow),
        coefficients,
        phi,
        gamma[:, :, :k],
        gamma[:, :, k:],
        first[timeline.node_step],
        start,
        linear.by_state,
        by_parameter,
        slope_motion,
    )


def _rates(prediction: Prediction, linear: Linear, free: np.ndarray) -> list[np.ndarray]:
    """Linear rates of x (steps, n, n) at the seven stages."""
    timeline = prediction.timeline
    n_rest, steps = len(prediction.rest_v), timeline.steps
    velocity = POSE + n_rest
    n = velocity + len(free)
    base = [int(i) for i in free if i < 6]
    stage_v = timeline.at_stages(prediction.v[:, :6])
    out = []
    for base_v, by_state in zip(stage_v, timeline.at_stages(linear.by_state), strict=True):
        rate = np.zeros((steps, n, n))
        rate[:, :POSE, :POSE] = -small_adjoint(base_v)
        rate[:, base, [velocity + k for k in range(len(base))]] = 1.0
        rate[:, POSE + np.arange(n_rest), velocity + len(base) + np.arange(n_rest)] = 1.0
        rate[:, velocity:] = by_state
        out.append(rate)
    return out


def _following(
    drive: Drive, prediction: Prediction, linear: Linear, first: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    """Free accelerations per coefficient of the motion, (steps, free, WINDOW joints): at stages and nodes."""
    assert drive.joints is not None
    timeline = prediction.timeline
    steps = timeline.steps
    out = []
    times = timeline.evaluations[: steps * STAGES].reshape(steps, STAGES)
    found: dict[float, np.ndarray] = {}
    for j, by_motion in enumerate(timeline.at_stages(linear.by_motion)):
        key = float(times[0, j])
        if key not in found:
            basis = drive.joints.basis(times[:, j], first)
            found[key] = np.einsum("sfdj,dsw->sfwj", by_motion, basis, optimize=True).reshape(
                steps, by_motion.shape[1], -1
            )
        out.append(found[key])
    node_times = timeline.evaluations[timeline.node_evaluation]
    basis = drive.joints.basis(node_times, first[timeline.node_step])
    nodes = np.einsum("sfdj,dsw->sfwj", linear.by_motion, basis, optimize=True)
    return out, nodes.reshape(*nodes.shape[:2], -1)


def _starting(drive: Drive, prediction: Prediction, follow: np.ndarray, first: int) -> np.ndarray:
    """Start velocity (free, WINDOW joints) per coefficient: M_ff v_f + M_fp v_p = 0 differentiated."""
    assert drive.joints is not None
    model, free = prediction.model, drive.free
    data = model.createData()
    # at zero rate and acceleration v the RNEA derivative is that of M(q) v
    pin.computeRNEADerivatives(model, data, prediction.q[0], np.zeros(model.nv), prediction.v[0])
    mass = symmetric(data.M)
    basis = drive.joints.basis(prediction.timeline.edges[:1], np.array([first]))
    by_angle = data.dtau_dq[np.ix_(free, follow)]
    right = (
        by_angle[:, None] * basis[0, 0][:, None] + mass[np.ix_(free, follow)][:, None] * basis[1, 0][:, None]
    )
    return -np.linalg.solve(mass[np.ix_(free, free)], right.reshape(len(free), -1))
