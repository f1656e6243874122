"""Predicted measurements of a model, with their derivatives: one sample for a filter, or all at once."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from smsid.estimation._bus_readings import Bus, cross_matrices
from smsid.estimation.measurements import ChannelSlice, Measurements
from smsid.model.spacecraft import JointGroup, SpacecraftModel
from smsid.model.stations import find_appendage, station_indices
from smsid.simulate.trajectory import States
from smsid.simulate.truth import exact_readings


@dataclass(frozen=True)
class Stations:
    """Stations (n,) of an appendage: at ``rest`` (n, 3), moved by ``shapes`` (n, 3, m) of the joints at ``q``
    and ``v`` (m,), and ``drawn`` in (n, m, m) along an ``axis`` (3,), ``None``: not at all.
    """

    q: np.ndarray
    v: np.ndarray
    rest: np.ndarray
    shapes: np.ndarray
    axis: np.ndarray
    drawn: np.ndarray | None


class MeasurementModel:
    """Predicted measurements of one model, sample by sample with derivatives, or all samples at once."""

    def __init__(self, model: SpacecraftModel, data: Measurements, locked: np.ndarray | None = None) -> None:
        self.model, self.data, self.locked = model, data, locked
        self.gravity = np.asarray(model.pin.gravity.linear)
        self._constant = np.zeros((3, data.rows, model.nv))  # derivatives that do not depend on the motion
        self._parts = [(block, self._part(block)) for block in data.blocks]

    def predict(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return h (rows,) and its derivatives by the tangent of q, by v and by a, each (rows, nv)."""
        h = np.zeros(self.data.rows)
        cq, cv, ca = self._constant.copy()
        bus = Bus(q, v, a, self.gravity) if self.model.free else None
        for block, part in self._parts:
            part(bus, q, v, a, h, cq, cv, ca)
            if not block.plain and block.quantity != "attitude":
                _distort(block, h, (cq, cv, ca))
            elif block.quantity == "attitude":
                h[block.rows] = block.bias
        return h, cq, cv, ca

    def twisted(
        self, h: np.ndarray, t: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray, a: np.ndarray
    ) -> None:
        """Add to predictions h (rows,) what encoders see of gears that give at once, at time t [s] under
        forces tau (nv,).

        How that depends on the state is left out: the compliance of such a gear times a rotor's inertia.
        """
        if self.model.twists:
            for block in self.data.blocks:
                if block.quantity == "joint_position":
                    here = self.model.encoder_twist(
                        np.array([t]), q[None], v[None], tau[None], a[None], self.locked
                    )
                    h[block.rows] += block.gain @ here[0]

    def all(
        self, s: States, names: Collection[str] | None = None, inverse: np.ndarray | None = None
    ) -> np.ndarray:
        """Return h (N, rows) at many states; an attitude's rows hold the sensor's own error alone.

        ``names`` are the sensors that are read, all if not given; rows of others are zero. ``inverse``
        (N, nv, nv) are inverse mass matrices where these are known.
        """
        out = np.zeros((len(s.time), self.data.rows))
        for name, sensor in {b.sensor.name: b.sensor for b in self.data.blocks}.items():
            if names is not None and name not in names:
                continue
            ideal = exact_readings(self.model, s, sensor, self.locked, inverse)
            for block in (b for b in self.data.blocks if b.sensor.name == sensor.name):
                if block.quantity == "attitude":
                    out[:, block.rows] = block.bias
                else:
                    x = ideal[block.channel].reshape(len(s.time), -1, len(block.gain))
                    out[:, block.rows] = block.read(x).reshape(len(s.time), -1)
                out[:, block.rows] += block.begun(s.time)
        return out

    def _part(self, block: ChannelSlice) -> Callable[..., None]:
        """Return what adds a block's readings to h, and their derivatives but for those that are constant."""
        sensor, rows, model = block.sensor, block.rows, self.model
        cq, cv, ca = self._constant
        r = np.asarray(sensor.position, dtype=float)
        index = np.arange(rows.start, rows.stop)
        match block.quantity:
            case "joint_position":
                group, motors = model.arm_joints, model.motors
                cq[index, group.v] = 1.0
                for i, _, kv in motors:
                    cq[rows.start + i, kv] = 1.0
                turning = [i for i, j in enumerate(group.joints) if model.pin.joints[int(j)].nq == 2]

                def part(bus, q, v, a, h, cq, cv, ca):
                    h[rows] = q[group.q]
                    for i in turning:  # an angle as its cosine and sine
                        h[rows.start + i] = np.arctan2(q[group.q[i] + 1], q[group.q[i]])
                    for i, kq, _ in motors:
                        h[rows.start + i] += q[kq]

                return part
            case "joint_velocity" | "wheel_rate":
                arm = block.quantity == "joint_velocity"
                group, motors = (model.arm_joints, model.motors) if arm else (model.wheels, ())
                cv[index, group.v] = 1.0
                for i, _, kv in motors:
                    cv[rows.start + i, kv] = 1.0

                def part(bus, q, v, a, h, cq, cv, ca):
                    h[rows] = v[group.v]
                    for i, _, kv in motors:
                        h[rows.start + i] += v[kv]

                return part
            case "position":
                return lambda bus, q, v, a, h, cq, cv, ca: bus and bus.position(rows, r, h, cq)
            case "attitude":
                if model.free:
                    cq[index, range(3, 6)] = 1.0
                return lambda *_: None
            case "velocity":
                return lambda bus, q, v, a, h, cq, cv, ca: bus and bus.velocity(rows, r, h, cq, cv)
            case "angular_rate":
                if model.free:
                    cv[index, range(3, 6)] = 1.0

                def part(bus, q, v, a, h, cq, cv, ca):
                    if bus:
                        h[rows] = bus.omega

                return part
        if sensor.kind == "accelerometers":
            return self._panel(block)
        if model.free:
            ca[index, range(3)] = 1.0
        return lambda bus, q, v, a, h, cq, cv, ca: bus and bus.force(rows, r[None], h, cq, cv, ca)

    def stations(self, block: ChannelSlice) -> Stations:
        """Return the stations that a block of accelerometers is of."""
        panel = find_appendage(self.model, str(block.sensor.appendage))
        seen = JointGroup.of(self.model.pin, panel.seen)
        chosen = [int(i) for i in station_indices(panel, block.sensor)]
        positions = panel.appendage.station_positions()
        drawn = None
        if panel.drawn is not None:  # by joint coordinates, which are modal ones over the scale
            drawn = np.outer(panel.scale, panel.scale) * panel.drawn[chosen]
            drawn = np.pad(drawn, ((0, 0), *2 * [(0, len(panel.more))]))
        rest = np.array([panel.placement.act(positions[i]) for i in chosen])
        shapes = np.array([panel.moved(i).T for i in chosen])
        return Stations(seen.q, seen.v, rest, shapes, panel.placement.rotation[:, 0].copy(), drawn)

    def _panel(self, block: ChannelSlice) -> Callable[..., None]:
        own, rows = self.stations(block), block.rows
        kq, kv, n = _range(own.q), _range(own.v), len(own.rest)
        rest, shapes, axis, drawn = own.rest, own.shapes, own.axis, own.drawn
        moving_ca = self._constant[2][rows].reshape(n, 3, -1)
        if self.model.free:
            moving_ca[:, :, :3] += np.eye(3)
        if drawn is None:
            moving_ca[:, :, kv] += shapes

        def part(bus, q, v, a, h, cq, cv, ca):
            bent, rate, acceleration = q[kq], v[kv], a[kv]
            places, leads = rest + shapes @ bent, shapes
            if drawn is not None:  # (stations, modes): a bent panel is drawn in
                pull = drawn @ bent
                places = places - 0.5 * (pull @ bent)[:, None] * axis
                leads = shapes - axis[:, None] * pull[:, None, :]
            moving = leads @ rate
            bus.force(rows, places, h, cq, cv, ca)
            read = h[rows].reshape(n, 3)
            by_q, by_v, by_a = (c[rows].reshape(n, 3, -1) for c in (cq, cv, ca))
            whirl = 2.0 * bus.spin
            read += leads @ acceleration + moving @ whirl.T
            by_q[:, :, kv] += bus.turning @ leads
            by_v[:, :, kv] += whirl @ leads
            by_v[:, :, 3:6] -= 2.0 * cross_matrices(moving)
            if drawn is not None:
                by_a[:, :, kv] += leads
                swing = axis[:, None] * (drawn @ rate)[:, None, :]
                read -= swing @ rate
                by_q[:, :, kv] -= axis[:, None] * (drawn @ acceleration)[:, None, :]
                by_q[:, :, kv] -= whirl @ swing
                by_v[:, :, kv] -= 2.0 * swing

        return part


def _range(index: np.ndarray) -> slice | np.ndarray:
    """Return indices as a slice, which is faster, where they follow each other."""
    first, n = int(index[0]), len(index)
    return slice(first, first + n) if np.array_equal(index, np.arange(first, first + n)) else index


def _distort(block: ChannelSlice, h: np.ndarray, derivatives: tuple[np.ndarray, ...]) -> None:
    width = len(block.gain)
    for start in range(block.rows.start, block.rows.stop, width):
        rows = slice(start, start + width)
        slope = block.slope(h[rows])
        h[rows] = block.read(h[rows])
        for c in derivatives:
            c[rows] = slope @ c[rows]
