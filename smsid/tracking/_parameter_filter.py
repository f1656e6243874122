"""Extended Kalman filter with parameters in its state, some moments at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from smsid.errors import SmsidError
from smsid.estimation.filter_pass import filter_samples, reference, shift
from smsid.estimation.measurements import Measurements
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Belief, CommandTiming, UnknownInput, unknown_forces, unknown_sigmas
from smsid.kernel.filter_arrays import Drive, Record, Samples, State
from smsid.simulate import Inputs
from smsid.tracking._linearisation import Linearisation, can_exist
from smsid.tracking.followed_parameters import Followed

RELINEARISE = 0.3  # standard deviations by which parameters may move before models are built anew
BETTER = 0.7  # of how well the point of the models is known: what is believed is then a better one
FAR = 4.0  # standard deviations by which the models are too far, however well their point was known
BEGINNING = 30.0  # [s] that are filtered again, as the models move
GROWN = 2.0, 1.25  # times as much as was filtered again before, from which it is done once more; with trends
SMOOTHINGS, SETTLED = 3, 0.01  # of where the motion began; chi square by which it may still move
STRETCH = 1.0  # [s] in which a trend moves models by little, where a beginning is filtered again
NEGLIGIBLE = 1e-6  # of a parameter's size: nothing is built anew for less


@dataclass(eq=False)
class ParameterFilter:
    """What is believed of motion, unknown inputs and parameters, and how it goes on.

    ``q`` (nq,), ``v`` (nv,), ``unknown`` inputs and their rates (k,), ``values`` (m,) of parameters at
    ``time`` [s]; ``covariance`` (x, x) of the tangent of q, of v, of these, and of parameters over their
    scales.
    ``input_noise`` (nv,) are variances of errors of applied forces, held over a step.
    """

    origin: Point
    followed: tuple[Followed, ...]
    layout: Measurements
    locked: np.ndarray
    unknown_inputs: Sequence[UnknownInput]
    timing: CommandTiming
    input_noise: np.ndarray
    time: float
    q: np.ndarray
    v: np.ndarray
    unknown: np.ndarray
    values: np.ndarray
    covariance: np.ndarray
    at: Linearisation = field(init=False)
    last: tuple = field(init=False, default=())  # what `go_on` was given, and what was commanded
    commanded: tuple = field(init=False, default=())

    def __post_init__(self) -> None:
        self._unknowns = tuple(f.unknown for f in self.followed)
        self.scales = np.array([u.scale for u in self._unknowns])
        self._rates = np.array([f.rate for f in self.followed]) / self.scales
        self.forces = unknown_forces(self.unknown_inputs, self.timing)
        self._variance = self.layout.sigma**2
        self._bends = np.array([u.kind not in ("bias", "trend") for u in self._unknowns])
        names = [n for e in self.origin.description.effect for n in e.lasting_joints()]
        tree = self.origin.base.pin
        self._lasting = [tree.joints[tree.getJointId(n)].idx_v for n in names]
        self.at = Linearisation(self.origin, self.followed, self.values, self.layout, self.locked)
        self.known_at = self.sigmas()
        self.rebuilt = 0
        self.refiltered: tuple[np.ndarray, np.ndarray] | None = None  # about which values, and `offset`
        self.forget_beginning()

    @property
    def nv(self) -> int:
        """Degrees of freedom."""
        return len(self.v)

    @property
    def parameters(self) -> slice:
        """Where parameters stand in the state."""
        return slice(2 * self.nv + len(self.unknown), None)

    def begin(self, belief: Belief, time: float) -> None:
        """Begin the motion anew; of the parameters, what is known stays and wanders until ``time`` [s]."""
        own = self.covariance[self.parameters, self.parameters].copy()
        passed, (pairs, steep), move = max(0.0, time - self.time), self.at.trends, np.eye(len(own))
        if len(pairs) and np.isfinite(passed):
            move[pairs[:, 0], pairs[:, 1]] = passed * steep
            self.values = self.values.copy()
            self.values[pairs[:, 0]] += passed * self.values[pairs[:, 1]]
            own = move @ own @ move.T
        own.flat[:: len(own) + 1] += self._rates**2 * passed
        sigma = unknown_sigmas(self.unknown_inputs)
        nv, k = len(belief.v), len(sigma)
        p = np.zeros((2 * nv + k + len(own),) * 2)
        p[: 2 * nv, : 2 * nv] = belief.covariance
        p[2 * nv : 2 * nv + k, 2 * nv : 2 * nv + k] = np.diag(sigma**2)
        p[2 * nv + k :, 2 * nv + k :] = own
        v = belief.v.copy()
        for i in self._lasting:
            v[i], p[nv + i, nv + i] = self.v[i], self.covariance[nv + i, nv + i]
        self.q, self.v, self.unknown = belief.q.copy(), v, np.zeros(k)
        self.covariance, self.time = p, time
        self.forget_beginning()
        self.begun = copy(self)

    def linearise_at(self, values: np.ndarray, sigmas: np.ndarray) -> None:
        """Take models at values (m,) known within ``sigmas`` (m,), whatever is believed yet.

        What is believed stays; only about which point the filter is linear changes.
        """
        self.at = Linearisation(self.origin, self.followed, values, self.layout, self.locked)
        self.known_at = np.asarray(sigmas, dtype=float)

    def relinearise(self) -> bool:
        """Build the models anew where parameters have moved far; return whether they were.

        Not while the point that the models are at is known better than what is believed.
        """
        if self.begun is not None and self.time > self.begun.time + BEGINNING:
            self._begin_again()
            self.forget_beginning()
        off = np.abs(self.values - self.at.values)
        sigma = self.sigmas()
        moved = off > np.maximum(RELINEARISE * sigma, NEGLIGIBLE * self.scales)
        moved &= (sigma <= BETTER * self.known_at) | (off > FAR * sigma)
        if not np.any(moved & self._bends):
            return False
        share = 1.0
        for _ in range(6):  # where no such spacecraft can be, go only part of the way
            values = self.at.values + share * (self.values - self.at.values)
            try:
                found = Linearisation(
                    self.origin, self.followed, values, self.layout, self.locked, self.at, sigma
                )
            except SmsidError:
                share *= 0.5
                continue
            if can_exist(found):
                if np.array_equal(found.values, self.at.values):
                    return False
                self.at, self.rebuilt, self.known_at = found, self.rebuilt + 1, sigma
                self.moved, grown = True, GROWN[len(self.at.trends[0]) > 0]
                if self.begun is not None and self.time - self.begun.time >= grown * self.again:
                    self._begin_again()
                return True
            share *= 0.5
        return False

    def _begin_again(self) -> None:
        """Filter the beginning once more, linear about where the models are now, if they have moved.

        And about where the motion began, as all that was read since says (an iterated smoother): linear about
        another slosh, say, than at the next sample, a filter takes the difference for knowledge.
        """
        if self.begun is None or not self.moved:
            return
        self.again, self.moved = self.time - self.begun.time, False
        for _ in range(SMOOTHINGS):
            begun = copy(self.begun)
            begun.at = self._models_then(begun.time)
            nv, n = self.nv, 2 * self.nv
            begun.q = pin.integrate(self.at.base.plant.pin, begun.q, self.offset[:nv])
            begun.v = begun.v + self.offset[nv:]
            try:
                end, change, score, information = begun._follow_passes(self.since, self._models_then)
            except SmsidError:
                return  # lost about this point: the filter goes on as it is
            shift(self.at.base.plant.pin, self.at, end, -change @ self.offset)
            moved = self.begun.covariance[:n, :n] @ (score + information @ self.offset) - self.offset
            self._take(end)
            self.offset = self.offset + moved
            self.refiltered = self.at.values, self.offset
            if moved @ information @ moved < SETTLED:
                return

    def _models_then(self, time: float) -> Linearisation:
        """Return the models at the values that trends, as believed now, say of an earlier time [s]."""
        pairs = self.at.trends[0]
        if not len(pairs):
            return self.at
        values = self.at.values.copy()
        values[pairs[:, 0]] += self.values[pairs[:, 1]] * (time - self.time)
        return Linearisation(
            self.origin, self.followed, values, self.layout, self.locked, self.at, self.sigmas()
        )

    def _follow_passes(
        self, passes: Sequence[tuple], models: Callable[[float], Linearisation]
    ) -> tuple[State, np.ndarray, np.ndarray, np.ndarray]:
        """Return where passes lead, how that changes with the motion where they begin (x, 2 nv), and score
        (2 nv,) and information (2 nv, 2 nv) of what was read by that motion. ``models`` are those of a time.
        """
        n, built = 2 * self.nv, self.time
        change, score, information = np.eye(len(self.covariance))[:, :n], np.zeros(n), np.zeros((n, n))
        for edges, drive, values, attitudes, commanded in passes:
            if len(self.at.trends[0]) and edges[-1] > built + STRETCH:
                built, self.at = float(edges[-1]), models(float(edges[-1]))
            if self.at.drives:
                drive = self.drive(commanded[0], commanded[1], edges, drive.before[0])
            record = self.go_on(edges, drive, values, attitudes)
            for k, there in enumerate(np.isfinite(values).any(axis=1)):
                if k:
                    change = record.transition[k - 1] @ change
                if there:
                    seen = record.sensitivity[k] @ change
                    signature = record.whitening[k] @ seen
                    score += signature.T @ record.innovations[k]
                    information += signature.T @ signature
                    change = change - record.gain[k] @ seen
        return self._state(), change, score, information

    def forget_beginning(self) -> None:
        """Go on without filtering the beginning again."""
        self.begun: ParameterFilter | None = None  # as the motion began, and what it was given since
        self.since: list[tuple] = []
        self.again, self.moved = 0.0, False  # [s] of it that were filtered again
        self.offset = np.zeros(2 * self.nv)  # of the motion where it began, by what was read since

    def uncertain_within(self, jump: np.ndarray, passed: tuple) -> None:
        """Add what a jump (m,) of parameters at any time in a step does to the motion; the step is ``passed``
        as `go_on` takes it.
        """
        moved = np.zeros(len(self.covariance))
        moved[self.parameters] = jump / self.scales
        for change in self.snapshot().go_on(*passed).transition:
            moved = change @ moved
        moved[2 * self.nv :] = 0.0
        self.covariance = self.covariance + np.outer(moved, moved)

    def snapshot(self) -> ParameterFilter:
        """Return the filter as it is now, to go its own way."""
        other = copy(self)  # arrays are replaced, not changed
        other.forget_beginning()
        return other

    def drive(
        self, inputs: Inputs, substep: float, edges: np.ndarray, before: np.ndarray | None = None
    ) -> Drive:
        """Return what drives the motion between edges (n + 1,) [s]; ``before`` (nv,) are forces earlier."""
        self.commanded = inputs, substep
        return self.at.drive(inputs, edges, substep, before, self.forces, self.input_noise)

    def go_on(self, edges: np.ndarray, drive: Drive, values: np.ndarray, attitudes: np.ndarray) -> Record:
        """Go through ``edges`` (n,) [s], from where it is, and take in what was read at them.

        ``values`` (n, rows) are NaN where there is nothing, ``attitudes`` (n, a, 4) zero; rows of an attitude
        that is there are zero. Raises `SimulationError` when the motion is lost, and nothing is changed then.
        """
        now = self._state()
        there, rows = np.isfinite(values), np.arange(values.shape[1])
        samples = Samples(edges, values, attitudes, there, self._variance, len(edges), rows)
        record = filter_samples(self.at.base, self.at, self.at.compiled_tables, drive, now, samples)
        self._take(now)
        self.time, self.last = float(edges[-1]), (edges, drive, values, attitudes, self.commanded)
        if self.begun is not None:
            self.since.append(self.last)
        return record

    def reference_offset(self) -> np.ndarray:
        """Return how far what is believed is from where the filter is linear (x,)."""
        return reference(self.at.base.plant, self.at, self._state(), self.forces.acts, self.forces.sloped)[0]

    def _state(self) -> State:
        """Return what is believed, to be changed."""
        q, v, unknown, values = (x.copy() for x in (self.q, self.v, self.unknown, self.values))
        return State(q, v, unknown, values, np.array(self.covariance, order="C"))

    def _take(self, now: State) -> None:
        self.q, self.v, self.unknown, self.values, self.covariance = now

    def sigmas(self) -> np.ndarray:
        """Return standard deviations of the parameters (m,), in their units."""
        return self.scales * np.sqrt(self.covariance.diagonal()[self.parameters])

    def parameter_covariance(self) -> np.ndarray:
        """Return the covariance of the parameters (m, m), in their units."""
        return self.covariance[self.parameters, self.parameters] * np.outer(self.scales, self.scales)
