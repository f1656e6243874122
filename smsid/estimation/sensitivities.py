"""How accelerations and readings change with a parameter, along the states a filter found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import EllipsisType

import numpy as np
import pinocchio as pin

from smsid.effects.base import Effect
from smsid.errors import NotIdentifiableError
from smsid.estimation._measurement_model import MeasurementModel
from smsid.estimation.bias_walk import unit_bias
from smsid.estimation.filter_pass import AppliedForces, compiled_pays
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.kalman import applied_forces, driving_forces
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Problem
from smsid.estimation.process_model import ProcessModel
from smsid.inputs.signals import Signal
from smsid.kernel.arrays import Kernel
from smsid.kernel.derivatives import forces_along, passive_along
from smsid.kernel.filter import steps_ahead
from smsid.kernel.sensitivities import carry
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate.trajectory import States

LOOK_BACK = 1e-4  # [s] how far back a reading is compared for its rate
DIFFERENCE_STEP = 1e-4  # step of a difference, in scales of the parameter
LEAST_STEP = 0.01  # share of a parameter's value: with steps of far less a difference is of rounding
Places = np.ndarray | EllipsisType  # which of several; ... are all
Entries = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives by one parameter: of generalised forces between samples (N - 1, k) and at them (N, k), on
    the degrees of freedom ``dofs`` (k,), and of the readings ``rows`` (j,) at fixed motion (N, j); ``None``
    where there is none. ``ahead`` (N - 1, 2 nv or more), tangent and rates, then further states as they come,
    is of the state at the next sample, where what happens within the way there is not held.
    """

    middle: np.ndarray | None = None
    at: np.ndarray | None = None
    reading: np.ndarray | None = None
    ahead: np.ndarray | None = None
    dofs: Places = ...
    rows: Places = ...

    @classmethod
    def on(cls, dof: int, middle: np.ndarray, at: np.ndarray) -> Sensitivity:
        """Return the change by a force on one degree of freedom, ``middle`` (N - 1,) and ``at`` (N,)."""
        return cls(middle[:, None], at[:, None], dofs=np.array([dof]))

    @classmethod
    def of(
        cls,
        forces: tuple[np.ndarray, np.ndarray] | None = None,
        reading: np.ndarray | None = None,
        ahead: np.ndarray | None = None,
    ) -> Sensitivity:
        """Return the change by forces (N - 1, nv) and (N, nv), a ``reading`` (N, rows) and the state
        ``ahead`` (N - 1, 2 nv), without forces and readings that do not change.
        """
        found = cls(ahead=ahead)
        if forces is not None:
            dofs = np.flatnonzero(forces[0].any(axis=0) | forces[1].any(axis=0))
            if len(dofs):
                found = replace(found, middle=forces[0][:, dofs], at=forces[1][:, dofs], dofs=dofs)
        if reading is not None:
            rows = np.flatnonzero(reading.any(axis=0))
            found = replace(found, reading=reading[:, rows], rows=rows)
        return found

    def weighted(self, between: float | np.ndarray, at: float | np.ndarray) -> Sensitivity:
        """Return it times factors between samples and at them: numbers, or (N - 1, 1) and (N, 1)."""

        def product(x: np.ndarray | None, factor: float | np.ndarray) -> np.ndarray | None:
            return None if x is None else x * factor

        forces = product(self.middle, between), product(self.at, at)
        return Sensitivity(
            *forces, product(self.reading, at), product(self.ahead, between), self.dofs, self.rows
        )

    def times(self, factor: float) -> Sensitivity:
        """Return it ``factor`` times."""
        return self.weighted(factor, factor)


class Sensitivities:
    """Changes by any parameter at a point, along a run of the filter there.

    ``forces`` are those of its `KalmanFilter` over time, where there is one: they are made again if not.
    """

    def __init__(
        self,
        point: Point,
        model: SpacecraftModel,
        problem: Problem,
        run: FilterRun,
        forces: Signal | None = None,
    ) -> None:
        self.point, self.model, self.problem, self.run = point, model, problem, run
        self.outputs = MeasurementModel(model, problem.data, problem.locked)
        self.sensors = point.sensors()
        self.inputs = problem.inputs(model)
        self.driving = driving_forces(model, self.inputs) if forces is None else forces
        self.applied = self._applied_forces(model)
        self._rates: np.ndarray | None = None
        self._regressors: dict[int, Sensitivity] = {}
        self._own: dict[tuple[str, bool], np.ndarray] = {}
        self._whole: list[Kernel | None] = []
        self._own_ahead: tuple[np.ndarray, np.ndarray] | None = None
        self.by_candidate: dict[tuple[object, ...], list[Sensitivity]] = {}  # what is scored is scored again

    def inertial(self, columns: Sequence[int]) -> list[Sensitivity]:
        """Return the changes by inertial parameters, ten per body: -Y."""
        known = self._regressors
        if not set(columns) <= known.keys():  # then of all: asked for once more, others will be
            wanted = range(10 * (self.model.pin.njoints - 1)) if known else columns
            both = (self._regressor(where, wanted) for where in ("middle", "at"))
            known.update({i: Sensitivity(*x) for i, *x in zip(wanted, *both, strict=True)})
        return [known[i] for i in columns]

    def _regressor(self, where: str, columns: Sequence[int]) -> np.ndarray:
        """Return columns of -Y' along the run (k, N, nv)."""
        states, data, some = self._states(where), self.model.pin.createData(), np.array(columns)
        y = np.empty((len(some), len(states.time), self.model.nv))
        for k, (q, v, a) in enumerate(zip(states.q, states.v, states.a, strict=True)):
            np.negative(pin.computeJointTorqueRegressor(self.model.pin, data, q, v, a).T[some], out=y[:, k])
        return y

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
        pushed = None
        if forces or cls.drive is not Effect.drive:
            pushed = (
                self._less_taken(origin, model)
                if forces
                else [np.zeros_like(s.tau) for s in (self.run.middle, self.run.states)]
            )
            if cls.drive is not Effect.drive:
                new, old = (
                    self._applied_forces(model),
                    self._applied_forces(origin) if known else self.applied,
                )
                pushed[0] += new.middle - old.middle
                pushed[1] += (new.at - old.at)[: len(pushed[1])]
            pushed = pushed[0] / step, pushed[1] / step
        adjusts = cls.adjust is not Effect.adjust or cls.resolved is not Effect.resolved
        reading = self._reading_change(base, other if adjusts else base, origin, model)
        found = Sensitivity.of(pushed, None if reading is None else reading / step)
        if forces and changed.has_fast_dynamics():
            return replace(found, middle=None, ahead=self._difference_ahead(origin, model) / step)
        return found

    def _difference_ahead(self, origin: SpacecraftModel, model: SpacecraftModel) -> np.ndarray:
        """Return by how much the state at the next sample (N - 1, 2 nv) differs in another model."""
        if origin is self.model:
            self._own_ahead = here = self._own_ahead or self._state_ahead(origin)
        else:
            here = self._state_ahead(origin)
        (q, v), (other_q, other_v) = here, self._state_ahead(model)
        turned = [pin.difference(self.model.pin, *x) for x in zip(q, other_q, strict=True)]
        return np.hstack([np.array(turned).reshape(v.shape), other_v - v])

    def _state_ahead(self, model: SpacecraftModel) -> tuple[np.ndarray, np.ndarray]:
        """Return q (N - 1, nq) and v (N - 1, nv) at the next sample, from where each sample left them."""
        run, moves, nv = self.run, len(self.run.transition), self.model.nv
        step = np.einsum("nij,nj->ni", run.gain[:moves], run.errors[:moves])
        here = zip(run.states.q[:moves], step[:, :nv], strict=True)
        q = np.array([pin.integrate(self.model.pin, *x) for x in here]).reshape(moves, self.model.nq)
        v = run.states.v[:moves] + step[:, nv : 2 * nv]
        own = self._applied_forces(model)
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

    def _applied_forces(self, model: SpacecraftModel) -> AppliedForces:
        process = ProcessModel(model, self.problem.locked)
        forces = self.driving if model is self.model else driving_forces(model, self.inputs)
        return applied_forces(process, self.problem, forces, self.run.edges)

    def bias(self, unknown: Unknown) -> Sensitivity:
        """Return the change by the bias of one component, along the sensor's own axes, of a channel."""
        channel, rows = ".".join(unknown.name.split(".")[:2]), self.problem.data.rows
        reading = np.zeros((len(self.run.states.time), rows))
        for block in self.problem.data.blocks:
            if block.channel == channel:
                reading[:] = unit_bias(block, unknown.column, rows)
        return Sensitivity.of(reading=reading)

    def sensor(self, unknown: Unknown) -> Sensitivity:
        """Return the change by another error of a sensor in this recording, by a difference."""
        step = DIFFERENCE_STEP * unknown.scale
        other = self.point.moved([unknown], np.array([step]))
        reading = self._reading_change(self.point, other, self.model, self.model)
        return Sensitivity.of(reading=None if reading is None else reading / step)

    def unknown(self, unknown: Unknown) -> Sensitivity:
        """Return the change by a parameter of an effect the point has, by a difference."""
        value, owner = self.point.value(unknown), unknown.name.partition(".")[0]
        step = DIFFERENCE_STEP * max(unknown.scale, LEAST_STEP * abs(value))
        step = step if value + step <= unknown.upper else -step
        mine, more = (
            p.description.get_effect(owner)
            for p in (self.point, self.point.moved([unknown], np.array([step])))
        )
        return self.effect(mine, more, step)

    def readings(self) -> np.ndarray:
        """Return what is read along the run (N, rows)."""
        return self.outputs.all(self.run.states)

    def rates(self) -> np.ndarray:
        """Return time derivatives of the readings (N, rows) between jumps of the commands, for delays."""
        if self._rates is None:
            s, plant = self.run.states, ProcessModel(self.model, self.problem.locked)
            q, v, a = np.empty_like(s.q), s.v - LOOK_BACK * s.a, np.empty_like(s.a)
            for k, (t, tau) in enumerate(zip(s.time, s.tau, strict=True)):
                q[k] = pin.integrate(self.model.pin, s.q[k], -LOOK_BACK * s.v[k])
                a[k] = plant.acceleration(float(t) - LOOK_BACK, q[k], v[k], tau)
            before = States(s.time, q, v, a, s.tau, s.reaction)
            rates = (self.outputs.all(s) - self.outputs.all(before)) / LOOK_BACK
            for block in self.problem.data.blocks:
                if block.quantity == "attitude":
                    rates[:, block.rows] = s.v[:, 3:6]
            self._rates = rates
        return self._rates

    def _less_taken(self, origin: SpacecraftModel, model: SpacecraftModel) -> list[np.ndarray]:
        """Return the generalised forces that the motion takes less in a model than in another, between
        samples (N - 1, nv) and at them (N, nv).
        """
        kernels = [self._kernel(m) for m in (origin, model)]
        one, other = kernels
        alike = one is not None and other is not None and one.moves_like(other)
        each = list(zip((origin, model), kernels, strict=True))
        parts = [[self._motion_forces(where, *x, passive=alike) for x in each] for where in ("middle", "at")]
        return [before - after for before, after in parts]

    def _kernel(self, model: SpacecraftModel) -> Kernel | None:
        """Return what compiled code takes of a model, nothing held still; of its own, once."""
        if model is self.model and self._whole:
            return self._whole[0]
        held = np.zeros(0, dtype=int)
        found = ProcessModel(model, held).kernel(balanced=False) if compiled_pays() else None
        if model is self.model:
            self._whole.append(found)
        return found

    def _motion_forces(
        self, where: str, model: SpacecraftModel, kernel: Kernel | None, *, passive: bool
    ) -> np.ndarray:
        """Return the generalised forces (N, nv) that a model's motion takes along the run, or their
        ``passive`` part that inertia has none in; its own, once.
        """
        known = where, passive
        if model is self.model and known in self._own:
            return self._own[known]
        s = self._states(where)
        found = np.empty((len(s.time), model.nv))
        if kernel is None:
            _forces_along(model, s, found)
        elif passive:
            passive_along(*kernel.arrays, s.time, s.q, s.v, s.tau, found)
        else:
            forces_along(*kernel.arrays, s.time, s.q, s.v, s.a, s.tau, found)
        if model is self.model:
            self._own[known] = found
        return found

    def _reading_change(
        self, base: Point, other: Point, origin: SpacecraftModel, model: SpacecraftModel
    ) -> np.ndarray | None:
        before = self.sensors if base is self.point else base.sensors()
        after = before if other is base else other.sensors()
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
    (n, rows, nv), width, m = run.by_a.shape, run.gain.shape[1], len(changes)
    moves = len(run.transition)
    between = _stack_changes([(c.middle, c.dofs) for c in changes], moves, nv)
    at = _stack_changes([(c.at, c.dofs) for c in changes], n, nv)
    read = _stack_changes([(c.reading, c.rows) for c in changes], n, rows)
    ahead = [c.ahead for c in changes]
    led = _stack_changes([(a, ... if a is None else np.arange(a.shape[1])) for a in ahead], moves, width)
    now: np.ndarray = np.zeros((m, width)) if delta is None else np.ascontiguousarray(delta.T)
    out = np.empty((m, n, rows))
    filtered = (
        run.whitening, run.sensitivity, run.gain, run.transition, run.forcing, run.by_a, run.inverse,
        run.middle_inverse,
    )  # fmt: skip
    take = carry if compiled_pays() else _carry
    take(filtered, between, at, read, led, now, out)
    if delta is not None:
        delta[:] = now.T
    return out.transpose(1, 2, 0)


def _carry(
    filtered: tuple[np.ndarray, ...], between: Entries, at: Entries, read: Entries, led: Entries,
    now: np.ndarray, out: np.ndarray,
) -> None:  # fmt: skip
    """Do what `smsid.kernel.sensitivities.carry` does."""
    whitening, sensitivity, gain, transition, forcing, by_a, inverse, middle_inverse = filtered

    def placed(entries: Entries, k: int, count: int) -> np.ndarray:
        whole = np.zeros((count, len(now)))
        whole[entries[2], entries[1]] = entries[0][k]
        return whole

    state, (n, rows, nv) = now.T.copy(), by_a.shape
    for k in range(n):
        predicted = sensitivity[k] @ state + by_a[k] @ inverse[k] @ placed(at, k, nv) + placed(read, k, rows)
        out[:, k] = (whitening[k] @ predicted).T
        if k < len(transition):
            state = transition[k] @ (state - gain[k] @ predicted)
            state += forcing[k] @ middle_inverse[k] @ placed(between, k, nv) + placed(led, k, len(state))
    now[:] = state.T


def _stack_changes(parts: Sequence[tuple[np.ndarray | None, Places]], count: int, width: int) -> Entries:
    """Return changes side by side: values (``count``, e), their columns (e,) and places (e,) of ``width``."""
    there = [(i, x, np.arange(width)[where]) for i, (x, where) in enumerate(parts) if x is not None]
    if not there:
        return np.zeros((count, 0)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    return (
        np.concatenate([x for _, x, _ in there], axis=1),
        np.repeat([i for i, *_ in there], [len(where) for *_, where in there]),
        np.concatenate([where for *_, where in there]),
    )
