"""What the sensors read along a predicted motion, at the nodes of its grid, with derivatives.

Frames and units as in docs/design.md, section 3. Derivatives are by P = (parameters, initial position 3 and
attitude 3, thrust gains 3), as in `NodeSensitivity`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from smsid.errors import DescriptionError
from smsid.identify.momentum_rows import skew
from smsid.likelihood._sensitivity import NodeSensitivity
from smsid.likelihood.prediction import Prediction
from smsid.likelihood.time_grid import Timeline
from smsid.model.spacecraft import JointGroup, SpacecraftModel
from smsid.model.stations import find_appendage, station_indices
from smsid.sensing import Sensor
from smsid.simulate.truth import rotation_matrices


@dataclass(frozen=True)
class Kinematics:
    """The bus at the nodes: q (nodes, nq), v, a (nodes, nv) and rotation (nodes, 3, 3)."""

    model: SpacecraftModel
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    rotation: np.ndarray

    @classmethod
    def of(cls, model: SpacecraftModel, prediction: Prediction) -> Kinematics:
        """Return what the outputs need of a prediction."""
        rotation = rotation_matrices(prediction.q[:, 3:7])
        return cls(model, prediction.q, prediction.v, prediction.a, rotation)

    def at(self, nodes: slice) -> Kinematics:
        """Return those of some nodes."""
        return replace(self, q=self.q[nodes], v=self.v[nodes], a=self.a[nodes], rotation=self.rotation[nodes])

    def output(self, sensor: Sensor, quantity: str) -> np.ndarray:
        """Return what a sensor reads, (nodes, k); an attitude as quaternion (nodes, 4).

        Accelerometers of a panel: station after station, k = 3 stations.
        """
        r = np.asarray(sensor.position, dtype=float)
        v, w = self.v[:, :3], self.v[:, 3:6]
        match quantity:
            case "position":
                return self.q[:, :3] + self.rotation @ r
            case "attitude":
                return self.q[:, 3:7]
            case "velocity":
                return np.einsum("nij,nj->ni", self.rotation, v + np.cross(w, r))
            case "angular_rate":
                return w
        if sensor.kind == "imu":
            return self._force(np.tile(r, (len(v), 1)))
        rests, shapes, index_q, index_v = panel_geometry(self.model, sensor)
        out = []
        s, rate, acc = self.q[:, index_q], self.v[:, index_v], self.a[:, index_v]
        for rest, shape in zip(rests, shapes, strict=True):
            out.append(self._force(rest + s @ shape) + acc @ shape + 2 * np.cross(w, rate @ shape))
        return np.concatenate(out, axis=1)

    def rate(self, sensor: Sensor, quantity: str, timeline: Timeline) -> np.ndarray:
        """Return the time derivative of what a sensor reads, (nodes, k); an attitude's as rotation vector."""
        if quantity == "attitude":
            return self.v[:, 3:6]
        values = self.output(sensor, quantity)
        times = timeline.evaluations[timeline.node_evaluation]
        ends = np.cumsum(timeline.counts + 1)
        parts = [
            CubicSpline(times[b - n - 1 : b], values[b - n - 1 : b], axis=0)(times[b - n - 1 : b], 1)
            for n, b in zip(timeline.counts, ends, strict=True)
        ]
        return np.concatenate(parts)

    def jacobian(self, sensor: Sensor, quantity: str, by: NodeSensitivity) -> np.ndarray:
        """Return the derivative (nodes, k, P); an attitude's is that of a rotation vector, bus frame."""
        r = np.asarray(sensor.position, dtype=float)
        rho, phi = by.pose[:, :3], by.pose[:, 3:]
        dv, dw = by.v[:, :3], by.v[:, 3:6]
        match quantity:
            case "position":
                return self.rotation @ (rho - skew(r) @ phi)
            case "attitude":
                return phi
            case "velocity":
                u = self.v[:, :3] + np.cross(self.v[:, 3:6], r)
                return self.rotation @ (dv - skew(r) @ dw - skew(u) @ phi)
            case "angular_rate":
                return dw
        if sensor.kind == "imu":
            return self._force_jacobian(np.tile(r, (len(self.v), 1)), None, by)
        rests, shapes, index_q, index_v = panel_geometry(self.model, sensor)
        w = skew(self.v[:, 3:6])
        s, rate = self.q[:, index_q], self.v[:, index_v]
        out = []
        for rest, shape in zip(rests, shapes, strict=True):
            turn = np.ascontiguousarray(shape.T)
            displaced = turn @ by.q[:, index_v]
            block = self._force_jacobian(rest + s @ shape, displaced, by)
            block += turn @ by.a[:, index_v] + 2 * w @ (turn @ by.v[:, index_v])
            block -= 2 * skew(rate @ shape) @ dw
            out.append(block)
        return np.concatenate(out, axis=1)

    def _force(self, r: np.ndarray) -> np.ndarray:
        v, w, a, alpha = self.v[:, :3], self.v[:, 3:6], self.a[:, :3], self.a[:, 3:6]
        return a + np.cross(w, v) + np.cross(alpha, r) + np.cross(w, np.cross(w, r))

    def _force_jacobian(self, r: np.ndarray, dr: np.ndarray | None, by: NodeSensitivity) -> np.ndarray:
        v, w = skew(self.v[:, :3]), skew(self.v[:, 3:6])
        arm, alpha = skew(r), skew(self.a[:, 3:6])
        swing = skew(np.cross(self.v[:, 3:6], r))
        out = by.a[:, :3] + w @ by.v[:, :3] - arm @ by.a[:, 3:6]
        out -= (v + swing + w @ arm) @ by.v[:, 3:6]
        if dr is not None:
            out += (alpha + w @ w) @ dr
        return out


def panel_geometry(
    model: SpacecraftModel, sensor: Sensor
) -> tuple[list[np.ndarray], list[np.ndarray], np.ndarray, np.ndarray]:
    """Return, by station, rest position (3,) and displacement per joint coordinate (modes, 3), bus axes.

    With them where the modes are in q and v. The displacement does not depend on the density: participation
    grows with its root, mass-normalised shapes fall with it. Raises `DescriptionError` for an appendage on a
    moving link.
    """
    panel = find_appendage(model, str(sensor.appendage))
    if panel.parent > 1:
        raise DescriptionError(
            f"'{panel.appendage.name}' sits on a moving link; accelerometers need the bus."
        )
    rests, shapes = [], []
    for station in station_indices(panel, sensor):
        rests.append(panel.placement.act(panel.appendage.station_positions()[station]))
        shapes.append(panel.moved(station))
    seen = JointGroup.of(model.pin, panel.seen)
    return rests, shapes, seen.q, seen.v
