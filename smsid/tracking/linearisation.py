"""The models at and about one point: how accelerations and readings change with the parameters followed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from smsid.effects.base import Effect
from smsid.errors import NotIdentifiableError, SmsidError
from smsid.estimation.kalman import Applied, _delayed
from smsid.estimation.measurement_model import MeasurementModel
from smsid.estimation.measurements import Measured
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.process_model import ProcessModel
from smsid.estimation.sensitivities import DIFFERENCE
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate import Inputs
from smsid.tracking.drive import applied_forces

LEAST = 0.05  # of its first value, the least mass or spring that a model is built with
MOVED = 0.02  # share by which masses or an effect may change before derivatives by differences are renewed


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
    def at(cls, point: Point, layout: Measured, locked: np.ndarray) -> Instance:
        """Return the spacecraft at a point, degrees of freedom ``locked`` (k,) held still.

        Raises `DescriptionError` where there can be none.
        """
        model = point.model()
        data = layout.with_blocks(point.sensors())
        late = np.array([b.delay for b in data.blocks])
        return cls(model, ProcessModel(model, locked), MeasurementModel(model, data, locked), late)

    def predict(
        self, m: Moment, forces: tuple[np.ndarray, np.ndarray], plant: ProcessModel
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return what sensors read (rows,), and its derivatives by q, v and a (rows, nv).

        ``forces`` are those just before and just after the sample, for sensors that are late.
        """
        if self.late.any():
            found = _delayed(self.outputs, self.late, m.time, (m.q, m.v), m.a, forces, plant)
        else:
            found = self.outputs.predict(m.q, m.v, m.a)
        self.outputs.twisted(found[0], m.time, m.q, m.v, m.tau, m.a)
        return found


@dataclass(frozen=True)
class Difference:
    """Two spacecraft that differ in one parameter alone: where it stands among those followed, and by how
    much it differs. ``drives``: commands act otherwise; ``reads``: sensors do.
    """

    index: int
    low: Instance
    high: Instance
    width: float
    drives: bool
    reads: bool


@dataclass(frozen=True)
class Driven:
    """Applied forces over some samples: of the model, and of the two of each parameter that changes them."""

    base: Applied
    pairs: dict[int, tuple[Applied, Applied]]


class Linearisation:
    """A spacecraft at some values (m,) of the parameters, and its derivatives by each per its scale."""

    def __init__(
        self,
        origin: Point,
        unknowns: Sequence[Unknown],
        values: np.ndarray,
        layout: Measured,
        locked: np.ndarray,
        before: Linearisation | None = None,
    ) -> None:
        self.unknowns = tuple(unknowns)
        self.values = np.array([_buildable(u, x) for u, x in zip(unknowns, values, strict=True)])
        self.scales = np.array([u.scale for u in unknowns])
        self.point = point_at(origin, unknowns, self.values)
        self.base = Instance.at(self.point, layout, locked)
        inertial = [i for i, u in enumerate(unknowns) if u.kind == "inertial"]
        self._inertial = np.array(inertial, dtype=int)
        self._columns = np.array([unknowns[i].column for i in inertial], dtype=int)
        self._data = self.base.model.pin.createData()
        inverse = _inverse_mass(self.base)
        if before is not None and self._like(before, inverse):
            self.differences, self._biases, self.renewed = before.differences, before._biases, before.renewed
            self._inverse = before._inverse
        else:
            self.renewed, self._inverse = self.values, inverse
            self.differences = tuple(
                self._difference(i, origin, layout, locked)
                for i, u in enumerate(unknowns)
                if u.kind == "effect"
            )
            self._biases = self._bias_columns(layout)

    def _like(self, before: Linearisation, inverse: np.ndarray) -> bool:
        """Whether derivatives by differences are still those of ``before``: what a force does has hardly
        changed, nor has any effect, whatever bodies and biases are called.
        """
        size = np.sqrt(before._inverse.diagonal())
        if (np.abs(inverse - before._inverse) > MOVED * np.outer(size, size)).any():
            return False
        return all(
            abs(now - then) <= MOVED * max(abs(u.nominal), u.scale, u.sigma if np.isfinite(u.sigma) else 0.0)
            for u, now, then in zip(self.unknowns, self.values, before.renewed, strict=True)
            if u.kind == "effect"
        )

    @property
    def drives(self) -> bool:
        """Whether how commands act depends on a parameter."""
        return any(d.drives for d in self.differences)

    def _difference(self, i: int, origin: Point, layout: Measured, locked: np.ndarray) -> Difference:
        u = self.unknowns[i]
        ends = []
        for sign in (-1.0, 1.0):
            values = self.values.copy()
            values[i] = float(np.clip(values[i] + sign * DIFFERENCE * u.scale, u.lower, u.upper))
            ends.append((values[i], Instance.at(point_at(origin, self.unknowns, values), layout, locked)))
        (less, low), (more, high) = ends
        if low.model.nv != high.model.nv or low.model.nv != self.base.model.nv:
            raise NotIdentifiableError(
                f"'{u.name}' changes how many degrees of freedom there are.", advice="Hold it.", name=u.name
            )
        effect = self.point.description.get_effect(u.name.partition(".")[0])
        drives = type(effect).drive is not Effect.drive
        return Difference(i, low, high, more - less, drives, _reads(low, high))

    def _bias_columns(self, layout: Measured) -> np.ndarray:
        """Return how readings change with biases (rows, m), per scale."""
        out = np.zeros((layout.rows, len(self.unknowns)))
        for i, u in enumerate(self.unknowns):
            if u.kind == "bias":
                channel = u.name.rsplit(".bias.", 1)[0]
                for block in layout.blocks:
                    if block.channel == channel:  # the bias is along the sensor's own axes
                        turned = any(block.sensor.orientation)
                        axis = block.sensor.rotation[:, u.column] if turned else np.eye(3)[u.column]
                        out[block.rows, i] = axis * u.scale
        return out

    def drive(self, inputs: Inputs, edges: np.ndarray, substep: float) -> Driven:
        """Return the applied forces between edges (n + 1,) [s], and at them."""
        pairs = {}
        for d in self.differences:
            if d.drives:
                low, high = (applied_forces(x.plant, inputs, edges, substep) for x in (d.low, d.high))
                pairs[d.index] = (low, high)
        return Driven(applied_forces(self.base.plant, inputs, edges, substep), pairs)

    def accelerations(self, m: Moment, pairs: dict[int, tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Return how accelerations change with the parameters (nv, m), per scale.

        ``pairs``: applied forces of the two models of parameters that change them.
        """
        out = np.zeros((self.base.model.nv, len(self.unknowns)))
        if len(self._columns):
            y = pin.computeJointTorqueRegressor(self.base.model.pin, self._data, m.q, m.v, m.a)
            out[:, self._inertial] = -(m.inverse @ y[:, self._columns]) * self.scales[self._inertial]
        for d in self.differences:
            low, high = pairs.get(d.index, (m.tau, m.tau))
            change = d.high.plant.acceleration(m.time, m.q, m.v, high)
            change = change - d.low.plant.acceleration(m.time, m.q, m.v, low)
            out[:, d.index] = change * (self.scales[d.index] / d.width)
        return out

    def readings(self, m: Moment, forces: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Return how readings at fixed motion change with the parameters (rows, m), per scale."""
        out = self._biases.copy()
        for d in self.differences:
            if d.reads:
                high, low = (x.predict(m, forces, self.base.plant)[0] for x in (d.high, d.low))
                out[:, d.index] = (high - low) * (self.scales[d.index] / d.width)
        return out


def _inverse_mass(of: Instance) -> np.ndarray:
    """Return the inverse mass matrix (nv, nv) at home."""
    upper = np.triu(pin.computeMinverse(of.plant.pin, of.plant.data, of.model.home))
    return upper + np.triu(upper, 1).T


def point_at(origin: Point, unknowns: Sequence[Unknown], values: np.ndarray) -> Point:
    """Return the point at which parameters have these values (m,); which way led there does not matter."""
    inertial, biases = dict(origin.inertial), dict(origin.biases)
    by_effect: dict[str, dict[str, float]] = {}
    for u, value in zip(unknowns, values.tolist(), strict=True):
        if u.kind == "inertial":
            own = origin.base.pin.inertias[u.column // 10 + 1].toDynamicParameters()[u.column % 10]
            inertial[u.column] = value - float(own)
        elif u.kind == "bias":
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
