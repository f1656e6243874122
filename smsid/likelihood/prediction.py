"""Predicted motion: hybrid forward dynamics from rest on a fixed grid.

Equations (10)-(15) for what is free - bus, slosh, modes, any other unmeasured joint - with the rest
prescribed. Without gravity nothing depends on where the bus is and how it points, so its pose is integrated
afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from smsid.errors import SimulationError
from smsid.kernel.arrays import tree_of
from smsid.kernel.columns import DAMPING, STIFFNESS
from smsid.kernel.hybrid import hybrid_motion
from smsid.kernel.jit import available
from smsid.likelihood.inputs import Drive
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.runge_kutta import STAGES, A, B, transitions
from smsid.likelihood.time_grid import Timeline
from smsid.simulate.truth import rotation_matrices


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
    parameters: Parameters, drive: Drive, timeline: Timeline, position: np.ndarray, quaternion: np.ndarray
) -> Prediction:
    """Predict the motion from rest (held) or from zero momentum (free floating).

    ``position`` (3,) of the bus origin and ``quaternion`` (4,) at the start. Raises `SimulationError` when
    the motion is not finite.
    """
    spacecraft = parameters.layout.model
    model = parameters.pin_model()
    data = model.createData()
    times = timeline.evaluations
    q, v, a = drive.prescribed(spacecraft, times)
    free = drive.free
    rest_q, rest_v = rest_joints(model, free)
    applied = applied_forces(parameters, drive, timeline)[:, free]
    stiffness, damping, _, _ = parameters.springs()
    k, d = np.zeros((2, spacecraft.nv))
    k[spacecraft.spring_v], d[spacecraft.spring_v] = stiffness, damping
    k_rest, d_rest = k[rest_v], d[rest_v]
    base = len(free) - len(rest_v)

    if _only_translates(model, free):
        mass = symmetric(pin.crba(model, data, q[0]))[np.ix_(free, free)]
        _carried_linear(timeline, mass, applied, k_rest, d_rest, (q, v, a), (rest_q, free, base))
    else:
        start = np.zeros(len(rest_v) + len(free))
        start[len(rest_v) :] = start_velocity(model, data, q[0], v[0], free)
        tree = tree_of(model, spacecraft.free) if available() else None
        if tree is not None:
            tree.bodies[rest_v - 6, STIFFNESS], tree.bodies[rest_v - 6, DAMPING] = k_rest, d_rest
            given = (applied, (free, rest_q), timeline.counts, timeline.h, start, A, B)
            lost = hybrid_motion(*tree.arrays, (q, v, a), *given)
        else:
            places = (rest_q, free, base)
            lost = _carried(timeline, model, applied, (k_rest, d_rest), (q, v, a), places, start)
        if lost >= 0:
            raise SimulationError(
                f"The predicted motion is not finite at t = {times[lost]:.6g} s.",
                advice="The starting guess is too far off: start from the linear method.",
                time=times[lost],
            )
    positions, quaternions = _pose(timeline, v, position, quaternion)
    nodes = timeline.node_evaluation
    q, v, a = q[nodes], v[nodes], a[nodes]
    q[:, :3], q[:, 3:7] = positions, quaternions
    return Prediction(model, timeline, q, v, a, rest_q, rest_v)


def _only_translates(model: pin.Model, free: np.ndarray) -> bool:
    """Whether nothing that is free turns: then the mass matrix is constant and the motion linear."""
    if any(i in free for i in (3, 4, 5)):
        return False
    joints = [model.joints[j] for j in range(2, model.njoints)]
    moving = [j for j in joints if any(j.idx_v + k in free for k in range(j.nv))]
    return all("Prismatic" in j.shortname() or "Translation" in j.shortname() for j in moving)


def _carried(
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
            y = y + h[step] * (B @ slopes)
            step += 1
        if accelerate(timeline.steps * STAGES + segment, y) is None:
            return timeline.steps * STAGES + segment
    return -1


def _carried_linear(
    timeline: Timeline,
    mass: np.ndarray,
    applied: np.ndarray,
    stiffness: np.ndarray,
    damping: np.ndarray,
    motion: tuple[np.ndarray, np.ndarray, np.ndarray],
    places: tuple[np.ndarray, np.ndarray, int],
) -> None:
    """Fill in q, v, a of a motion from rest with constant mass matrix: the Runge-Kutta rule as one matrix."""
    q, v, a = motion
    rest_q, free, base = places
    n_rest, n_free = len(rest_q), len(free)
    inverse = np.linalg.inv(mass)
    rate = np.zeros((n_rest + n_free,) * 2)
    rate[:n_rest, n_rest + base :] = np.eye(n_rest)
    rate[n_rest:, :n_rest] = -inverse[:, base:] * stiffness
    rate[n_rest:, n_rest + base :] = -inverse[:, base:] * damping
    pushed = np.zeros((len(applied), n_rest + n_free))
    pushed[:, n_rest:] = applied @ inverse
    inner = timeline.steps * STAGES
    stages = pushed[:inner].reshape(timeline.steps, STAGES, -1)
    rates = [np.broadcast_to(rate, (timeline.steps, *rate.shape))] * STAGES
    phi, gamma, _ = transitions(rates, list(np.moveaxis(stages, 1, 0)[..., None]), timeline.h)
    assert gamma is not None
    at_steps, ends = np.empty((timeline.steps, len(rate))), []
    x, step = np.zeros(len(rate)), 0
    for count in timeline.counts:
        for _ in range(count):
            at_steps[step] = x
            x = phi[step] @ x + gamma[step, :, 0]
            step += 1
        ends.append(x)
    slopes = np.empty((STAGES, *at_steps.shape))
    states = np.empty((len(applied), len(rate)))
    for j in range(STAGES):
        y = at_steps + timeline.h[:, None] * np.tensordot(A[j, :j], slopes[:j], axes=1)
        slopes[j] = y @ rate.T + stages[:, j]
        states[j:inner:STAGES] = y
    states[inner:] = np.array(ends)
    q[:, rest_q], v[:, free] = states[:, :n_rest], states[:, n_rest:]
    a[:, free] = (states @ rate.T + pushed)[:, n_rest:]


def symmetric(upper: np.ndarray) -> np.ndarray:
    """Return the symmetric matrices (..., n, n) whose upper triangles are given."""
    return np.triu(upper) + np.swapaxes(np.triu(upper, 1), -1, -2)


def applied_forces(parameters: Parameters, drive: Drive, timeline: Timeline) -> np.ndarray:
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
    rate = np.zeros((steps, STAGES, 4, 4))
    a, b, c = 0.5 * np.moveaxis(stage_v[..., 3:], -1, 0)
    # q_dot = q o (0, omega) / 2, x y z w
    rows = ((0, c, -b, a), (-c, 0, a, b), (b, -a, 0, c), (-a, -b, -c, 0))
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            rate[..., i, j] = value
    h = timeline.h
    phi, _, stages = transitions(list(np.moveaxis(rate, 1, 0)), None, h, stages=True)
    assert stages is not None
    at_steps = np.empty((steps, 4))
    now = np.asarray(quaternion, dtype=float) / np.linalg.norm(quaternion)
    nodes, places = [], []
    step = 0
    for count in timeline.counts:
        for _ in range(count):
            at_steps[step] = now
            nodes.append(now)
            now = phi[step] @ now
            now = now / np.linalg.norm(now)
            step += 1
        nodes.append(now)
    quaternions = np.array(nodes)
    turned = np.einsum("sjab,sb->sja", stages, at_steps)
    turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
    inertial = np.einsum("sjab,sjb->sja", rotation_matrices(turned), stage_v[..., :3])
    change = h[:, None] * np.einsum("j,sja->sa", B, inertial)
    now, step = np.asarray(position, dtype=float), 0
    for count in timeline.counts:
        block = np.vstack([now, now + np.cumsum(change[step : step + count], axis=0)])
        places.append(block)
        now, step = block[-1], step + count
    return np.vstack(places), quaternions
