"""How accelerations and readings change with a parameter, along the states a filter found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from smsid.effects.base import Effect
from smsid.errors import NotIdentifiableError
from smsid.estimation.bias_walk import unit_bias
from smsid.estimation.filter_pass import AppliedForces, compiled_pays
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.kalman import applied
from smsid.estimation.measurement_model import MeasurementModel
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Problem
from smsid.estimation.process_model import ProcessModel
from smsid.kernel.derivatives import forces_along
from smsid.kernel.filter import steps_ahead
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate.trajectory import States

BACK = 1e-4  # [s] how far back a reading is compared for its rate
DIFFERENCE = 1e-4  # step of a difference, in scales of the parameter
LITTLE = 0.01  # share of a parameter's value: with steps of far less a difference is of rounding
BLOCK = 16  # samples whose columns are written at once: a transposition is slow row by row


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives by one parameter: of the acceleration between samples (N - 1, nv) and at them (N, nv), and
    of the readings at fixed motion (N, rows); ``None`` where there is none. ``ahead`` (N - 1, 2 nv), tangent
    and rates, is of the state at the next sample, where what happens within the way there is not held.
    """

    middle: np.ndarray | None = None
    at: np.ndarray | None = None
    reading: np.ndarray | None = None
    ahead: np.ndarray | None = None

    def times(self, factor: float) -> Sensitivity:
        """Return it ``factor`` times."""
        parts = (self.middle, self.at, self.reading, self.ahead)
        return Sensitivity(*(None if x is None else factor * x for x in parts))


class Sensitivities:
    """Changes by any parameter at a point, along a run of the filter there."""

    def __init__(self, point: Point, model: SpacecraftModel, problem: Problem, run: FilterRun) -> None:
        self.point, self.model, self.problem, self.run = point, model, problem, run
        self.outputs = MeasurementModel(model, problem.data, problem.locked)
        self.sensors = point.sensors()
        self.inputs = problem.inputs(model)
        self.applied = self._applied(model)
        self._rates: np.ndarray | None = None
        self._regressors: dict[str, np.ndarray] = {}
        self._own: dict[str, np.ndarray] = {}
        self.by_candidate: dict[tuple[object, ...], list[Sensitivity]] = {}  # what is scored is scored again

    def inertial(self, columns: Sequence[int]) -> list[Sensitivity]:
        """Return the changes by inertial parameters, ten per body: -M^-1 Y."""
        index = np.asarray(columns)
        middle, at = (
            -np.matmul(inverse, self._regressor(where)[:, :, index])
            for where, inverse in (("middle", self.run.middle_inverse), ("at", self.run.inverse))
        )
        return [Sensitivity(middle[:, :, i], at[:, :, i]) for i in range(len(columns))]

    def _regressor(self, where: str) -> np.ndarray:
        """Return Y (N, nv, 10 bodies) along the run; computed once."""
        if where not in self._regressors:
            states, data = self._states(where), self.model.pin.createData()
            y = np.empty((len(states.time), self.model.nv, 10 * (self.model.pin.njoints - 1)))
            for k, (q, v, a) in enumerate(zip(states.q, states.v, states.a, strict=True)):
                y[k] = pin.computeJointTorqueRegressor(self.model.pin, data, q, v, a)
            self._regressors[where] = y
        return self._regressors[where]

    def _states(self, where: str) -> States:
        return self.run.middle if where == "middle" else self.run.states

    def effect(self, plain: Effect, changed: Effect, step: float) -> Sensitivity:
        """Return the change from one instance of an effect to another, per unit of the step.

        An effect that the point does not have is taken to do nothing in its ``plain`` instance. Raises
        `DescriptionError` for an instance the spacecraft cannot have, `NotIdentifiableError` for one that
        adds joints, which has no derivative at zero.
        """
        there = {e.name: e for e in self.point.description.effect}
        known = changed.name in there and there[changed.name] is not plain  # else the point has it so
        base = self.point.with_effect(plain) if known else self.point
        other, cls = self.point.with_effect(changed), type(changed)
        forces = cls.attach is not Effect.attach
        if forces:
            origin, model = base.model() if known else self.model, other.model()
        else:  # bodies and forces stay what they are
            own = self.model.description
            origin = replace(self.model, description=own.with_effects(plain)) if known else self.model
            model = replace(self.model, description=own.with_effects(changed))
        if model.nv != origin.nv:
            raise NotIdentifiableError(
                f"'{changed.name}' adds joints.", advice="Fit it through simulation.", effect=changed.name
            )
        forces = forces and not _move_alike(origin, model)
        middle = at = None
        if forces or cls.drive is not Effect.drive:
            pushed = [
                self._taken(where, origin) - self._taken(where, model) if forces else np.zeros_like(s.tau)
                for where, s in (("middle", self.run.middle), ("at", self.run.states))
            ]
            if cls.drive is not Effect.drive:
                new, old = self._applied(model), self._applied(origin) if known else self.applied
                pushed[0] += new.middle - old.middle
                pushed[1] += (new.at - old.at)[: len(pushed[1])]
            if np.any(pushed[0]) or np.any(pushed[1]):
                middle = np.matmul(self.run.middle_inverse, pushed[0][:, :, None])[:, :, 0] / step
                at = np.matmul(self.run.inverse, pushed[1][:, :, None])[:, :, 0] / step
        reading = self._reading(base, other, origin, model)
        ahead = None
        if forces and changed.has_fast_dynamics():
            middle, ahead = None, self._difference_ahead(origin, model) / step
        return Sensitivity(middle, at, None if reading is None else reading / step, ahead)

    def _difference_ahead(self, origin: SpacecraftModel, model: SpacecraftModel) -> np.ndarray:
        """Return by how much the state at the next sample (N - 1, 2 nv) differs in another model."""
        (q, v), (other_q, other_v) = self._state_ahead(origin), self._state_ahead(model)
        turned = [pin.difference(self.model.pin, *x) for x in zip(q, other_q, strict=True)]
        return np.hstack([np.array(turned).reshape(v.shape), other_v - v])

    def _state_ahead(self, model: SpacecraftModel) -> tuple[np.ndarray, np.ndarray]:
        """Return q (N - 1, nq) and v (N - 1, nv) at the next sample, from where each sample left them."""
        run, moves, nv = self.run, len(self.run.transition), self.model.nv
        step = np.einsum("nij,nj->ni", run.gain[:moves], run.errors[:moves])
        here = zip(run.states.q[:moves], step[:, :nv], strict=True)
        q = np.array([pin.integrate(self.model.pin, *x) for x in here]).reshape(moves, self.model.nq)
        v = run.states.v[:moves] + step[:, nv : 2 * nv]
        own = self._applied(model)
        means = own.means + (run.middle.tau - self.applied.middle)[:, None]  # with unknown inputs
        plant = ProcessModel(model, self.problem.locked)
        kernel = plant.kernel() if compiled_pays() else None
        if kernel is not None:
            steps_ahead(*kernel.arrays, run.edges, q, v, means, own.rise)
            return q, v
        parts = means.shape[1]
        for k, h in enumerate(np.diff(run.edges[: moves + 1]) / parts):
            for s in range(parts):
                here = run.edges[k] + s * h
                q[k], v[k] = plant.step(here, h, q[k], v[k], means[k, s], own.rise[k, s])
        return q, v

    def _applied(self, model: SpacecraftModel) -> AppliedForces:
        process = ProcessModel(model, self.problem.locked)
        return applied(process, self.problem, self.inputs, self.run.edges)

    def bias(self, unknown: Unknown) -> Sensitivity:
        """Return the change by the bias of one component, along the sensor's own axes, of a channel."""
        channel, rows = ".".join(unknown.name.split(".")[:2]), self.problem.data.rows
        reading = np.zeros((len(self.run.states.time), rows))
        for block in self.problem.data.blocks:
            if block.channel == channel:
                reading[:] = unit_bias(block, unknown.column, rows)
        return Sensitivity(reading=reading)

    def sensor(self, unknown: Unknown) -> Sensitivity:
        """Return the change by another error of a sensor in this recording, by a difference."""
        step = DIFFERENCE * unknown.scale
        other = self.point.moved([unknown], np.array([step]))
        reading = self._reading(self.point, other, self.model, self.model)
        return Sensitivity(reading=None if reading is None else reading / step)

    def unknown(self, unknown: Unknown) -> Sensitivity:
        """Return the change by a parameter of an effect the point has, by a difference."""
        value, owner = self.point.value(unknown), unknown.name.partition(".")[0]
        step = DIFFERENCE * max(unknown.scale, LITTLE * abs(value))
        step = step if value + step <= unknown.upper else -step
        mine, more = (
            p.description.get_effect(owner)
            for p in (self.point, self.point.moved([unknown], np.array([step])))
        )
        return self.effect(mine, more, step)

    def force(self, middle: np.ndarray, at: np.ndarray) -> Sensitivity:
        """Return the change by a generalised force along the run.

        ``middle`` (N - 1, nv) between samples, ``at`` (N, nv) them.
        """
        return Sensitivity(
            np.einsum("nij,nj->ni", self.run.middle_inverse, middle),
            np.einsum("nij,nj->ni", self.run.inverse, at),
        )

    def readings(self) -> np.ndarray:
        """Return what is read along the run (N, rows)."""
        return self.outputs.all(self.run.states)

    def rates(self) -> np.ndarray:
        """Return time derivatives of the readings (N, rows) between jumps of the commands, for delays."""
        if self._rates is None:
            s, plant = self.run.states, ProcessModel(self.model, self.problem.locked)
            q, v, a = np.empty_like(s.q), s.v - BACK * s.a, np.empty_like(s.a)
            for k, (t, tau) in enumerate(zip(s.time, s.tau, strict=True)):
                q[k] = pin.integrate(self.model.pin, s.q[k], -BACK * s.v[k])
                a[k] = plant.acceleration(float(t) - BACK, q[k], v[k], tau)
            before = States(s.time, q, v, a, s.tau, s.reaction)
            rates = (self.outputs.all(s) - self.outputs.all(before)) / BACK
            for block in self.problem.data.blocks:
                if block.quantity == "attitude":
                    rates[:, block.rows] = s.v[:, 3:6]
            self._rates = rates
        return self._rates

    def _taken(self, where: str, model: SpacecraftModel) -> np.ndarray:
        """Return the generalised forces (N, nv) that a model's motion takes along the run; its own, once."""
        if model is self.model and where in self._own:
            return self._own[where]
        held = np.zeros(0, dtype=int)
        kernel = ProcessModel(model, held).kernel(balanced=False) if compiled_pays() else None
        s = self._states(where)
        found = np.empty((len(s.time), model.nv))
        if kernel is not None:
            forces_along(*kernel.arrays, s.time, s.q, s.v, s.a, s.tau, found)
        else:
            _forces_along(model, s, found)
        if model is self.model:
            self._own[where] = found
        return found

    def _reading(
        self, base: Point, other: Point, origin: SpacecraftModel, model: SpacecraftModel
    ) -> np.ndarray | None:
        before, after = base.sensors(), other.sensors()
        scaled = any(
            not np.array_equal(a.scale, b.scale)
            or a.appendage != b.appendage
            or not np.array_equal(*(0.0 if x.drawn is None else x.drawn for x in (a, b)))  # pyright: ignore
            or a.more != b.more
            for a, b in zip(origin.appendages, model.appendages, strict=True)
        )
        if before == after and not (scaled or origin.twists != model.twists):
            return None
        old, new = (self.problem.data.with_blocks(s) for s in (before, after))
        locked, states = self.problem.locked, self.run.states
        moved = {"encoder"} if origin.twists != model.twists else set()
        if origin.appendages is not model.appendages:
            moved.add("accelerometers")
        some = {a.name for a, b in zip(before, after, strict=True) if a != b or a.kind in moved}
        # with other bodies the mass matrix is another one
        inverse = self.run.inverse if origin.pin == self.model.pin == model.pin else None
        out = MeasurementModel(model, new, locked).all(states, some, inverse)
        out -= MeasurementModel(origin, old, locked).all(states, some, inverse)
        for a, b in zip(old.blocks, new.blocks, strict=True):
            if a.delay != b.delay:
                out[:, a.rows] -= (b.delay - a.delay) * self.rates()[:, a.rows]
        return out


def _move_alike(one: SpacecraftModel, other: SpacecraftModel) -> bool:
    """Whether two models have the same bodies, springs and further forces: what differs is only read."""
    return (
        one.pin == other.pin
        and np.array_equal(one.stiffness, other.stiffness)
        and np.array_equal(one.damping, other.damping)
        and (one.loads, one.forces, one.inertial) == (other.loads, other.forces, other.inertial)
    )


def _forces_along(model: SpacecraftModel, states: States, out: np.ndarray) -> None:
    """Do what `smsid.kernel.derivatives.forces_along` does, for any model."""
    data, terms = model.pin.createData(), () if model.inertial is None else model.inertial.terms
    rows = zip(states.time, states.q, states.v, states.a, states.tau, strict=True)
    for k, (t, q, v, a, load) in enumerate(rows):
        passive = load.copy()
        model.add_passive_forces(float(t), q, v, passive, inertial=False)
        out[k] = pin.rnea(model.pin, data, q, v, a) - (passive - load)
        for term in terms:  # at the accelerations there are, whatever is held still
            mass, bias = term(float(t), q, v)
            out[k] += mass @ a + bias


def propagate(run: FilterRun, changes: Sequence[Sensitivity], delta: np.ndarray | None = None) -> np.ndarray:
    """Return how the whitened predictions change by each parameter: (N, rows, columns).

    ``delta`` (states, columns) is how the state changes at the first sample, none when not given; it is left
    as it is at the sample after the run.

    The change goes through the filter as it ran: delta+ = (1 - K H) delta - K D, delta <- F delta+ + Psi phi.
    The innovations change by the negative. Each column is contiguous in memory.
    """
    n, rows, _ = run.by_a.shape
    m = len(changes)
    # what is alike stands together: adding to scattered columns is slow
    order = sorted(range(m), key=lambda i: (changes[i].at is None, changes[i].reading is not None))
    pushed, middle = _stacked([changes[i].middle for i in order])
    led, ahead = _stacked([changes[i].ahead for i in order])
    moved, at = _stacked([changes[i].at for i in order])
    seen, reading = _stacked([changes[i].reading for i in order])
    out = np.empty((m, n, rows))
    block = np.empty((BLOCK, rows, m))
    now: np.ndarray = np.zeros((run.gain.shape[1], m)) if delta is None else delta[:, order]
    for k in range(n):
        predicted = run.sensitivity[k] @ now
        if at is not None:
            predicted[:, moved] += run.by_a[k] @ at[:, k].T
        if reading is not None:
            predicted[:, seen] += reading[:, k].T
        np.matmul(run.whitening[k], predicted, out=block[k % BLOCK])
        if k % BLOCK == BLOCK - 1 or k == n - 1:
            out[order, k - k % BLOCK : k + 1] = block[: k % BLOCK + 1].transpose(2, 0, 1)
        if k < len(run.transition):
            now = run.transition[k] @ (now - run.gain[k] @ predicted)
            if middle is not None:
                now[:, pushed] += run.forcing[k] @ middle[:, k].T
            if ahead is not None:
                now[: ahead.shape[2], led] += ahead[:, k].T
    if delta is not None:
        delta[:, order] = now
    return out.transpose(1, 2, 0)


def _stacked(parts: Sequence[np.ndarray | None]) -> tuple[slice | np.ndarray, np.ndarray | None]:
    """Return the places of arrays (n, width) that are there, and these as one (columns, n, width)."""
    there = [x for x in parts if x is not None]
    if not there:
        return slice(0), None
    places = [i for i, x in enumerate(parts) if x is not None]
    close = places[-1] - places[0] == len(places) - 1
    return slice(places[0], places[-1] + 1) if close else np.array(places), np.stack(there)
