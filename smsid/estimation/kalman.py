"""Extended Kalman filter on the model: whitened innovations, and all that is needed to differentiate them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.linalg import block_diag, lapack

from smsid.errors import SimulationError
from smsid.estimation.filter_run import FilterRun, joined_runs
from smsid.estimation.input_hold import VARYING, jumps_in, limits, means, unevenness
from smsid.estimation.measurement_model import MeasurementModel
from smsid.estimation.problem import (
    Problem,
    recordings_of,
)
from smsid.estimation.process_model import ProcessModel
from smsid.model.spacecraft import SpacecraftModel, set_group_angles
from smsid.simulate import Inputs
from smsid.simulate.trajectory import States

WILD = 1e9  # [m/s, rad/s] rate beyond which a prediction is lost
AT_ONCE = ("acceleration", "joint_position")  # what depends on the forces of the moment; encoders by a gear


@dataclass(frozen=True)
class Applied:
    """Applied generalised forces: means over the substeps (N - 1, substeps, nv), means over the intervals
    between samples (N - 1, nv), and values at the samples (N, nv). ``rise`` (N - 1, substeps, nv) is by how
    much the line of equal mean and equal first moment rises over half a substep. ``before`` (nv,) are the
    forces just before the first sample, where that is not the first of all.
    """

    means: np.ndarray
    middle: np.ndarray
    at: np.ndarray
    rise: np.ndarray
    before: np.ndarray | None = None

    def about(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the forces (nv,) just before and just after sample k."""
        before = self.means[k - 1, -1] + self.rise[k - 1, -1] if k > 0 else self.before
        before = self.at[0] if before is None else before
        after = self.means[k, 0] - self.rise[k, 0] if k < len(self.means) else self.at[k]
        return before, after


def applied(
    plant: ProcessModel, problem: Problem, inputs: Inputs, times: np.ndarray | None = None
) -> Applied:
    """Return the applied generalised forces on the clock of the samples, or of some ``times`` (n,) of it."""
    whole = problem.data.times
    times = whole if times is None else times
    signal = inputs.driven(plant.model).applied(plant.model)
    n = max(1, int(np.ceil(float(np.median(np.diff(whole))) / problem.substep - 1e-9)))
    n += n % 2  # the middle of a sample interval is an end of a step
    parts = np.linspace(0.0, 1.0, n + 1)[:-1]
    edges = np.append((times[:-1, None] + np.diff(times)[:, None] * parts).ravel(), times[-1])
    shape = (len(times) - 1, n, plant.nv)
    mean = means(signal, edges).reshape(shape)
    rise = -6.0 * unevenness(signal, edges) / np.diff(edges)[:, None] ** 2
    return Applied(mean, mean.mean(axis=1), limits(signal, times, problem.timing.side), rise.reshape(shape))


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

    ``q`` (nq,), ``v`` (nv,), the ``unknown`` inputs (k,) and ``covariance`` (2 nv + k, 2 nv + k) are what is
    believed of the state at the next sample before it is read. ``input_noise`` (nv,) is the variance of
    inputs held over a sample, ``walk`` (k,) that of the unknown inputs per second. Not to be shared between
    threads.
    """

    def __init__(self, model: SpacecraftModel, problem: Problem, *, until: float = np.inf) -> None:
        self.model, self.problem, self.until = model, problem, until
        self.plant = ProcessModel(model, problem.locked)
        self.outputs = MeasurementModel(model, problem.data, problem.locked)
        self.inputs = problem.inputs(model)
        begin = problem.begin
        if begin is None:
            self.q, self.v = first_state(model, problem)
            self.covariance = _first_covariance(model, problem)
        else:
            self.q, self.v, self.covariance = begin.q.copy(), begin.v.copy(), begin.covariance.copy()
        self.input_noise = _input_covariance(model, problem)
        unknown = problem.unknown_inputs
        self.unknown = np.zeros(len(unknown))
        self._unknown_at = np.array([u.dof for u in unknown], dtype=int)
        self.walk = np.array([u.walk**2 for u in unknown])
        start = np.diag([u.sigma**2 for u in unknown])
        self.covariance: np.ndarray = np.asarray(block_diag(self.covariance, start))
        self._late = np.array([b.delay for b in problem.data.blocks])
        self._readable = _readable(problem)
        self._next, self._before = 0, None

    @np.errstate(over="ignore", invalid="ignore")  # a filter that is lost is told by its values
    def advance(self, samples: int) -> FilterRun:
        """Read the next samples and return what was made of them.

        The run has a transition to the sample after them, if there is one.

        Raises `SimulationError` when the state or its covariance is no longer finite.
        """
        model, data, plant, outputs = self.model, self.problem.data, self.plant, self.outputs
        first = self._next
        n = min(samples, len(data.times) - first)
        edges = data.times[first : first + n + 1]
        times, nv, rows = edges[:n], model.nv, data.rows
        drive = replace(applied(plant, self.problem, self.inputs, edges), before=self._before)
        moves = len(edges) - 1
        present, late, input_noise = self._readable[first : first + n], self._late, self.input_noise
        q, v, p, w = self.q, self.v, self.covariance, self.unknown
        acts, width = self._unknown_at, 2 * nv + len(w)
        driving = np.zeros(nv)

        e, used = np.zeros((n, rows)), present & (times <= self.until)[:, None]
        whitening, gain = np.zeros((n, rows, rows)), np.zeros((n, width, rows))
        sensitivity, by_a = np.zeros((n, rows, width)), np.zeros((n, rows, nv))
        transition, forcing = np.zeros((moves, width, width)), np.zeros((moves, width, nv))
        at, mid = _Store(n, model), _Store(moves, model)
        predicted, normalised, errors = np.zeros((3, n, rows))
        variance = data.sigma**2
        log_likelihood = 0.0
        for k in range(n):
            corrects = times[k] <= self.until
            driving[acts] = w
            tau = drive.at[k] + driving
            lin = (plant.linear if corrects else plant.moving)(times[k], q, v, tau)
            at.put(k, q, v, lin.a, tau, lin.by_tau)
            if late.any():
                before, after = drive.about(k)
                forces = before + driving, after + driving
                h, cq, cv, ca = _delayed(outputs, late, times[k], (q, v), lin.a, forces, plant)
            else:
                h, cq, cv, ca = outputs.predict(q, v, lin.a)
            outputs.twisted(h, times[k], q, v, tau, lin.a)
            predicted[k] = h
            rotation = pin.Quaternion(q[3:7]).matrix() if model.free else None
            residual = data.residual(first + k, h, rotation)
            by_a[k], errors[k] = ca, residual
            there = np.flatnonzero(present[k]) if corrects else ()
            if corrects:
                big_h = sensitivity[k]
                np.matmul(ca, lin.by_q, out=big_h[:, :nv])
                np.matmul(ca, lin.by_v, out=big_h[:, nv : 2 * nv])
                big_h[:, :nv] += cq
                big_h[:, nv : 2 * nv] += cv
                if len(acts):
                    big_h[:, 2 * nv :] = ca @ lin.by_tau[:, acts]
            if len(there):
                hk = big_h[there]
                ph = p @ hk.T
                s = hk @ ph
                s.flat[:: len(there) + 1] += variance[there]
                normalised[k, there] = residual[there] / np.sqrt(s.diagonal())
                low, info = lapack.dpotrf(s, lower=1, clean=1)
                if info != 0 or not np.isfinite(residual[there]).all():
                    raise _lost(times[k])
                inverse, _ = lapack.dtrtri(low, lower=1)
                root = ph @ inverse.T
                white = inverse @ residual[there]
                e[k, there] = white
                log_likelihood -= 0.5 * float(white @ white) + float(np.log(low.diagonal()).sum())
                if len(there) == rows:
                    whitening[k], gain[k] = inverse, root @ inverse
                else:
                    whitening[k][np.ix_(there, there)] = inverse
                    gain[k][:, there] = root @ inverse
                p = p - root @ root.T
                dx = root @ white
                q, v, w = pin.integrate(plant.pin, q, dx[:nv]), v + dx[nv : 2 * nv], w + dx[2 * nv :]
            if k == moves:
                break
            h_k = float(edges[k + 1] - edges[k])
            substeps = drive.means.shape[1]
            driving[acts] = w
            for s_ in range(substeps):
                if s_ == substeps // 2:
                    tau = drive.middle[k] + driving
                    mid_lin = (plant.linear if corrects else plant.moving)(times[k] + 0.5 * h_k, q, v, tau)
                    mid.put(k, q, v, mid_lin.a, tau, mid_lin.by_tau)
                    if corrects:
                        f, psi = plant.transition(h_k, v, mid_lin)
                        transition[k, : 2 * nv, : 2 * nv], forcing[k, : 2 * nv] = f, psi[:, nv:]
                        if len(acts):
                            transition[k, : 2 * nv, 2 * nv :] = psi[:, nv:] @ mid_lin.by_tau[:, acts]
                            transition[k, 2 * nv :, 2 * nv :] = np.eye(len(acts))
                tau, rise = drive.means[k, s_] + driving, drive.rise[k, s_]
                q, v = plant.step(times[k] + s_ * h_k / substeps, h_k / substeps, q, v, tau, rise)
            if not np.abs(v).max() < WILD:
                raise _lost(times[k])
            if not corrects:
                continue
            b = forcing[k] @ mid_lin.by_tau
            p = transition[k] @ p @ transition[k].T + (b * input_noise) @ b.T
            if len(acts):
                p[2 * nv :, 2 * nv :].flat[:: len(acts) + 1] += self.walk * h_k  # a view: written in place
            p = 0.5 * (p + p.T)  # nothing corrects the rest, and unstable motion makes it grow
        self.q, self.v, self.covariance, self.unknown, self._next = q, v, p, w, first + n
        self._before = drive.means[-1, -1] + drive.rise[-1, -1] if moves else None
        middle_times = 0.5 * (edges[1:] + edges[:-1])
        return FilterRun(
            e, log_likelihood, whitening, gain, sensitivity, by_a, transition, forcing,
            at.states(times), mid.states(middle_times), at.inverse, mid.inverse, predicted, errors,
            normalised, used, edges,
        )  # fmt: skip


def _readable(problem: Problem) -> np.ndarray:
    """Return which readings count (N, rows): those that are there.

    Of the first sample none that shows at once what acts, where that is a command from before the recording.
    """
    present, timing = np.isfinite(problem.data.values), problem.timing
    if timing.hold not in VARYING and timing.side == "left" and jumps_in(problem.recording):
        for block in problem.data.blocks:
            if block.quantity in AT_ONCE:
                present[0, block.rows] = False
    return present


class _Store:
    def __init__(self, n: int, model: SpacecraftModel) -> None:
        self.q, self.v, self.a, self.tau = (np.zeros((n, w)) for w in (model.nq, *(3 * [model.nv])))
        self.inverse = np.zeros((n, model.nv, model.nv))

    def put(
        self, k: int, q: np.ndarray, v: np.ndarray, a: np.ndarray, tau: np.ndarray, inv: np.ndarray
    ) -> None:
        self.q[k], self.v[k], self.a[k], self.tau[k], self.inverse[k] = q, v, a, tau, inv

    def states(self, times: np.ndarray) -> States:
        return States(times, self.q, self.v, self.a, self.tau, np.zeros_like(self.tau))


def _delayed(
    outputs: MeasurementModel,
    late: np.ndarray,
    t: float,
    state: tuple[np.ndarray, np.ndarray],
    a: np.ndarray,
    forces: tuple[np.ndarray, np.ndarray],
    plant: ProcessModel,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Predict what late sensors read: the state (q, v) carried back by each delay, forces held.

    ``forces`` are those just before the sample, which a late reading is under, and just after it, for one
    that is early.
    """
    q, v = state
    full = outputs.predict(q, v, a)
    for delay in np.unique(late[late != 0.0]):
        tau = forces[0] if delay > 0.0 else forces[1]
        under = plant.acceleration(t, q, v, tau)
        back = pin.integrate(plant.pin, q, -delay * v + 0.5 * delay**2 * under)
        before = v - delay * under
        then = outputs.predict(back, before, plant.acceleration(t - delay, back, before, tau))
        for block, own in zip(outputs.data.blocks, late, strict=True):
            if own == delay:
                if block.quantity == "attitude":  # predicted as a rotation from the attitude there is now
                    here, there = (pin.Quaternion(x[3:7]).matrix() for x in (q, back))
                    then[0][block.rows] += pin.log3(here.T @ there)
                for now, old in zip(full, then, strict=True):
                    now[block.rows] = old[block.rows]
    return full


def first_state(model: SpacecraftModel, problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return a first q (nq,) and v (nv,) from the first samples: what is measured, the rest at rest."""
    q, v = model.home.copy(), np.zeros(model.nv)
    data, pose = problem.data, None
    for block in data.blocks:
        first = data.values[0, block.rows]
        if not np.isfinite(first).all():
            continue
        if block.quantity == "joint_position":
            q = set_group_angles(model.pin, model.arm_joints, q, first)
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


def _first_covariance(model: SpacecraftModel, problem: Problem) -> np.ndarray:
    nv = model.nv
    sigma = np.ones(2 * nv)
    if model.free:
        sigma[0:3], sigma[3:6], sigma[nv : nv + 3], sigma[nv + 3 : nv + 6] = 0.1, 0.01, 0.05, 0.005
    sigma[model.arm_joints.v], sigma[nv + model.arm_joints.v] = 0.01, 0.01
    sigma[model.wheels.v], sigma[nv + model.wheels.v] = 1e-3, 1.0
    known = (np.arange(6 if model.free else 0), model.arm_joints.v, model.wheels.v)
    index = np.setdiff1d(np.arange(nv), np.concatenate(known))  # slosh, modes, and whatever else effects add
    sigma[index], sigma[nv + index] = problem.noise.hidden
    sigma[problem.locked], sigma[nv + problem.locked] = 1e-3, 1e-9
    return np.diag(sigma**2)


def _input_covariance(model: SpacecraftModel, problem: Problem) -> np.ndarray:
    noise, out = problem.noise, np.zeros(model.nv)
    if model.free:
        out[0:3], out[3:6] = noise.force, noise.torque
    out[model.arm_joints.v], out[model.wheels.v] = noise.joint, noise.wheel
    out[problem.locked] = 0.0
    out = out**2
    for dof, sigma in noise.more:
        out[dof] += sigma**2
    return out


def _lost(time: float) -> SimulationError:
    return SimulationError(
        f"The filter lost the recording at t = {time:.6g} s: the prediction is no longer finite.",
        advice="Does the description belong to this recording? Check units and the sign of the commands.",
        time=time,
    )
