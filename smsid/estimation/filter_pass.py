"""The extended Kalman filter over samples: by compiled code (`smsid.kernel.filter`), or plainly."""

from __future__ import annotations

import logging
import math
import os
import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from smsid._time_text import time_text
from smsid.errors import SimulationError
from smsid.estimation._measurement_model import MeasurementModel
from smsid.estimation.measurements import Measurements, matrix, reading_errors
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import UnknownForces
from smsid.estimation.process_model import ProcessModel
from smsid.kernel import filter as kernel
from smsid.kernel.filter_arrays import Drive, Model, Record, Samples, State
from smsid.kernel.jit import SWITCH, compiled_already
from smsid.model.spacecraft import SpacecraftModel

LOST_RATE = 1e9  # [m/s, rad/s] rate beyond which a prediction is lost
CLOSE_SIGMAS = 1e-3  # standard deviations within which a parameter is where the model is
REGULARISATION = 1e-12  # relative: what keeps a covariance of parameters regular
COMPILATION_SECONDS = 30.0  # [s] that it takes, once; plain passes of as long are waited for before
_plain_seconds = [0.0]
LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True)
class AppliedForces:
    """Applied generalised forces: means over the substeps (N - 1, substeps, nv), means over the intervals
    between samples (N - 1, nv), and values at the samples (N, nv). ``rise`` (N - 1, substeps, nv) is by how
    much the line of equal mean and equal first moment rises over half a substep. ``before`` (nv,) are the
    forces just before the first sample, where that is not the first of all. ``jumps`` (N - 1, nv) are
    standard deviations of the means over intervals in which commands switch at an unknown time, ``None``
    where they do not.
    """

    means: np.ndarray
    middle: np.ndarray
    at: np.ndarray
    rise: np.ndarray
    before: np.ndarray | None = None
    jumps: np.ndarray | None = None

    @property
    def last(self) -> np.ndarray | None:
        """The forces (nv,) just before the last sample, if there is one before it."""
        return self.means[-1, -1] + self.rise[-1, -1] if len(self.means) else None

    def drive(
        self,
        unknown: UnknownForces,
        noise: np.ndarray,
        push_at: np.ndarray | None = None,
        push_middle: np.ndarray | None = None,
    ) -> Drive:
        """Return what a pass takes: with unknown inputs and the ``noise`` (nv,) of what is held, variances;
        forces change with parameters by ``push_at`` (n, d, nv) at samples and by ``push_middle`` (N, d, nv)
        between them.
        """
        n, nv = self.at.shape
        before, after = self.at.copy(), self.at.copy()
        moves = len(self.means)
        before[1 : moves + 1] = self.means[:, -1] + self.rise[:, -1]
        after[:moves] = self.means[:, 0] - self.rise[:, 0]
        if self.before is not None:
            before[0] = self.before
        nothing = np.zeros((n, 0, nv))
        return Drive(
            np.ascontiguousarray(self.at),
            np.ascontiguousarray(self.middle),
            np.ascontiguousarray(self.means),
            np.ascontiguousarray(self.rise),
            before,
            after,
            nothing if push_at is None else push_at,
            nothing if push_middle is None else push_middle,
            np.zeros((0, nv)) if self.jumps is None else np.ascontiguousarray(self.jumps),
            *unknown,
            noise,
        )


@dataclass(frozen=True)
class Moment:
    """Where a derivative is taken: time [s], q (nq,), v (nv,), applied forces (nv,), accelerations, M^-1."""

    time: float
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    a: np.ndarray
    inverse: np.ndarray


@dataclass(frozen=True)
class Instance:
    """A spacecraft as a filter sees it: forward dynamics, sensors, and how late these are [s]."""

    model: SpacecraftModel
    plant: ProcessModel
    outputs: MeasurementModel
    late: np.ndarray

    @classmethod
    def of(cls, model: SpacecraftModel, data: Measurements, locked: np.ndarray) -> Instance:
        """Return a spacecraft with its sensors, degrees of freedom ``locked`` (k,) held still."""
        late = np.array([b.delay for b in data.blocks])
        return cls(model, ProcessModel(model, locked), MeasurementModel(model, data, locked), late)

    @classmethod
    def at(cls, point: Point, layout: Measurements, locked: np.ndarray) -> Instance:
        """Return the spacecraft at a point, degrees of freedom ``locked`` (k,) held still.

        Raises `DescriptionError` where there can be none.
        """
        return cls.of(point.model(), layout.with_blocks(point.sensors()), locked)

    def predict(
        self, m: Moment, forces: tuple[np.ndarray, np.ndarray], plant: ProcessModel
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return what sensors read (rows,), and its derivatives by q, v and a (rows, nv).

        ``forces`` are those just before and just after the sample, for sensors that are late.
        """
        if self.late.any():
            found = predict_delayed(self.outputs, self.late, m.time, (m.q, m.v), m.a, forces, plant)
        else:
            found = self.outputs.predict(m.q, m.v, m.a)
        self.outputs.twisted(found[0], m.time, m.q, m.v, m.tau, m.a)
        return found


def predict_delayed(
    outputs: MeasurementModel,
    late: np.ndarray,
    t: float,
    state: tuple[np.ndarray, np.ndarray],
    a: np.ndarray,
    forces: tuple[np.ndarray, np.ndarray],
    plant: ProcessModel,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Predict what late sensors read: the state (q, v) carried back by each delay, forces held, and
    accelerations going straight from what they were then to what they are now: to the third order of it.

    ``forces`` are those just before the sample, which a late reading is under, and just after it, for one
    that is early.
    """
    q, v = state
    full = outputs.predict(q, v, a)
    for delay in np.unique(late[late != 0.0]):
        tau = forces[0] if delay > 0.0 else forces[1]
        under = plant.acceleration(t, q, v, tau)
        back, before, far = q, v, under
        for _ in range(kernel.BACK):
            back = pin.integrate(plant.pin, q, -delay * v + delay**2 * (2.0 * under + far) / 6.0)
            before = v - 0.5 * delay * (under + far)
            far = plant.acceleration(t - delay, back, before, tau)
        then = outputs.predict(back, before, far)
        for block, own in zip(outputs.data.blocks, late, strict=True):
            if own == delay:
                if block.quantity == "attitude":  # predicted as a rotation from the attitude there is now
                    here, there = (pin.Quaternion(x[3:7]).matrix() for x in (q, back))
                    then[0][block.rows] += pin.log3(here.T @ there)
                for now, old in zip(full, then, strict=True):
                    now[block.rows] = old[block.rows]
    return full


class FilterParameters(Protocol):
    """Parameters (m,) that are states of the filter, in units of ``scales``; its model is at ``values``.

    ``rates`` (m,) are variances by which they wander in a second, over the scales squared; ``trends`` are as
    in `smsid.kernel.filter_arrays.Parameters`, as is ``close``.
    """

    close: np.ndarray
    values: np.ndarray
    scales: np.ndarray
    rates: np.ndarray
    trends: tuple[np.ndarray, np.ndarray]

    def accelerations(self, moment: Moment, push: np.ndarray) -> np.ndarray:
        """Return how accelerations change with the parameters (nv, m), per scale; applied forces change by
        ``push`` (d, nv) with those that they depend on.
        """
        ...

    def readings(self, moment: Moment, forces: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Return how readings at fixed motion change with the parameters (rows, m), per scale."""
        ...


def filter_samples(
    base: Instance,
    parameters: FilterParameters | None,
    compiled: Model | None,
    drive: Drive,
    state: State,
    samples: Samples,
    *,
    shift: float = 0.0,
) -> Record:
    """Filter samples and return what was made of them; ``state`` is changed in place.

    Samples are ``shift`` [s] later than by the own clock of the recording. It goes on to the next sample
    where there is one. Raises `SimulationError` when the state or its covariance is no longer finite.
    """
    n, rows = samples.values.shape
    shape = n, rows, len(state.covariance), len(state.values)
    record = _empty_record(len(samples.edges) - 1, *shape, base.model)
    if compiled is not None and compiled_pays():
        if not compiled_already(kernel.run):
            LOGGER.info("the filter is compiled, once: some 30 s")
        lost = kernel.run(*compiled, drive, state, samples, record, LOST_RATE)
    else:
        began = time.perf_counter()
        lost = run_plain(base, parameters, drive, state, samples, record)
        _plain_seconds[0] += time.perf_counter() - began
    if lost != kernel.DONE:
        raise lost_at(float(samples.edges[lost]) - shift)
    return record


def compiled_pays() -> bool:
    """Return whether to take compiled code: it is there, is asked for, or would be worth the wait by now."""
    asked = os.environ.get(SWITCH) == "1"
    return asked or compiled_already(kernel.run) or _plain_seconds[0] > COMPILATION_SECONDS


def _empty_record(moves: int, n: int, rows: int, width: int, m: int, model: SpacecraftModel) -> Record:
    """Return a record of zeros, in one piece of memory: of smaller ones each page is asked for by itself."""
    nq, nv = model.nq, model.nv
    moment = [(nq,), (nv,), (nv,), (nv,), (nv, nv)]
    shapes = [
        *((n, *s) for s in ((rows,), (rows, rows), (width, rows), (rows, width), (rows, nv))),
        *((moves, *s) for s in ((width, width), (width, nv))),
        *((n, *s) for s in ((rows,), (rows,), (rows,), (), (m,), (m,))),
        *((n, *s) for s in moment),
        *((moves, *s) for s in moment),
    ]
    ends = np.cumsum([math.prod(s) for s in shapes]).tolist()
    whole = np.zeros(ends[-1])
    parts = [x.reshape(s) for x, s in zip(np.split(whole, ends[:-1]), shapes, strict=True)]
    return Record(*parts[:13], at=tuple(parts[13:18]), middle=tuple(parts[18:]))


def lost_at(time: float) -> SimulationError:
    """Return the error of a filter that has lost the motion at a time [s]."""
    return SimulationError(
        f"The filter lost the recording at t = {time_text(time)}: the prediction is no longer finite.",
        advice="Does the description belong to this recording? Check units and the sign of the commands.",
        time=time,
    )


@np.errstate(over="ignore", invalid="ignore")  # a filter that is lost is told by its values
def run_plain(
    base: Instance,
    parameters: FilterParameters | None,
    drive: Drive,
    state: State,
    samples: Samples,
    record: Record,
) -> int:
    """Do what `smsid.kernel.filter.run` does, over Pinocchio and numpy, for any model: its reference."""
    plant, nv, acts, edges = base.plant, base.model.nv, drive.acts, samples.edges
    rated, first = 2 * nv + len(acts), 2 * nv + len(state.unknown)
    p, blocks = state.covariance, base.outputs.data.blocks
    ramps = np.column_stack([drive.sloped, len(acts) + np.arange(len(drive.sloped))])
    for k in range(len(samples.values)):
        corrects, t = k < samples.corrections, float(edges[k])
        off, q, v, driving, climb = reference(plant, parameters, state, acts, drive.sloped)
        moment, lin = _moment(base, t, q, v, drive.at[k] + driving, corrects)
        _put(record.at, k, moment)
        forces = drive.before[k] + driving, drive.after[k] + driving
        h, cq, cv, ca = base.predict(moment, forces, plant)
        record.predicted[k], record.by_a[k] = h, ca if corrects else 0.0
        turn = matrix(q[3:7]) if base.model.free else None
        record.errors[k] = reading_errors(blocks, t, samples.values[k], samples.attitudes[k], h, turn)
        if corrects:
            whole = record.sensitivity[k]
            whole[:, :nv] = ca @ lin.by_q + cq
            whole[:, nv : 2 * nv] = ca @ lin.by_v + cv
            whole[:, 2 * nv : rated] = ca @ lin.by_tau[:, acts]
            if parameters is not None:
                whole[:, first:] = parameters.readings(moment, forces)
                if ca.any():
                    whole[:, first:] += ca @ parameters.accelerations(moment, drive.push_at[k])
            there = samples.order[samples.there[k][samples.order]]
            if len(there):
                found = correction(p, whole[there], record.errors[k, there] - whole[there] @ off,
                                   samples.variance[there])  # fmt: skip
                if found is None:
                    return k
                rest, white, inverse, root, deviation, likely = found
                record.errors[k, there], record.innovations[k, there] = rest, white
                record.normalised[k, there] = rest / deviation
                record.whitening[k][np.ix_(there, there)] = inverse
                record.gain[k][:, there] = root @ inverse
                record.log_likelihood[k] = likely
                p -= root @ root.T
                p[:] = 0.5 * (p + p.T)
                shift(plant.pin, parameters, state, root @ white)
        if parameters is not None:
            record.values[k] = state.values
            variances = np.maximum(p.diagonal()[first:], 0.0)
            record.sigmas[k] = parameters.scales * np.sqrt(variances)
        if k == len(edges) - 1:
            break
        off, q, v, driving, climb = reference(plant, parameters, state, acts, drive.sloped)
        h_k, substeps = float(edges[k + 1]) - t, drive.means.shape[1]
        change, forcing = record.transition[k], record.forcing[k, : 2 * nv]
        for s in range(substeps):
            if s == substeps // 2:
                half = drive.middle[k] + driving + 0.5 * h_k * climb
                moment, lin = _moment(base, t + 0.5 * h_k, q, v, half, corrects)
                _put(record.middle, k, moment)
                if corrects:
                    change[: 2 * nv, : 2 * nv], psi = plant.transition(h_k, v, lin)
                    forcing[:] = psi[:, nv:]
                    change[: 2 * nv, 2 * nv : rated] = forcing @ lin.by_tau[:, acts]
                    change[: 2 * nv, rated:first] = 0.5 * h_k * change[: 2 * nv, 2 * nv + drive.sloped]
                    change[2 * nv :, 2 * nv :] = np.eye(len(p) - 2 * nv)
                    if parameters is not None:
                        by_theta = parameters.accelerations(moment, drive.push_middle[k])
                        change[: 2 * nv, first:] = forcing @ by_theta
            part = h_k / substeps
            tau = drive.means[k, s] + driving + (s + 0.5) * part * climb
            q, v = plant.step(t + s * part, part, q, v, tau, drive.rise[k, s] + 0.5 * part * climb)
        further = change[: 2 * nv] @ off
        state.q[:], state.v[:] = pin.integrate(plant.pin, q, further[:nv]), v + further[nv:]
        if not np.abs(state.v).max(initial=0.0) < LOST_RATE:
            return k
        state.unknown[drive.sloped] += h_k * state.unknown[len(acts) :]
        if parameters is not None:
            own, by = parameters.trends[0].T
            state.values[own] += h_k * state.values[by]
        if corrects:
            b = forcing @ lin.by_tau
            p[:] = change @ p @ change.T
            p[: 2 * nv, : 2 * nv] += (b * drive.noise) @ b.T
            if len(drive.jumps):
                p[: 2 * nv, : 2 * nv] += np.outer(b @ drive.jumps[k], b @ drive.jumps[k])
            p[:first, :first] += walk_covariance(change[: 2 * nv, 2 * nv : first], drive.walk * h_k)
            if parameters is not None:
                own = range(first, len(p))
                p[own, own] += parameters.rates * h_k
                carry_trends(p, change, first, *parameters.trends, h_k)
            carry_trends(p, change, 2 * nv, ramps, np.ones(len(ramps)), h_k)
            p[:] = 0.5 * (p + p.T)  # nothing corrects the rest, and unstable motion makes it grow
    return kernel.DONE


def carry_trends(
    p: np.ndarray, change: np.ndarray, first: int, trends: np.ndarray, steep: np.ndarray, h: float
) -> None:
    """Do what `smsid.kernel.covariance.carry_trends` does to covariance p and transition ``change`` (x, x).

    ``trends`` (k, 2) and ``steep`` (k,) are as in `smsid.kernel.filter_arrays.Parameters`.
    """
    move = np.eye(len(p))
    move[first + trends[:, 0], first + trends[:, 1]] = h * steep
    change[first + trends[:, 0], first + trends[:, 1]] = h * steep
    p[:] = move @ p @ move.T


def correction(
    p: np.ndarray, h: np.ndarray, rest: np.ndarray, variance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, float] | None:
    """Return what errors ``rest`` (n,) of readings of a ``variance`` (n,) tell of a state, by h (n, x).

    ``p`` (x, x) is its covariance. Returns the errors, these whitened (n,), the whitening (n, n), the square
    root (x, n) of what the covariance loses, standard deviations (n,) and the log-likelihood; ``None`` where
    there is none.
    """
    across = p @ h.T
    s = h @ across
    s.flat[:: len(rest) + 1] += variance
    low, info = lapack.dpotrf(s, lower=1, clean=1)
    if info != 0 or not np.isfinite(rest).all():
        return None
    inverse, _ = lapack.dtrtri(low, lower=1)
    white = inverse @ rest
    likely = -0.5 * float(white @ white) - float(np.log(low.diagonal()).sum())
    return rest, white, inverse, across @ inverse.T, np.sqrt(s.diagonal()), likely


def walk_covariance(moved: np.ndarray, grown: np.ndarray) -> np.ndarray:
    """Return the covariance (x + k, x + k) that random walks of unknown inputs give a state and themselves.

    ``moved`` (x, k) is what a mean of one does to the state in an interval, ``grown`` (3, k) by how much
    variances grow in it, as in `smsid.estimation.problem.UnknownForces`.
    """
    end, common, mean = grown
    across = moved * common
    return np.block([[(moved * mean) @ moved.T, across], [across.T, np.diag(end)]])


def shift(pin_model: pin.Model, parameters: FilterParameters | None, state: State, step: np.ndarray) -> None:
    """Add a step (x,) to what is believed, in place."""
    nv, first = len(state.v), 2 * len(state.v) + len(state.unknown)
    state.q[:] = pin.integrate(pin_model, state.q, step[:nv])
    state.v[:] += step[nv : 2 * nv]
    state.unknown[:] += step[2 * nv : first]
    if parameters is not None:
        state.values[:] += parameters.scales * step[first:]


def reference(
    plant: ProcessModel,
    parameters: FilterParameters | None,
    state: State,
    acts: np.ndarray,
    sloped: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return how far what is believed is from where it is linear (x,), and there q, v, unknown forces (nv,)
    and by how much these climb in a second; ``acts`` (k,) and ``sloped`` (j,) are as in `UnknownForces`.

    That is the state which goes with the parameters of the model: its mean, given these. So the filter is
    linear about a motion that there can be, however far parameters at first are believed to be. Biases, in
    which readings are linear and which no motion knows, are not among them (``close`` is infinite).
    """
    nv, p = len(state.v), state.covariance
    off, first = np.zeros(len(p)), 2 * nv + len(state.unknown)
    if parameters is not None:
        d = (state.values - parameters.values) / parameters.scales
        off[first:] = d
        own = p[first:, first:]
        if (np.abs(d) > parameters.close * np.sqrt(own.diagonal())).any():
            bends = np.isfinite(parameters.close)
            size = np.sqrt(np.maximum(own.diagonal()[bends], 1e-300))
            scaled = own[np.ix_(bends, bends)] / np.outer(size, size) + REGULARISATION * np.eye(len(size))
            off[:first] = p[:first, first:][:, bends] @ (np.linalg.solve(scaled, d[bends] / size) / size)
    driving, climb, there = *np.zeros((2, nv)), state.unknown - off[2 * nv : first]
    np.add.at(driving, acts, there[: len(acts)])
    np.add.at(climb, acts[sloped], there[len(acts) :])
    return off, pin.integrate(plant.pin, state.q, -off[:nv]), state.v - off[nv : 2 * nv], driving, climb


def _moment(base: Instance, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray, corrects: bool):
    lin = (base.plant.linear if corrects else base.plant.moving)(t, q, v, tau)
    return Moment(t, q, v, tau, lin.a, lin.by_tau), lin


def _put(arrays: tuple, k: int, m: Moment) -> None:
    for array, value in zip(arrays, (m.q, m.v, m.a, m.tau, m.inverse), strict=True):
        array[k] = value
