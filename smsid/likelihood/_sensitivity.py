"""Derivatives of a predicted motion by everything that moves it: the variational equations along it.

Linearised at the nodes of the grid only; inside a step the coefficients are interpolated as the outputs are,
and the steps' transition maps come from the Runge-Kutta rule of the prediction. The equations are linear: the
state of all derivatives is carried on by one matrix product a step. They are made for a part of the nodes at
a time, so that memory does not go with the length of a recording.

A coefficient of the measured joint motion acts within a window of the grid only; what it did before is in the
state. So derivatives along a few nodes are taken by the state at the first of them, by what is common to all
nodes, and by those coefficients that act there (`Part.along`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from smsid.likelihood._linearised import POSE, linearise, small_adjoint, start_velocities
from smsid.likelihood.inputs import DrivenMotion
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction
from smsid.likelihood.spline import WINDOW
from smsid.likelihood.time_grid import PLACES, POINTS, C, transitions


@dataclass(frozen=True)
class NodeSensitivity:
    """Derivatives at the nodes by P columns, as `Kinematics.jacobian` takes them.

    ``pose`` (nodes, 6, P): (rho, phi) in the bus frame; ``q`` (nodes, nv, P) of joints, ``v``, ``a`` (nodes,
    nv, P).
    """

    pose: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


@dataclass(frozen=True)
class TransitionPart:
    """Transition maps of the derivatives of x = (pose 6, rest, free velocities), n rows, along some nodes.

    ``nodes`` are those; ``step`` (nodes,) numbers the maps of the steps that start there, -1 where none does.
    ``first`` (nodes,) is the first coefficient that acts there. ``phi`` (steps, n, n), ``gamma`` (steps, n,
    k) by the k moving columns and ``gamma_motion`` (steps, n, WINDOW joints) by coefficients from the first
    on, those of one time joint by joint. At a node after which thrust switches, x changes by ``kicks`` (n,)
    with the column that is that switch's time. ``slope_state`` (nodes, free, n), ``slope_moving`` (nodes,
    free, k) and ``slope_motion`` (nodes, free, WINDOW joints): free accelerations.
    """

    nodes: slice
    step: np.ndarray
    first: np.ndarray
    joints: int
    phi: np.ndarray
    gamma: np.ndarray
    gamma_motion: np.ndarray
    slope_state: np.ndarray
    slope_moving: np.ndarray
    slope_motion: np.ndarray
    kicks: Mapping[int, tuple[int, np.ndarray]]

    def along(self, nodes: slice, common: int) -> np.ndarray:
        """Return the derivatives of x (nodes, n, n + common + joints coefficients) at some of the nodes.

        By x at the first of them, by ``common`` columns, the moving ones leading, and by the coefficients
        that act there.
        """
        n, k = self.gamma.shape[1:]
        own = range(nodes.start - self.nodes.start, nodes.stop - self.nodes.start)
        first, last = int(self.first[own[0]]), int(self.first[own[-1]])
        motion = n + common
        width = motion + (self.joints * (last - first + WINDOW) if self.joints else 0)
        out = np.empty((len(own), n, width))
        x = np.eye(n, width)
        for place, node in enumerate(own):
            out[place] = x
            step = self.step[node]
            if place + 1 < len(own) and (kick := self.kicks.get(node)) is not None:
                x[:, n + kick[0]] += kick[1]
            if step >= 0 and place + 1 < len(own):
                x = self.phi[step] @ x
                x[:, n : n + k] += self.gamma[step]
                if self.joints:
                    at = motion + self.joints * (int(self.first[node]) - first)
                    x[:, at : at + self.joints * WINDOW] += self.gamma_motion[step]
        return out


@dataclass(frozen=True)
class VariationalEquations:
    """The variational equations of a prediction, to be made part by part.

    Columns: the moving ones among parameters, thrust gains, running clocks and times at which thrust switches
    (``moving`` (k,) of them, numbered in this order), and ``coefficients`` of the measured motion of the
    joints ``follow``. ``first`` (nodes,) is the first of them that acts at a node. The last ``switches`` of
    the k are the switches, each at the end of a segment.
    """

    parameters: Parameters
    drive: DrivenMotion
    prediction: Prediction
    thrust: np.ndarray | None
    clocks: np.ndarray | None
    follow: np.ndarray
    moving: np.ndarray
    first: np.ndarray
    switches: int = 0

    @property
    def rows(self) -> int:
        """Number of rows of x."""
        return POSE + len(self.prediction.rest_v) + len(self.drive.free)

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return len(self.prediction.q)

    @property
    def coefficients(self) -> int:
        """Number of coefficients of one joint's motion."""
        return int(self.first[-1]) + WINDOW if len(self.follow) else 0

    def part(self, nodes: slice) -> TransitionPart:
        """Return the transition maps along some nodes."""
        timeline = self.prediction.timeline
        steps = slice(*np.searchsorted(timeline.step_node, (nodes.start, nodes.stop - 1)).tolist())
        # what is interpolated to stages inside of the steps reaches a little further
        wide = slice(max(nodes.start - POINTS, 0), min(nodes.stop + POINTS, self.nodes))
        here = self.prediction
        here = replace(here, q=here.q[wide], v=here.v[wide], a=here.a[wide])
        linear = linearise(
            self.parameters,
            self.drive,
            here,
            None if self.thrust is None else self.thrust[wide],
            None if self.clocks is None else self.clocks[wide],
            self.follow,
            self.moving[: len(self.moving) - self.switches],
        )
        k, count = len(self.moving), steps.stop - steps.start
        still = k - self.switches  # what comes after it acts between segments only
        velocity = POSE + len(here.rest_v)
        h, width = timeline.h[steps], WINDOW * len(self.follow)
        first = self.first[timeline.step_node[steps]]
        rates = self._rates(here.v[:, :6], linear.by_state, steps, wide.start)
        phi, ends = transitions([rates[c] for c in C], h, velocity)  # drives act on velocities alone
        own, motion = (
            timeline.at_stages(x, steps, wide.start) for x in (linear.by_parameter, linear.by_motion)
        )
        drives = np.zeros((count, len(PLACES), len(self.drive.free), k + width))
        for i, c in enumerate(PLACES):
            drives[:, i, :, :still] = own[c]
            times = timeline.step_starts[steps] + c * h
            drives[:, i, :, k:] = self._following_accelerations(motion[c], times, first)
        gamma = ends.reshape(count, self.rows, -1) @ drives.reshape(count, -1, k + width)
        inner = slice(nodes.start - wide.start, nodes.stop - wide.start)
        times = timeline.evaluations[timeline.node_evaluation[nodes]]
        step = np.full(nodes.stop - nodes.start, -1)
        step[timeline.step_node[steps] - nodes.start] = np.arange(count)
        return TransitionPart(
            nodes,
            step,
            self.first[nodes],
            len(self.follow),
            phi,
            gamma[:, :, :k],
            gamma[:, :, k:],
            linear.by_state[inner],
            np.pad(linear.by_parameter[inner], ((0, 0), (0, 0), (0, self.switches))),
            self._following_accelerations(linear.by_motion[inner], times, self.first[nodes]),
            self._kicks(nodes),
        )

    def _kicks(self, nodes: slice) -> dict[int, tuple[int, np.ndarray]]:
        """Return, by place among some nodes, of each switch of thrust its column and what x (n,) changes by
        where it is a second later: accelerations just before it less those just after.

        Source: the jump of sensitivities where an input switches, Galan, Feehery and Barton, Appl. Numer.
        Math. 31 (1999) 17.
        """
        out, first = {}, len(self.moving) - self.switches
        ends = np.cumsum(self.prediction.timeline.counts + 1)[:-1] - 1
        for column, end in enumerate(ends[: self.switches].tolist(), start=first):
            if nodes.start <= end < nodes.stop:
                kick = np.zeros(self.rows)
                change = self.prediction.a[end] - self.prediction.a[end + 1]
                kick[self.rows - len(self.drive.free) :] = change[self.drive.free]
                out[end - nodes.start] = column, kick
        return out

    def start(self) -> np.ndarray:
        """Return the derivatives of x at the first node (n, 6 + k + WINDOW joints).

        By the initial pose, the moving columns, and the first coefficients.
        """
        nv, joints = self.prediction.model.nv, len(self.follow)
        moved = [np.zeros((nv, 2, 0)) if self.clocks is None else self.clocks[0, :, :2]]
        if joints:
            assert self.drive.joints is not None
            basis = self.drive.joints.basis(self.prediction.timeline.edges[:1], self.first[:1])[:2, 0]
            own = np.zeros((nv, 2, WINDOW, joints))
            own[self.follow, :, :, np.arange(joints)] = basis
            moved.append(own.reshape(nv, 2, -1))
        gains = 0 if self.thrust is None else self.thrust.shape[2]
        prescribed = np.concatenate(moved, axis=2)
        found = start_velocities(self.parameters, self.drive.free, self.prediction, gains, prescribed)
        still = len(self.moving) - self.switches
        out = np.zeros((self.rows, POSE + len(self.moving) + WINDOW * joints))
        out[:POSE, :POSE] = np.eye(POSE)
        rates, motion = slice(self.rows - len(found), None), found.shape[1] - WINDOW * joints
        out[rates, POSE : POSE + still] = found[:, self.moving[:still]]
        out[rates, POSE + len(self.moving) :] = found[:, motion:]
        return out

    def _rates(
        self, base_v: np.ndarray, by_state: np.ndarray, steps: slice, node: int
    ) -> dict[float, np.ndarray]:
        """Linear rates of x (steps, n, n) by place of the stage, from values at the nodes from one on."""
        timeline, free = self.prediction.timeline, self.drive.free
        n_rest, base = len(self.prediction.rest_v), [int(i) for i in free if i < 6]
        velocity, n = POSE + n_rest, self.rows
        stage_v, out = timeline.at_stages(base_v, steps, node), {}
        for c, own in timeline.at_stages(by_state, steps, node).items():
            rate = np.zeros((len(own), n, n))
            rate[:, :POSE, :POSE] = -small_adjoint(stage_v[c])
            rate[:, base, [velocity + k for k in range(len(base))]] = 1.0
            rate[:, POSE + np.arange(n_rest), velocity + len(base) + np.arange(n_rest)] = 1.0
            rate[:, velocity:] = own
            out[c] = rate
        return out

    def _following_accelerations(
        self, by_motion: np.ndarray, times: np.ndarray, first: np.ndarray
    ) -> np.ndarray:
        """Free accelerations (N, free, WINDOW joints) per coefficient, at times (N,) [s]."""
        if not len(self.follow):
            return np.zeros((*by_motion.shape[:2], 0))
        assert self.drive.joints is not None
        basis = np.moveaxis(self.drive.joints.basis(times, first), 0, -1)  # (N, WINDOW, 3)
        found = basis[:, None] @ by_motion
        return found.reshape(*by_motion.shape[:2], -1)


def variation(
    parameters: Parameters,
    drive: DrivenMotion,
    prediction: Prediction,
    thrust: np.ndarray | None,
    clocks: np.ndarray | None,
    *,
    motion: bool,
    switches: int = 0,
) -> VariationalEquations:
    """Return the variational equations of a prediction, with times of the first so many ``switches``.

    ``thrust`` (nodes, nv, 3): force per unit gain, by axis, when gains are sought. ``clocks`` (nodes, nv, 3,
    c): prescribed angle, rate and acceleration by offsets and drifts of the clocks they run by, when those
    are. ``motion``: with the coefficients of the measured joint motion.
    """
    timeline = prediction.timeline
    follow, first = np.zeros(0, dtype=int), np.zeros(len(prediction.q), dtype=int)
    if motion and drive.joints is not None:
        follow = parameters.layout.model.arm_joints.v
        first = drive.joints.windows(timeline.step_starts)[timeline.node_step]
    size = parameters.size + (0 if thrust is None else 3) + (0 if clocks is None else clocks.shape[3])
    every = np.arange(size)
    # at a motion of what moves that is no special one: what does nothing there does nothing anywhere
    numbers = np.arange(1.0, prediction.model.nv + 1.0)
    v, a = prediction.v.any(axis=0) * np.array([np.sin(numbers), np.cos(numbers)])
    q = pin.integrate(prediction.model, prediction.q[0], v)
    probe = replace(prediction, q=q[None], v=v[None], a=a[None])
    found = linearise(parameters, drive, probe, None, None, follow, every[: parameters.size])
    moves = np.ones(size, dtype=bool)
    moves[: parameters.size] = found.by_parameter.any(axis=(0, 1))
    moving = np.append(every[moves], size + np.arange(switches))
    return VariationalEquations(
        parameters, drive, prediction, thrust, clocks, follow, moving, first, switches
    )
