"""Predicted measurements of a model, with their derivatives: one sample for a filter, or all at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from smsid.estimation.measurements import Block, Measured, matrix
from smsid.model.spacecraft import JointGroup, SpacecraftModel
from smsid.simulate.trajectory import States
from smsid.simulate.truth import find_appendage, sensed, station_indices


class MeasurementModel:
    """Predicted measurements of one model, sample by sample with derivatives, or all samples at once."""

    def __init__(self, model: SpacecraftModel, data: Measured, locked: np.ndarray | None = None) -> None:
        self.model, self.data, self.locked = model, data, locked
        self.gravity = np.asarray(model.pin.gravity.linear)
        self._parts = [(block, self._linear(block)) for block in data.blocks]

    def predict(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return h (rows,) and its derivatives by the tangent of q, by v and by a, each (rows, nv)."""
        rows, nv = self.data.rows, self.model.nv
        h = np.zeros(rows)
        cq, cv, ca = np.zeros((3, rows, nv))
        base = _Base(q, v, a, self.gravity) if self.model.free else None
        for block, part in self._parts:
            part(base, q, v, a, h, cq, cv, ca)
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
                    h[block.rows] += block.gain @ self.model.encoder_twist(t, q, v, tau, a, self.locked)

    def all(self, s: States) -> np.ndarray:
        """Return h (N, rows) at many states; an attitude's rows hold the sensor's own error alone."""
        out = np.empty((len(s.time), self.data.rows))
        for sensor in {b.sensor.name: b.sensor for b in self.data.blocks}.values():
            ideal = sensed(self.model, s, sensor, self.locked)
            for block in (b for b in self.data.blocks if b.sensor.name == sensor.name):
                if block.quantity == "attitude":
                    out[:, block.rows] = block.bias
                else:
                    x = ideal[block.channel].reshape(len(s.time), -1, len(block.gain))
                    out[:, block.rows] = (x @ block.gain.T + block.bias).reshape(len(s.time), -1)
                out[:, block.rows] += block.begun(s.time)
        return out

    def _linear(self, block: Block) -> Callable[..., None]:
        sensor, rows, model = block.sensor, block.rows, self.model
        r = np.asarray(sensor.position, dtype=float)
        match block.quantity:
            case "joint_position":
                group, index = model.arm_joints, range(rows.start, rows.stop)
                revolute = [model.pin.joints[int(j)].nq == 1 for j in group.joints]

                def part(base, q, v, a, h, cq, cv, ca):
                    for i, kq, kv, plain in zip(index, group.q, group.v, revolute, strict=True):
                        h[i] = q[kq] if plain else np.arctan2(q[kq + 1], q[kq])
                        cq[i, kv] = 1.0
                    for i, kq, kv in model.motors:
                        h[rows.start + i] += q[kq]
                        cq[rows.start + i, kv] = 1.0

                return part
            case "joint_velocity" | "wheel_rate":
                arm = block.quantity == "joint_velocity"
                group, motors = (model.arm_joints, model.motors) if arm else (model.wheels, ())
                index = np.arange(rows.start, rows.stop)

                def part(base, q, v, a, h, cq, cv, ca):
                    h[rows] = v[group.v]
                    cv[index, group.v] = 1.0
                    for i, _, kv in motors:
                        h[rows.start + i] += v[kv]
                        cv[rows.start + i, kv] = 1.0

                return part
            case "position":
                return lambda base, q, v, a, h, cq, cv, ca: base and base.position(rows, r, h, cq)
            case "attitude":
                return lambda base, q, v, a, h, cq, cv, ca: base and base.attitude(rows, cq)
            case "velocity":
                return lambda base, q, v, a, h, cq, cv, ca: base and base.velocity(rows, r, h, cq, cv)
            case "angular_rate":
                return lambda base, q, v, a, h, cq, cv, ca: base and base.rate(rows, h, cv)
        if sensor.kind == "accelerometers":
            return self._panel(block)
        return lambda base, q, v, a, h, cq, cv, ca: base and base.force(rows, r, h, cq, cv, ca)

    def _panel(self, block: Block) -> Callable[..., None]:
        panel = find_appendage(self.model, str(block.sensor.appendage))
        seen = JointGroup.of(self.model.pin, panel.seen)
        kq, kv = seen.q, seen.v
        stations = [int(i) for i in station_indices(panel, block.sensor)]
        positions = panel.appendage.station_positions()
        rest = [panel.placement.act(positions[i]) for i in stations]
        shapes = [panel.moved(i).T for i in stations]

        axis, drawn = panel.placement.rotation[:, 0], None
        if panel.drawn is not None:  # by joint coordinates, which are modal ones over the scale
            drawn = np.outer(panel.scale, panel.scale) * panel.drawn[stations]
            drawn = np.pad(drawn, ((0, 0), *2 * [(0, len(panel.more))]))

        def part(base, q, v, a, h, cq, cv, ca):
            bent, rate, acceleration = q[kq], v[kv], a[kv]
            for k, (r0, shape) in enumerate(zip(rest, shapes, strict=True)):
                rows = slice(block.rows.start + 3 * k, block.rows.start + 3 * k + 3)
                place, leads = r0 + shape @ bent, shape
                if drawn is not None:
                    pull = drawn[k] @ bent
                    place = place - 0.5 * (pull @ bent) * axis
                    leads = shape - np.outer(axis, pull)
                moving = leads @ rate
                base.force(rows, place, h, cq, cv, ca)
                h[rows] += leads @ acceleration + 2.0 * _cross(base.omega, moving)
                cq[rows, kv] += base.turning() @ leads
                cv[rows, kv] += 2.0 * pin.skew(base.omega) @ leads
                cv[rows, 3:6] -= 2.0 * pin.skew(moving)
                ca[rows, kv] += leads
                if drawn is not None:
                    swing = np.outer(axis, drawn[k] @ rate)
                    h[rows] -= swing @ rate
                    cq[rows, kv] -= np.outer(axis, drawn[k] @ acceleration)
                    cq[rows, kv] -= 2.0 * pin.skew(base.omega) @ swing
                    cv[rows, kv] -= 2.0 * swing

        return part


class _Base:
    """The bus at one instant, and what its sensors read."""

    def __init__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, gravity: np.ndarray) -> None:
        self.origin, self.rotation = q[:3], matrix(q[3:7])
        self.linear, self.omega = v[:3], v[3:6]
        self.a, self.alpha = a[:3], a[3:6]
        self.weight = self.rotation.T @ gravity if gravity.any() else None

    def position(self, rows: slice, r: np.ndarray, h: np.ndarray, cq: np.ndarray) -> None:
        h[rows] = self.origin + self.rotation @ r
        cq[rows, 0:3] = self.rotation
        cq[rows, 3:6] = -self.rotation @ pin.skew(r)

    def attitude(self, rows: slice, cq: np.ndarray) -> None:
        cq[rows, 3:6] = np.eye(3)

    def velocity(self, rows: slice, r: np.ndarray, h: np.ndarray, cq: np.ndarray, cv: np.ndarray) -> None:
        u = self.linear + _cross(self.omega, r)
        h[rows] = self.rotation @ u
        cq[rows, 3:6] = -self.rotation @ pin.skew(u)
        cv[rows, 0:3] = self.rotation
        cv[rows, 3:6] = -self.rotation @ pin.skew(r)

    def rate(self, rows: slice, h: np.ndarray, cv: np.ndarray) -> None:
        h[rows] = self.omega
        cv[rows, 3:6] = np.eye(3)

    def turning(self) -> np.ndarray:
        """Acceleration of a point per its place: alpha x + omega x omega x."""
        w = pin.skew(self.omega)
        return pin.skew(self.alpha) + w @ w

    def force(
        self, rows: slice, r: np.ndarray, h: np.ndarray, cq: np.ndarray, cv: np.ndarray, ca: np.ndarray
    ) -> None:
        """Specific force of a point fixed in the bus."""
        swing = _cross(self.omega, r)
        h[rows] = self.a + _cross(self.omega, self.linear + swing) + _cross(self.alpha, r)
        w = pin.skew(self.omega)
        cv[rows, 0:3] = w
        cv[rows, 3:6] = -pin.skew(self.linear + swing) - w @ pin.skew(r)
        ca[rows, 0:3] = np.eye(3)
        ca[rows, 3:6] = -pin.skew(r)
        if self.weight is not None:
            h[rows] -= self.weight
            cq[rows, 3:6] = -pin.skew(self.weight)


def _distort(block: Block, h: np.ndarray, derivatives: tuple[np.ndarray, ...]) -> None:
    width = len(block.gain)
    for start in range(block.rows.start, block.rows.stop, width):
        rows = slice(start, start + width)
        h[rows] = block.gain @ h[rows] + block.bias
        for c in derivatives:
            c[rows] = block.gain @ c[rows]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of two 3-vectors; NumPy's own takes ten times as long."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
