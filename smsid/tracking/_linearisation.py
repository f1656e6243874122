"""The models at and about one point: how accelerations and readings change with the parameters followed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from smsid.effects.base import Effect
from smsid.errors import NotIdentifiableError, SmsidError
from smsid.estimation.bias_walk import unit_bias
from smsid.estimation.compiled_filter import (
    ParameterDifference,
    effect_tables,
    inertial_tables,
    with_parameters,
)
from smsid.estimation.filter_pass import CLOSE_SIGMAS, Instance, Moment
from smsid.estimation.measurements import Measurements
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import UnknownForces
from smsid.estimation.sensitivities import DIFFERENCE_STEP
from smsid.kernel.filter_arrays import Drive
from smsid.simulate import Inputs
from smsid.tracking._drive import applied_forces
from smsid.tracking.followed_parameters import Followed, trends_of

LEAST = 0.05  # of its first value, the least mass or spring that a model is built with
MOVED = 0.02  # share by which masses or an effect may change before derivatives by differences are renewed


@dataclass(frozen=True)
class Difference(ParameterDifference):
    """Spacecraft that differ in one parameter. ``drives``: commands act otherwise; ``reads``: sensors do."""

    drives: bool
    reads: bool


class Linearisation:
    """A spacecraft at some values (m,) of the parameters, and its derivatives by each per its scale."""

    def __init__(
        self,
        origin: Point,
        followed: Sequence[Followed],
        values: np.ndarray,
        layout: Measurements,
        locked: np.ndarray,
        before: Linearisation | None = None,
        sigmas: np.ndarray | float = 0.0,
    ) -> None:
        self.unknowns = unknowns = tuple(f.unknown for f in followed)
        self.values = np.array([_buildable(u, x) for u, x in zip(unknowns, values, strict=True)])
        self.scales = np.array([u.scale for u in unknowns])
        self.rates = (np.array([f.rate for f in followed]) / self.scales) ** 2
        self.trends = trends_of(followed)
        self.close = np.array([np.inf if u.kind == "bias" else CLOSE_SIGMAS for u in unknowns])
        self.point = point_at(origin, unknowns, self.values)
        self.base = Instance.at(self.point, layout, locked)
        inertial = [i for i, u in enumerate(unknowns) if u.kind == "inertial"]
        self._inertial = np.array(inertial, dtype=int)
        self._columns = np.array([unknowns[i].column for i in inertial], dtype=int)
        self._data = self.base.model.pin.createData()
        inverse = _inverse_mass(self.base)
        if before is not None and self._like(before, inverse, sigmas):
            self.differences, self._biases, self.renewed = before.differences, before._biases, before.renewed
            self._inverse, self._tables = before._inverse, before._tables
        else:
            self.renewed, self._inverse = self.values, inverse
            self.differences = tuple(
                self._difference(i, layout, locked)
                for i, u in enumerate(unknowns)
                if u.kind in ("effect", "sensor")
            )
            self._biases = self._bias_columns(layout)
            bodies = inertial_tables(self.base, self._columns, self._inertial, self.scales[self._inertial])
            effects = effect_tables(self.differences)
            self._tables = None if bodies is None or effects is None else (bodies, effects)
        self.compiled_tables = None
        if self._tables is not None:
            pushed = [d.index for d in self.differences if d.drives]
            self.compiled_tables = with_parameters(
                self.base,
                self._tables,
                self.scales,
                self.values,
                self.rates,
                self.trends,
                self._biases,
                pushed,
                self.close,
            )

    def _like(self, before: Linearisation, inverse: np.ndarray, sigmas: np.ndarray | float) -> bool:
        """Whether derivatives by differences are still those of ``before``: what a force does has hardly
        changed, nor has any effect by more than is known of it, whatever bodies and biases are called.
        """
        size = np.sqrt(before._inverse.diagonal())
        if (np.abs(inverse - before._inverse) > MOVED * np.outer(size, size)).any():
            return False
        size = [max(abs(u.nominal), u.scale, u.sigma if np.isfinite(u.sigma) else 0.0) for u in self.unknowns]
        off = np.abs(self.values - before.renewed)
        effects = np.array([u.kind in ("effect", "sensor") for u in self.unknowns])
        return bool((off <= np.maximum(MOVED * np.array(size), sigmas))[effects].all())

    @property
    def drives(self) -> bool:
        """Whether how commands act depends on a parameter."""
        return any(d.drives for d in self.differences)

    def _difference(self, i: int, layout: Measurements, locked: np.ndarray) -> Difference:
        u = self.unknowns[i]
        ends = []
        for sign in (-1.0, 1.0):
            value = float(np.clip(self.values[i] + sign * DIFFERENCE_STEP * u.scale, u.lower, u.upper))
            ends.append((value, Instance.at(point_at(self.point, [u], [value]), layout, locked)))
        (less, low), (more, high) = ends
        if low.model.nv != high.model.nv or low.model.nv != self.base.model.nv:
            raise NotIdentifiableError(
                f"'{u.name}' changes how many degrees of freedom there are.", advice="Hold it.", name=u.name
            )
        drives = False
        if u.kind == "effect":
            effect = self.point.description.get_effect(u.name.partition(".")[0])
            drives = type(effect).drive is not Effect.drive
        return Difference(i, low, high, u.scale / (more - less), drives, _reads(low, high))

    def _bias_columns(self, layout: Measurements) -> np.ndarray:
        """Return how readings change with biases (rows, m), per scale."""
        out = np.zeros((layout.rows, len(self.unknowns)))
        for i, u in enumerate(self.unknowns):
            if u.kind == "bias":
                channel = u.name.partition(".bias.")[0]
                for block in layout.blocks:
                    if block.channel == channel:
                        out[:, i] = unit_bias(block, u.column, layout.rows) * u.scale
        return out

    def drive(
        self,
        inputs: Inputs,
        edges: np.ndarray,
        substep: float,
        before: np.ndarray | None,
        unknown: UnknownForces,
        noise: np.ndarray,
    ) -> Drive:
        """Return the applied forces between edges (n + 1,) [s] and at them; ``before`` (nv,) those earlier.

        ``noise`` (nv,) are variances of what is held.
        """
        own = applied_forces(self.base.plant, inputs, edges, substep)
        shape = (sum(d.drives for d in self.differences), len(own.at[0]))
        at, middle = np.zeros((len(own.at), *shape)), np.zeros((len(own.middle), *shape))
        for k, d in enumerate(d for d in self.differences if d.drives):
            low, high = (applied_forces(x.plant, inputs, edges, substep) for x in (d.low, d.high))
            at[:, k] = d.factor * (high.at - low.at)
            middle[:, k] = d.factor * (high.middle - low.middle)
        return replace(own, before=before).drive(unknown, noise, at, middle)

    def accelerations(self, moment: Moment, push: np.ndarray) -> np.ndarray:
        """Return how accelerations change with the parameters (nv, m), per scale.

        Applied forces change by ``push`` (d, nv) with those parameters that drive.
        """
        m = moment
        out = np.zeros((self.base.model.nv, len(self.unknowns)))
        if len(self._columns):
            y = pin.computeJointTorqueRegressor(self.base.model.pin, self._data, m.q, m.v, m.a)
            out[:, self._inertial] = -(m.inverse @ y[:, self._columns]) * self.scales[self._inertial]
        for d in self.differences:
            change = d.high.plant.acceleration(m.time, m.q, m.v, m.tau)
            change = change - d.low.plant.acceleration(m.time, m.q, m.v, m.tau)
            out[:, d.index] = change * d.factor
        for x, d in zip(push, (d for d in self.differences if d.drives), strict=True):
            out[:, d.index] += m.inverse @ x
        return out

    def readings(self, moment: Moment, forces: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Return how readings at fixed motion change with the parameters (rows, m), per scale."""
        out = self._biases.copy()
        for d in self.differences:
            if d.reads:
                high, low = (x.predict(moment, forces, self.base.plant)[0] for x in (d.high, d.low))
                out[:, d.index] = (high - low) * d.factor
        return out


def _inverse_mass(of: Instance) -> np.ndarray:
    """Return the inverse mass matrix (nv, nv) at home."""
    upper = np.triu(pin.computeMinverse(of.plant.pin, of.plant.data, of.model.home))
    return upper + np.triu(upper, 1).T


def point_at(origin: Point, unknowns: Sequence[Unknown], values: Sequence[float] | np.ndarray) -> Point:
    """Return a point with these values (m,) of parameters; which way led there does not matter."""
    inertial, biases = dict(origin.inertial), dict(origin.biases)
    by_effect: dict[str, dict[str, float]] = {}
    for u, value in zip(unknowns, map(float, values), strict=True):
        if u.kind == "trend":
            continue
        if u.kind == "inertial":
            inertial[u.column] = value - float(origin.whole[u.column])
        elif u.of_recording:
            biases[u.name] = value
        else:
            by_effect.setdefault(u.name.partition(".")[0], {})[u.name] = value
    description = origin.description
    if by_effect:
        changed = [description.get_effect(name).with_values(v) for name, v in by_effect.items()]
        description = description.with_effects(*changed)
    return replace(origin, description=description, inertial=inertial, biases=biases)


def can_exist(linearisation: Linearisation) -> bool:
    """Whether masses are positive and the whole mass matrix is, at home."""
    try:
        return linearisation.point.physical()
    except SmsidError:
        return False


def _buildable(unknown: Unknown, value: float) -> float:
    low = LEAST * unknown.nominal if unknown.positive else unknown.lower
    return float(np.clip(value, max(low, unknown.lower), unknown.upper))


def _reads(low: Instance, high: Instance) -> bool:
    """Whether the sensors of two spacecraft read the same motion otherwise."""
    a, b = low.model, high.model
    for x, y in zip(a.appendages, b.appendages, strict=True):
        if not np.array_equal(x.scale, y.scale) or x.appendage != y.appendage or x.drawn is not y.drawn:
            return True
        if x.more != y.more:
            return True
    for x, y in zip(low.outputs.data.blocks, high.outputs.data.blocks, strict=True):
        if x.delay != y.delay or not np.array_equal(x.gain, y.gain) or not np.array_equal(x.bias, y.bias):
            return True
        if str(x.later) != str(y.later) or str(x.bend) != str(y.bend):
            return True
    return a.twists != b.twists
