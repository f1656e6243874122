"""Extended Kalman filter on the model: whitened innovations, and all that is needed to differentiate them."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.linalg import block_diag

from smsid.estimation.bias_walk import BiasWalks
from smsid.estimation.compiled_filter import compiled_model
from smsid.estimation.filter_pass import AppliedForces, Instance, filter_samples
from smsid.estimation.filter_run import FilterRun, joined_runs, log_determinants, log_likelihoods
from smsid.estimation.initial_state import InitialPrior
from smsid.estimation.input_hold import (
    COMMANDS,
    VARYING,
    limits,
    means,
    starts_with_jump,
    unevenness,
    unrecorded,
)
from smsid.estimation.problem import (
    Belief,
    MovingStart,
    Problem,
    recordings_of,
    unknown_forces,
    unknown_sigmas,
)
from smsid.estimation.process_model import ProcessModel, inverse_inertias
from smsid.inputs.signals import Signal
from smsid.kernel.filter_arrays import Samples, State
from smsid.model.spacecraft import SpacecraftModel, set_group_angles
from smsid.simulate import Inputs
from smsid.simulate.trajectory import States

UNTOLD = 1e-3  # of the largest force, by which one that may have jumped has to differ to be unknown
AT_ONCE = ("acceleration", "joint_position")  # what depends on the forces of the moment; encoders by a gear


def driving_forces(model: SpacecraftModel, inputs: Inputs) -> Signal:
    """Return the applied generalised force over time (nv,): made once, as it is of the whole recording."""
    return inputs.driven(model).applied(model)


def applied_forces(
    plant: ProcessModel, problem: Problem, signal: Signal, times: np.ndarray | None = None
) -> AppliedForces:
    """Return the applied generalised forces on the clock of the samples, or of some ``times`` (n,) of it.

    ``signal`` is as `driving_forces` makes it.
    """
    whole = problem.data.times
    times = whole if times is None else times
    n = max(1, int(np.ceil(float(np.median(np.diff(whole))) / problem.substep - 1e-9)))
    n += n % 2  # the middle of a sample interval is an end of a step
    parts = np.linspace(0.0, 1.0, n + 1)[:-1]
    edges = np.append((times[:-1, None] + np.diff(times)[:, None] * parts).ravel(), times[-1])
    shape = (len(times) - 1, n, plant.nv)
    mean = means(signal, edges).reshape(shape)
    rise = -6.0 * unevenness(signal, edges) / np.diff(edges)[:, None] ** 2
    return AppliedForces(
        mean, mean.mean(axis=1), limits(signal, times, problem.timing.side), rise.reshape(shape)
    )


def run_filter(model: SpacecraftModel, problem: Problem, *, until: float = np.inf) -> FilterRun:
    """Run the filter over a recording; after ``until`` [s] nothing is corrected any more: open loop.

    Only states, predictions and errors are there then, derivatives are zero.

    Raises `SimulationError` when the state or its covariance is no longer finite.
    """
    if problem.parts:
        own = [part.model or model for part in problem.parts]
        each = zip(own, recordings_of(problem), strict=True)
        return joined_runs([run_filter(m, p, until=until) for m, p in each])
    return KalmanFilter(model, problem, until=until).advance(len(problem.data.times))


class KalmanFilter:
    """The extended Kalman filter over a recording, some samples at a time.

    ``q`` (nq,), ``v`` (nv,), the ``unknown`` inputs (k,), the ``values`` of biases that wander (m,) and
    ``covariance`` (x, x), x = 2 nv + k + m, are what is believed of the state at the next sample before it is
    read. ``input_noise`` (nv,) is the variance of inputs held over a sample, ``forces`` what unknown inputs
    act on and how they wander. Not to be shared between threads.
    """

    def __init__(self, model: SpacecraftModel, problem: Problem, *, until: float = np.inf) -> None:
        self.model, self.problem, self.until = model, problem, until
        self.base = Instance.of(model, problem.data, problem.locked)
        self.walks = BiasWalks(problem.bias_walks, problem.data.rows) if problem.bias_walks else None
        self.compiled_tables = compiled_model(self.base)
        if self.compiled_tables is not None and self.walks is not None:
            own = self.walks.compiled_tables(self.compiled_tables.parameters)
            self.compiled_tables = self.compiled_tables._replace(parameters=own)
        self.driving = driving_forces(model, problem.inputs(model))
        self._sudden = _sudden_forces(model, problem)
        self.input_noise = input_covariance(model, problem)
        self.forces = unknown_forces(problem.unknown_inputs, problem.timing)
        self._readable = _readable(problem)
        if self._sudden is not None:  # what acts while a command may have jumped or not is not known
            later = [limits(x, problem.data.times, "right") for x in (self.driving, self._sudden)]
            unknown = np.abs(later[0] - later[1]).max(axis=1) > UNTOLD * np.abs(later[0]).max(initial=0.0)
            for block in problem.data.blocks:
                if block.quantity in AT_ONCE:
                    self._readable[unknown, block.rows] = False
        self.given = problem.given
        self.order = np.argsort(~self.given, kind="stable")
        names = [b.channel for b in problem.data.blocks if b.quantity == "attitude"]
        seen = [problem.data.attitude[name] for name in names]
        self._attitudes = np.stack(seen, axis=1) if seen else np.zeros((len(problem.data.times), 0, 4))
        self._applied: tuple[np.ndarray, AppliedForces] | None = None
        first = problem.begin or Belief(*first_state(model, problem), _first_covariance(model, problem))
        self._begin(first)

    def _begin(self, belief: Belief) -> None:
        start = np.diag(unknown_sigmas(self.problem.unknown_inputs) ** 2)
        wandered = np.diag(np.zeros(0) if self.walks is None else self.walks.begin)
        self.q, self.v = belief.q.copy(), belief.v.copy()
        self.unknown, self.values = np.zeros(len(start)), np.zeros(len(wandered))
        self.covariance: np.ndarray = np.asarray(block_diag(belief.covariance, start, wandered))
        self._next, self._before = 0, None

    def jumps(self, edges: np.ndarray) -> np.ndarray | None:
        """Return by how much mean forces between edges (N,) may err, one standard deviation (N - 1, nv) of
        all at once: by what was commanded before the recording and is late, or as commands jump at an unknown
        time in some of these intervals; ``None`` where there are none.

        A switch anywhere in an interval has the mean of a slow one, of half the force of a late one. Its time
        is uniform, so that its mean errs by the force's twelfth's root; where commands are sampled more
        slowly, that is shared out over m intervals, as if these were independent.
        """
        if len(edges) < 2:
            return None
        before = unrecorded(self.driving, edges)
        if self._sudden is None:
            return before
        missed = means(self.driving, edges) - means(self._sudden, edges)
        recording = self.problem.recording
        clocks = [recording.time(c) for c in COMMANDS.values() if c in recording]
        slow = min((float(np.median(np.diff(t))) for t in clocks), default=0.0)
        m = max(1.0, round(slow / float(np.median(np.diff(self.problem.data.times)))))
        missed *= np.sqrt(m**3 / (4.0 * m**2 - 1.0))
        return missed if before is None else np.where(before.any(axis=1, keepdims=True), before, missed)

    def restarted(self, belief: Belief, *, until: float) -> KalmanFilter:
        """Return it at the first sample again, with another belief of the state there: what does not depend
        on that, the forces applied above all, is not made again.
        """
        other = copy(self)
        other.until = until
        other._begin(belief)
        return other

    def advance(self, samples: int) -> FilterRun:
        """Read the next samples and return what was made of them.

        The run has a transition to the sample after them, if there is one.

        Raises `SimulationError` when the state or its covariance is no longer finite.
        """
        data, first = self.problem.data, self._next
        n = min(samples, len(data.times) - first)
        edges = np.array(data.times[first : first + n + 1], dtype=float)
        if self._applied is None or not np.array_equal(self._applied[0], edges):
            applied = applied_forces(self.base.plant, self.problem, self.driving, edges)
            self._applied = edges, replace(applied, jumps=self.jumps(edges))
        forces = replace(self._applied[1], before=self._before)
        times, present = edges[:n], self._readable[first : first + n]
        corrections = int(np.searchsorted(times, self.until, side="right"))
        own = Samples(
            edges,
            np.array(data.values[first : first + n], dtype=float),
            np.array(self._attitudes[first : first + n], dtype=float),
            present,
            data.sigma**2,
            corrections,
            self.order,
        )
        # what was handed out before stays as it was
        state = State(
            self.q.copy(), self.v.copy(), self.unknown.copy(), self.values.copy(), self.covariance.copy()
        )
        drive = forces.drive(self.forces, self.input_noise)
        how = self.base, self.walks, self.compiled_tables, drive, state, own
        found = filter_samples(*how, shift=self.problem.shift)
        self.q, self.v, self.unknown, self.values, self.covariance = state
        self._next, self._before = first + n, forces.last
        (q, v, a, tau, inverse), (mid_q, mid_v, mid_a, mid_tau, mid_inverse) = found.at, found.middle
        middle_times = 0.5 * (edges[1:] + edges[:-1])
        likely = log_likelihoods(found.innovations, found.whitening, self.given)
        return FilterRun(
            found.innovations, float(likely.sum()), found.whitening, found.gain,
            found.sensitivity, found.by_a, found.transition, found.forcing,
            States(times, q, v, a, tau, np.zeros_like(tau)),
            States(middle_times, mid_q, mid_v, mid_a, mid_tau, np.zeros_like(mid_tau)),
            inverse, mid_inverse, found.predicted, found.errors, found.normalised,
            present & (times <= self.until)[:, None], edges, self.given,
            volume=float(log_determinants(found.whitening, self.given).sum()),
        )  # fmt: skip


def _sudden_forces(model: SpacecraftModel, problem: Problem) -> Signal | None:
    """Return what would act if all that jumps at an unknown time did so at the samples, the latest it may."""
    if not problem.timing.anywhere:
        return None
    late = replace(problem, timing=replace(problem.timing, anywhere=False))
    return driving_forces(model, late.inputs(model))


def _readable(problem: Problem) -> np.ndarray:
    """Return which readings count (N, rows): those that are there.

    Of the first sample none that shows at once what acts, where that is a command from before the recording.
    """
    present, timing = np.isfinite(problem.data.values), problem.timing
    if timing.hold not in VARYING and timing.side == "left" and starts_with_jump(problem.recording):
        for block in problem.data.blocks:
            if block.quantity in AT_ONCE:
                present[0, block.rows] = False
    return present


def first_state(model: SpacecraftModel, problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return a first q (nq,) and v (nv,) from the first samples: what is measured, the rest at rest or as the
    problem says that it moves.
    """
    q, v = with_moves(problem.moves, model, model.home, np.zeros(model.nv))
    data, pose = problem.data, None
    for block in data.blocks:
        first = data.values[0, block.rows]
        if block.quantity == "acceleration" or not np.isfinite(first).all():
            continue
        first = np.linalg.solve(block.gain, first - block.bias)
        if block.quantity == "joint_position":
            q = set_group_angles(model.arm_joints, q, first)
        elif block.quantity == "joint_velocity":
            v[model.arm_joints.v] = first
        elif block.quantity == "wheel_rate":
            v[model.wheels.v] = first
        elif block.quantity == "angular_rate" and model.free:
            v[3:6] = first
        elif block.quantity == "attitude" and model.free:
            q[3:7] = data.attitude[block.channel][0]
        elif block.quantity == "position" and model.free:
            pose = (first, np.asarray(block.sensor.position))
    if pose is not None:
        q[:3] = pose[0] - pin.Quaternion(q[3:7]).matrix() @ pose[1]
    v[problem.locked] = 0.0
    return pin.normalize(model.pin, q), v


def with_moves(
    moves: Sequence[MovingStart], model: SpacecraftModel, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return q (nq,) and v (nv,) with hidden coordinates where they begin, of joints that the model has."""
    q, v = q.copy(), v.copy()
    for move in moves:
        if model.pin.existJointName(move.joint):
            own = model.pin.joints[model.pin.getJointId(move.joint)]
            q[own.idx_q : own.idx_q + own.nq], v[own.idx_v : own.idx_v + own.nv] = move.at, move.rate
    return q, v


def hidden_coordinates(model: SpacecraftModel) -> np.ndarray:
    """Return the indices in v (k,) of slosh, modes and whatever else effects add."""
    known = (np.arange(6 if model.free else 0), model.arm_joints.v, model.wheels.v)
    return np.setdiff1d(np.arange(model.nv), np.concatenate(known))


def _first_covariance(model: SpacecraftModel, problem: Problem) -> np.ndarray:
    nv = model.nv
    sigma = np.ones(2 * nv)
    if model.free:
        sigma[0:3], sigma[3:6], sigma[nv : nv + 3], sigma[nv + 3 : nv + 6] = 0.1, 0.01, 0.05, 0.005
    sigma[model.arm_joints.v], sigma[nv + model.arm_joints.v] = 0.01, 0.01
    sigma[model.wheels.v], sigma[nv + model.wheels.v] = 1e-3, 1.0
    wide, bus = InitialPrior(), slice(nv + 3, nv + 6 if model.free else nv + 3)
    rates = {"angular_rate": (bus, wide.rate), "joint_velocity": (nv + model.arm_joints.v, wide.joint_rate),
             "wheel_rate": (nv + model.wheels.v, wide.wheel_rate)}  # fmt: skip
    for b in problem.data.blocks:
        if b.quantity in rates and not np.isfinite(problem.data.values[0, b.rows]).all():
            sigma[rates[b.quantity][0]] = rates[b.quantity][1]  # at rest for want of a reading
    index = hidden_coordinates(model)
    sigma[index], sigma[nv + index] = problem.noise.hidden
    for move in problem.moves:
        if move.sigmas and model.pin.existJointName(move.joint):
            own = model.pin.joints[model.pin.getJointId(move.joint)]
            sigma.reshape(2, nv)[:, own.idx_v : own.idx_v + own.nv] = np.reshape(move.sigmas, (2, own.nv))
    sigma[problem.locked], sigma[nv + problem.locked] = 1e-3, 1e-9
    return np.diag(sigma**2)


def input_covariance(model: SpacecraftModel, problem: Problem) -> np.ndarray:
    """Return the variance (nv,) of inputs that are held over a sample, in generalised forces."""
    noise, out = problem.noise, np.zeros(model.nv)
    if model.free:
        out[0:3], out[3:6] = noise.force, noise.torque
    out[model.arm_joints.v], out[model.wheels.v] = noise.joint, noise.wheel
    out[problem.locked] = 0.0
    out = out**2
    for dof, sigma in (*noise.more, *noise.shapes):
        out[dof] += sigma**2
    if noise.accelerations:
        moved = inverse_inertias(model, problem.locked)
        for dof, sigma in noise.accelerations:
            out[dof] += (sigma / moved[dof]) ** 2
    return out
