"""Derivatives of a recording's whitened outputs by everything sought, and the normal equations from them.

An output is linear in the derivatives of state and acceleration (`Kinematics.jacobian`), which the
variational equations carry from node to node. Rows are made a few nodes at a time, with the columns that
have begun, and go straight into the information matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from smsid.likelihood.channels import Channel
from smsid.likelihood.linearised import POSE
from smsid.likelihood.nuisance_parameters import CLOCK_KINDS, NuisanceValues
from smsid.likelihood.outputs import Kinematics
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction
from smsid.likelihood.recording_term import RecordingTerm
from smsid.likelihood.sensitivity import Sensitivity, Variation, variation
from smsid.likelihood.time_grid import POINTS


def normal(
    piece: RecordingTerm,
    parameters: Parameters,
    local: NuisanceValues,
    prediction: Prediction,
    residuals: Sequence[np.ndarray] | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return information (n, n) and gradient (n,) by (parameters, local ones), the latter with data."""
    prediction = prediction.coarse
    moves = _variation(piece, parameters, local, prediction)
    order = _order(piece, moves, parameters.size)
    kinematics = Kinematics.of(parameters.layout.model, prediction)
    groups: dict[int, list[int]] = {}
    for i, c in enumerate(piece.channels):
        groups.setdefault(id(c.root), []).append(i)
    accumulators = []
    for members in groups.values():
        channels = [piece.channels[i] for i in members]
        own = None if residuals is None else [residuals[i] for i in members]
        rows = _Rows.of(piece, channels, kinematics, moves, local)
        accumulators.append(_Accumulator(rows, channels[0].root, _weighted(channels, own), moves.width))
    for nodes, states in moves.states():
        for a in accumulators:
            a.add(nodes, states, moves)
    size = parameters.size + piece.size
    information, gradient = np.zeros((size, size)), np.zeros(size)
    for a in accumulators:
        a.finish()
        information[np.ix_(order, order)] += a.information
        gradient[order] += a.gradient
    return information, gradient


def columns(
    piece: RecordingTerm, parameters: Parameters, local: NuisanceValues, prediction: Prediction
) -> list[np.ndarray]:
    """Return, channel by channel, derivatives at the coarse nodes (nodes, k, n), not whitened."""
    prediction = prediction.coarse
    moves = _variation(piece, parameters, local, prediction)
    order = _order(piece, moves, parameters.size)
    kinematics = Kinematics.of(parameters.layout.model, prediction)
    out = []
    for c in piece.channels:
        plain = c.with_covariance(np.eye(c.width))
        rows = _Rows.of(piece, [plain], kinematics, moves, local)
        full = np.zeros((len(kinematics.q), c.width, parameters.size + piece.size))
        for nodes, states in moves.states():
            part = np.zeros((nodes.stop - nodes.start, c.width, full.shape[2]))
            found = rows.at(nodes, states, moves)
            part[:, :, order[: found.shape[2]]] = found
            full[nodes] = part
        out.append(full)
    return out


def _variation(
    piece: RecordingTerm, parameters: Parameters, local: NuisanceValues, prediction: Prediction
) -> Variation:
    return variation(
        parameters,
        piece.driven(local),
        prediction,
        piece.unit_thrust(parameters),
        piece.unit_clocks(parameters, local),
        motion=piece.follows,
    )


def _order(piece: RecordingTerm, moves: Variation, size: int) -> np.ndarray:
    """Where the columns (moving, pose, direct, motion by time) stand among (parameters, local ones)."""
    start = {s.kind: size + s.start for s in piece.slots}
    gains = [s for s in piece.slots if s.kind == "thrust_gain" and piece.drive.thrust is not None]
    extra = [size + s.start + k for s in (*gains, *piece.running_clocks) for k in range(s.size)]
    out = [int(i) if i < size else extra[int(i) - size] for i in moves.moving]
    out += [start["initial_position"] + k for k in range(3)] + [
        start["initial_attitude"] + k for k in range(3)
    ]
    for s in direct(piece):
        out += list(range(size + s.start, size + s.start + s.size))
    if moves.joints:
        by_joint = start["joint_motion"] + np.arange(moves.joints * moves.coefficients)
        out += by_joint.reshape(moves.joints, moves.coefficients).T.ravel().tolist()
    return np.array(out)


def direct(piece: RecordingTerm) -> list:
    """Return the slots that act on an output without moving anything."""
    read = [s for s in piece.slots if s.channel not in piece.drive.sensors]
    return [s for s in read if s.kind in ("bias", "scale", *CLOCK_KINDS)]


@dataclass(frozen=True)
class _Rows:
    """Whitened outputs of some channels, k in all, as linear maps at the nodes.

    ``state`` (nodes, k, n), ``moving`` (nodes, k, moving), ``motion`` (nodes, k, WINDOW joints), ``direct``
    (nodes, k, direct).
    """

    state: np.ndarray
    moving: np.ndarray
    motion: np.ndarray
    direct: np.ndarray

    @classmethod
    def of(
        cls,
        piece: RecordingTerm,
        channels: Sequence[Channel],
        kinematics: Kinematics,
        moves: Variation,
        local: NuisanceValues,
    ) -> _Rows:
        basis = _basis(moves, kinematics)
        n = moves.phi.shape[1]
        slots = direct(piece)
        found = []
        for c in channels:
            white = c.whitening * (1.0 + local.scale.get(c.name, 0.0))
            maps = white @ kinematics.jacobian(c.sensor, c.quantity, basis)
            of_slope = maps[..., n:]
            own = np.zeros((len(maps), c.width, sum(s.size for s in slots)))
            place = 0
            for s in slots:
                if s.channel == c.name and s.kind == "bias":
                    own[..., place : place + s.size] = c.whitening
                elif s.kind in CLOCK_KINDS and s.channel == c.sensor.name:
                    timeline = moves.prediction.timeline
                    rate = -kinematics.rate(c.sensor, c.quantity, timeline) @ c.whitening.T
                    if s.kind == "clock_drift":
                        times = timeline.evaluations[timeline.node_evaluation]
                        rate = rate * (times - timeline.edges[0])[:, None]
                    own[..., place] = rate
                elif s.kind == "scale" and s.channel == c.name:
                    own[..., place] = kinematics.output(c.sensor, c.quantity) @ c.whitening.T
                place += s.size
            found.append(
                (
                    maps[..., :n] + of_slope @ moves.slope_state,
                    of_slope @ moves.slope_moving,
                    of_slope @ moves.slope_motion,
                    own,
                )
            )
        return cls(*(np.concatenate(part, axis=1) for part in zip(*found, strict=True)))

    def at(self, nodes: slice, states: np.ndarray, moves: Variation) -> np.ndarray:
        """Return the rows (chunk, k, columns begun) of some nodes."""
        front, k, extra = moves.front, self.moving.shape[2], self.direct.shape[2]
        own = self.state[nodes]
        out = np.empty((len(own), own.shape[1], states.shape[2] + extra))
        found = own @ states
        out[..., :front] = found[..., :front]
        out[..., :k] += self.moving[nodes]
        out[..., front : front + extra] = self.direct[nodes]
        out[..., front + extra :] = found[..., front:]
        if moves.joints:
            for i, node in enumerate(range(nodes.start, nodes.stop)):
                window = moves.window(node)
                out[i, :, window.start + extra : window.stop + extra] += self.motion[node]
        return out


class _Accumulator:
    """Sums rows of one group of channels into information and gradient."""

    def __init__(self, rows: _Rows, root: csr_array, weighted: np.ndarray | None, width: int) -> None:
        self.rows, self.root, self.weighted = rows, root, weighted
        self.size = width + rows.direct.shape[2]
        self.information = np.zeros((self.size, self.size))
        self.gradient = np.zeros(self.size)
        self._kept = np.zeros((0, rows.state.shape[1], 0))
        self._first = 0  # node of the first row kept

    def add(self, nodes: slice, states: np.ndarray, moves: Variation) -> None:
        new = self.rows.at(nodes, states, moves)
        m = new.shape[2]
        if self.weighted is not None:
            self.gradient[:m] += new.reshape(-1, m).T @ self.weighted[nodes].ravel()
        rows = np.zeros((len(self._kept) + len(new), *new.shape[1:]))
        rows[: len(self._kept), :, : self._kept.shape[2]] = self._kept
        rows[len(self._kept) :] = new
        self._sum(rows, max(len(rows) - (POINTS - 1), 0))

    def finish(self) -> None:
        """Sum the rows that were kept for want of later ones."""
        self._sum(self._kept, len(self._kept))
        upper = np.triu(self.information)
        self.information = upper + np.triu(upper, 1).T

    def _sum(self, rows: np.ndarray, ready: int) -> None:
        if ready:
            band = self.root[self._first : self._first + ready, self._first : self._first + len(rows)]
            mixed = (band.toarray() @ rows.reshape(len(rows), -1)).reshape(-1, rows.shape[2])
            m = rows.shape[2]
            self.information[:m, :m] += mixed.T @ mixed
        self._kept = rows[ready:]
        self._first += ready


def _weighted(channels: Sequence[Channel], residuals: Sequence[np.ndarray] | None) -> np.ndarray | None:
    """Whitened residuals taken back to the nodes (nodes, k)."""
    if residuals is None:
        return None
    parts = [c.coarse_weights.T @ (r @ c.whitening.T) for c, r in zip(channels, residuals, strict=True)]
    return np.concatenate(parts, axis=1)


def _basis(moves: Variation, kinematics: Kinematics) -> Sensitivity:
    """Unit derivatives of state and free accelerations: columns (n + free)."""
    nodes, nv = kinematics.v.shape
    n, free, rest = moves.phi.shape[1], moves.free, moves.prediction.rest_v
    width = n + len(free)
    pose, q, v, a = np.zeros((6, width)), *np.zeros((3, nv, width))
    pose[:, :POSE] = np.eye(POSE)
    q[rest, POSE + np.arange(len(rest))] = 1.0
    v[free, POSE + len(rest) + np.arange(len(free))] = 1.0
    a[free, n + np.arange(len(free))] = 1.0
    return Sensitivity(*(np.broadcast_to(x, (nodes, *x.shape)) for x in (pose, q, v, a)))
