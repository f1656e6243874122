"""Predicted motion: hybrid forward dynamics from rest on a fixed grid.

Equations (10)-(15) for what is free - bus, slosh, modes, any other unmeasured joint - with the rest
prescribed. Without gravity nothing depends on where the bus is and how it points, so its pose is integrated
afterwards.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from smsid._time_text import time_text
from smsid.errors import SimulationError
from smsid.kernel.arrays import tree_of
from smsid.kernel.columns import DAMPING, STIFFNESS
from smsid.kernel.hybrid import hybrid_motion
from smsid.kernel.jit import available
from smsid.likelihood.inputs import DrivenMotion
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.time_grid import STAGES, A, B, Timeline, stage_values, transitions
from smsid.simulate.truth import rotation_matrices

PART = 4096  # steps predicted at a time: what is between their ends is forgotten


@dataclass(frozen=True)
class Prediction:
    """A motion at the nodes of a timeline.

    ``q`` (nodes, nq), ``v``, ``a`` (nodes, nv), in the model's order: base position [m, inertial] and
    attitude from the given start. ``rest_q``, ``rest_v``: where free joints other than the base are.
    ``model`` carries the inertias used.
    """

    model: pin.Model
    timeline: Timeline
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    rest_q: np.ndarray
    rest_v: np.ndarray

    @cached_property
    def coarse(self) -> Prediction:
        """The same motion at every other node, for derivatives."""
        kept = self.timeline.kept
        return replace(self, timeline=self.timeline.coarse, q=self.q[kept], v=self.v[kept], a=self.a[kept])


def rest_joints(model: pin.Model, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where free joints other than the base are in q and v: indices (k,), (k,)."""
    v = np.array([i for i in free if i >= 6], dtype=int)
    place = {
        model.joints[j].idx_v + k: model.joints[j].idx_q + k
        for j in range(2, model.njoints)
        for k in range(model.joints[j].nv)
    }
    return np.array([place[int(i)] for i in v], dtype=int), v


def predict(
    parameters: Parameters,
    drive: DrivenMotion,
    timeline: Timeline,
    position: np.ndarray,
    quaternion: np.ndarray,
    later: np.ndarray | None = None,
) -> Prediction:
    """Predict the motion from rest (held) or from zero momentum (free floating).

    ``position`` (3,) of the bus origin and ``quaternion`` (4,) at the start. By ``later`` (segments - 1,) [s]
    thrust switches later than the segments end, as far as that changes rates. Raises `SimulationError` when
    the motion is not finite.
    """
    spacecraft = parameters.layout.model
    model = parameters.pin_model()
    free = drive.free
    rest_q, rest_v = rest_joints(model, free)
    stiffness, damping, _, _ = parameters.springs()
    k, d = np.zeros((2, spacecraft.nv))
    k[spacecraft.spring_v], d[spacecraft.spring_v] = stiffness, damping
    k_rest, d_rest = k[rest_v], d[rest_v]
    base = len(free) - len(rest_v)

    q, v, _ = drive.prescribed(spacecraft, timeline.edges[:1])
    y = np.zeros(len(rest_v) + len(free))
    y[len(rest_v) :] = start_velocity(model, model.createData(), q[0], v[0], free)
    tree = tree_of(model, spacecraft.free) if available() else None
    if tree is not None:
        tree.bodies[rest_v - 6, STIFFNESS], tree.bodies[rest_v - 6, DAMPING] = k_rest, d_rest
    found, segment = [], 0
    switched = later is not None and bool(later.any())
    for part, ends in timeline.parts(PART, whole=switched):
        q, v, a = drive.prescribed(spacecraft, part.evaluations)
        applied = applied_forces(parameters, drive, part)[:, free]
        if tree is not None:
            given = (applied, (free, rest_q), part.counts, part.h, y, A, B)
            lost = hybrid_motion(*tree.arrays, (q, v, a), *given)
        else:
            places = (rest_q, free, base)
            lost = _carry_motion(part, model, applied, (k_rest, d_rest), (q, v, a), places, y)
        if lost >= 0:
            time = part.evaluations[lost]
            raise SimulationError(
                f"The predicted motion is not finite at t = {time_text(time)}.",
                advice="The starting guess is too far off: start from the linear method.",
                time=time,
            )
        positions, quaternions = _pose(part, v, position, quaternion)
        position, quaternion = positions[-1], quaternions[-1]
        nodes = part.node_evaluation if ends else part.node_evaluation[:-1]
        q, v, a = q[nodes], v[nodes], a[nodes]
        q[:, :3], q[:, 3:7] = positions[: len(nodes)], quaternions[: len(nodes)]
        found.append((q, v, a))
        if switched and ends:
            segment += 1
            if segment < len(timeline.counts):
                turned = _thrust_change(parameters, drive, timeline, segment, model, q[-1])
                y[len(rest_v) :] += float(later[segment - 1]) * turned[free]  # type: ignore[index]
    q, v, a = (np.concatenate(x) for x in zip(*found, strict=True))
    return Prediction(model, timeline, q, v, a, rest_q, rest_v)


def _carry_motion(
    timeline: Timeline,
    model: pin.Model,
    applied: np.ndarray,
    springs: tuple[np.ndarray, np.ndarray],
    motion: tuple[np.ndarray, np.ndarray, np.ndarray],
    places: tuple[np.ndarray, np.ndarray, int],
    y: np.ndarray,
) -> int:
    """Do what `hybrid_motion` does, without compiled code: its reference, and for joints it does not know."""
    q, v, a = motion
    rest_q, free, base = places
    n_rest, data, (k, d) = len(rest_q), model.createData(), springs
    flat = (free[:, None] * model.nv + free).ravel()

    def accelerate(e: int, y: np.ndarray) -> np.ndarray | None:
        q_e, v_e, a_e = q[e], v[e], a[e]
        q_e[rest_q] = y[:n_rest]
        v_e[free] = y[n_rest:]
        rhs = applied[e] - pin.rnea(model, data, q_e, v_e, a_e)[free]
        rhs[base:] -= k * y[:n_rest] + d * y[n_rest + base :]
        mass = pin.crba(model, data, q_e).ravel()[flat].reshape(len(free), len(free))
        _, x, info = lapack.dposv(mass, rhs)
        if info != 0 or not np.isfinite(x).all():
            return None
        a_e[free] = x
        return np.concatenate([y[n_rest + base :], x])

    slopes = np.empty((STAGES, len(y)))
    h, e, step = timeline.h, 0, 0
    for segment, count in enumerate(timeline.counts):
        for _ in range(count):
            for j in range(STAGES):
                slope = accelerate(e, y if j == 0 else y + h[step] * (A[j, :j] @ slopes[:j]))
                if slope is None:
                    return e
                slopes[j] = slope
                e += 1
            y += h[step] * (B @ slopes)
            step += 1
        if accelerate(timeline.steps * STAGES + segment, y) is None:
            return timeline.steps * STAGES + segment
    return -1


def _thrust_change(
    parameters: Parameters,
    drive: DrivenMotion,
    timeline: Timeline,
    segment: int,
    model: pin.Model,
    q: np.ndarray,
) -> np.ndarray:
    """Return accelerations (nv,), of what is free, just before a segment less those after, at q (nq,)."""
    ends = timeline.edges[segment - 1 : segment + 2]
    force = applied_forces(parameters, drive, Timeline(ends, np.array([1, 1])))
    before, after = force[-2], force[STAGES]
    mass = symmetric(pin.crba(model, model.createData(), q))
    out = np.zeros(model.nv)
    out[drive.free] = np.linalg.solve(mass[np.ix_(drive.free, drive.free)], (before - after)[drive.free])
    return out


def symmetric(upper: np.ndarray) -> np.ndarray:
    """Return the symmetric matrices (..., n, n) whose upper triangles are given."""
    return np.triu(upper) + np.swapaxes(np.triu(upper, 1), -1, -2)


def applied_forces(parameters: Parameters, drive: DrivenMotion, timeline: Timeline) -> np.ndarray:
    """Return generalised forces (E, nv) of thrust at every evaluation."""
    model = parameters.layout.model
    out = np.zeros((len(timeline.evaluations), model.nv))
    if drive.thrust is None:
        return out
    edges = timeline.edges
    middle = (0.5 * (edges[1:] + edges[:-1]))[timeline.evaluation_segment]
    wrench = drive.thrust.at(timeline.evaluations, middle)
    out[:, :3] = wrench[:, :3]
    out[:, 3:6] = wrench[:, 3:] + np.cross(model.thrust_point, wrench[:, :3])
    return out


def start_velocity(
    model: pin.Model, data: pin.Data, q: np.ndarray, v: np.ndarray, free: np.ndarray
) -> np.ndarray:
    """Return the free velocities (k,) at which all free momenta vanish while the rest moves with v.

    At configuration q (nq,), ``free`` (k,) indices in v.
    """
    start = v.copy()
    start[free] = 0.0
    if not start.any():
        return np.zeros(len(free))
    mass = symmetric(pin.crba(model, data, q))
    return -np.linalg.solve(mass[np.ix_(free, free)], mass[free] @ start)


def _pose(
    timeline: Timeline, v: np.ndarray, position: np.ndarray, quaternion: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Position and quaternion of the bus at the nodes from its velocity at the evaluations."""
    steps = timeline.steps
    stage_v = v[: steps * STAGES, :6].reshape(steps, STAGES, 6)
    a, b, c = 0.5 * np.moveaxis(stage_v[..., 3:], -1, 0)
    zero = np.zeros_like(a)
    # q_dot = q o (0, omega) / 2, x y z w
    rows = ((zero, c, -b, a), (-c, zero, a, b), (b, -a, zero, c), (-a, -b, -c, zero))
    h, rate = timeline.h, list(np.moveaxis(np.array(rows), (0, 1, 3), (2, 3, 0)))
    phi, _ = transitions(rate, h)
    now, nodes = np.asarray(quaternion, dtype=float), []
    places, first = [], np.concatenate([[0], np.cumsum(timeline.counts)])
    for begin, stop in itertools.pairwise(first):
        for turn in phi[begin:stop]:
            nodes.append(now)
            now = turn @ now
        nodes.append(now)
    # the maps are linear: what they do to the norm can be taken out at the end
    quaternions = np.array(nodes)
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    turned = stage_values(rate, quaternions[timeline.step_node], h)
    turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
    inertial = np.einsum("jsab,sjb->jsa", rotation_matrices(turned), stage_v[..., :3])
    change = h[:, None] * np.einsum("j,jsa->sa", B, inertial)
    now, step = np.asarray(position, dtype=float), 0
    for count in timeline.counts:
        block = np.vstack([now, now + np.cumsum(change[step : step + count], axis=0)])
        places.append(block)
        now, step = block[-1], step + count
    return np.vstack(places), quaternions
