"""Derivatives of a recording's whitened outputs by everything sought, and the normal equations from them.

An output is linear in the derivatives of state and acceleration (`Kinematics.jacobian`), which the
variational equations carry from node to node. Rows are made a stretch of nodes at a time, from the end to the
beginning, and go straight into the information matrix, from which the joints' motion is `eliminate`d.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from smsid.likelihood._elimination import EliminatedMotion, Form, eliminate
from smsid.likelihood._linearised import POSE
from smsid.likelihood._outputs import Kinematics
from smsid.likelihood._sensitivity import NodeSensitivity, TransitionPart, VariationalEquations, variation
from smsid.likelihood.channels import Channel
from smsid.likelihood.nuisance_parameters import CLOCK_KINDS, SWITCH, NuisanceIndex, NuisanceValues
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction
from smsid.likelihood.recording_term import RecordingTerm
from smsid.likelihood.spline import WINDOW
from smsid.likelihood.time_grid import POINTS

STRETCH = 32  # nodes of a stretch
PART = 16 * STRETCH  # nodes whose transition maps are kept at a time


@dataclass(frozen=True)
class PieceNormal:
    """Information (n, n) and gradient (n,) by (parameters, local ones), the joints' motion eliminated.

    ``motion`` follows the components ``order`` (6 + common,) of a step of these.
    """

    information: np.ndarray
    gradient: np.ndarray
    order: np.ndarray
    motion: EliminatedMotion | None


def normal(
    piece: RecordingTerm,
    parameters: Parameters,
    local: NuisanceValues,
    prediction: Prediction,
    residuals: Sequence[np.ndarray] | None,
) -> PieceNormal:
    """Return the normal equations of a recording, with what encoders say; a gradient with ``residuals`` only.

    These are (N, k) by channel.

    Raises `NotIdentifiableError` where nothing tells how the joints moved.
    """
    outputs = _Outputs.of(piece, parameters, local, prediction)
    groups: dict[int, list[int]] = {}
    for i, c in enumerate(piece.channels):
        groups.setdefault(id(c.root), []).append(i)
    members = [[piece.channels[i] for i in own] for own in groups.values()]
    weighted = [
        None if residuals is None else _residuals_at_nodes(channels, [residuals[i] for i in own])
        for channels, own in zip(members, groups.values(), strict=True)
    ]

    def forms() -> Iterator[Form]:
        for stretch in outputs.stretches(members):
            size = stretch.end.shape[1]
            information, gradient = np.zeros((size, size)), np.zeros(size)
            own = slice(stretch.nodes.start, stretch.stop)
            for channels, rows, pull in zip(members, stretch.rows, weighted, strict=True):
                band = channels[0].root[own, stretch.nodes].toarray()
                mixed = (band @ rows.reshape(len(rows), -1)).reshape(-1, size)
                information += mixed.T @ mixed
                if pull is not None:
                    gradient += rows[: len(band)].reshape(-1, size).T @ pull[own].ravel()
            yield Form(information, gradient, stretch.end, len(stretch.end), *stretch.coefficients)
        start = outputs.start()
        size = start.shape[1]
        yield Form(np.zeros((size, size)), np.zeros(size), start, POSE, *stretch.coefficients)

    readings = piece.encoders(local) if outputs.moves.coefficients else None
    common = len(outputs.order) - POSE
    found, slope, motion = eliminate(forms(), common, readings, clock=bool(outputs.clocks))
    size = parameters.size + piece.size
    information, gradient = np.zeros((size, size)), np.zeros(size)
    information[np.ix_(outputs.order, outputs.order)] = found
    if residuals is not None:
        gradient[outputs.order] = slope
    return PieceNormal(information, gradient, outputs.order, motion)


def columns(
    piece: RecordingTerm, parameters: Parameters, local: NuisanceValues, prediction: Prediction
) -> list[np.ndarray]:
    """Return, channel by channel, derivatives at the coarse nodes (nodes, k, n), not whitened.

    By parameters, local ones, and the coefficients (m, joints) of the joints' motion, if that is estimated.
    """
    outputs = _Outputs.of(piece, parameters, local, prediction)
    size, front = parameters.size + piece.size, len(outputs.order)
    joints = len(outputs.moves.follow)
    where = np.concatenate([outputs.order, size + np.arange(joints * outputs.moves.coefficients)])
    out = [np.zeros((outputs.moves.nodes, c.width, size + len(where) - front)) for c in piece.channels]
    start = outputs.start()
    n = len(start)
    x = np.zeros((n, len(where)))
    x[:, : start.shape[1]] = start
    plain = [[c.with_covariance(np.eye(c.width))] for c in piece.channels]
    for stretch in reversed(list(outputs.stretches(plain))):
        motion = slice(*(front + joints * i for i in stretch.coefficients))
        inner = np.r_[POSE:front, motion]
        whole = np.zeros((stretch.end.shape[1], len(where)))
        whole[:n] = x
        whole[np.arange(n, len(whole)), inner] += 1.0
        for full, rows in zip(out, stretch.rows, strict=True):
            own = rows[: stretch.stop - stretch.nodes.start] @ whole
            full[stretch.nodes.start : stretch.stop, :, where] = own
        x = stretch.end @ whole
    return out


def direct(piece: RecordingTerm) -> list:
    """Return the slots that act on an output without moving anything."""
    read = [s for s in piece.slots if s.channel not in piece.drive.sensors]
    return [s for s in read if s.kind in ("bias", "scale", *CLOCK_KINDS)]


@dataclass(frozen=True)
class _Stretch:
    """Whitened outputs of some nodes, as many more as interpolation needs, by (x, common, coefficients).

    ``rows`` (nodes, k, z) by group of channels; nodes from ``stop`` on belong to the next stretch. ``end``
    (n, z) is x at that; ``coefficients`` are the first that acts, and the one after the last.
    """

    nodes: slice
    stop: int
    coefficients: tuple[int, int]
    rows: list[np.ndarray]
    end: np.ndarray


@dataclass(frozen=True)
class _Outputs:
    """Everything a recording's outputs depend on.

    ``order`` (6 + common,): where initial pose and common columns - moving, direct, encoders' ``clocks`` -
    stand among (parameters, local ones). ``rates``: of outputs whose clock is sought, at the nodes.
    """

    piece: RecordingTerm
    local: NuisanceValues
    moves: VariationalEquations
    kinematics: Kinematics
    order: np.ndarray
    clocks: list[NuisanceIndex]
    rates: dict[str, np.ndarray]

    @classmethod
    def of(
        cls, piece: RecordingTerm, parameters: Parameters, local: NuisanceValues, prediction: Prediction
    ) -> _Outputs:
        prediction = prediction.coarse
        thrust, clocks = piece.unit_thrust(parameters), piece.unit_clocks(parameters, local)
        drive = piece.driven(local)
        switch = [s for s in piece.slots if s.kind == SWITCH]
        count = sum(s.size for s in switch)
        moves = variation(parameters, drive, prediction, thrust, clocks, motion=piece.follows, switches=count)
        kinematics = Kinematics.of(parameters.layout.model, prediction)
        wrong = {s.channel for s in direct(piece) if s.kind in CLOCK_KINDS}
        rates = {
            c.name: kinematics.rate(c.sensor, c.quantity, prediction.timeline)
            for c in piece.channels
            if c.sensor.name in wrong
        }
        size, read = parameters.size, piece.encoder_clocks
        start = {s.kind: size + s.start for s in piece.slots}
        gains = [s for s in piece.slots if s.kind == "thrust_gain" and thrust is not None]
        extra = [size + s.start + k for s in (*gains, *piece.running_clocks, *switch) for k in range(s.size)]
        order = [start[kind] + k for kind in ("initial_position", "initial_attitude") for k in range(3)]
        order += [int(i) if i < size else extra[int(i) - size] for i in moves.moving]
        order += [size + s.start + k for s in (*direct(piece), *read) for k in range(s.size)]
        return cls(piece, local, moves, kinematics, np.array(order), read, rates)

    def start(self) -> np.ndarray:
        """Return x at the first node by (pose, common, coefficients that act in the first stretch)."""
        found, pose = self.moves.start(), POSE + len(self.moves.moving)
        first = min(STRETCH + POINTS - 1, self.moves.nodes) - 1
        joints = len(self.moves.follow)
        motion = joints * (int(self.moves.first[first]) + WINDOW)
        out = np.zeros((len(found), len(self.order) + motion))
        out[:, :pose] = found[:, :pose]
        out[:, len(self.order) : len(self.order) + joints * WINDOW] = found[:, pose:]
        return out

    def stretches(self, groups: Sequence[Sequence[Channel]]) -> Iterator[_Stretch]:
        """Yield the stretches from the last to the first, with the rows of groups of channels."""
        count, common = self.moves.nodes, len(self.order) - POSE
        for begin in reversed(range(0, count, PART)):
            stop = min(begin + PART, count)
            part = self.moves.part(slice(begin, min(stop + POINTS - 1, count)))
            rows = [_Rows.of(self, part, channels) for channels in groups]
            for first in reversed(range(begin, stop, STRETCH)):
                last = min(first + STRETCH, stop)
                nodes = slice(first, min(last + POINTS - 1, count))
                x = part.along(nodes, common)
                acting = (int(self.moves.first[first]), int(self.moves.first[nodes.stop - 1]) + WINDOW)
                end = x[min(last - first, len(x) - 1)].copy()  # it is kept, the rest is not
                yield _Stretch(nodes, last, acting, [r.at(nodes, x, part) for r in rows], end)


@dataclass(frozen=True)
class _Rows:
    """Whitened outputs of some channels, k in all, as linear maps at the nodes of a part.

    ``state`` (nodes, k, n), ``moving`` (nodes, k, moving), ``motion`` (nodes, k, WINDOW joints), ``direct``
    (nodes, k, direct).
    """

    state: np.ndarray
    moving: np.ndarray
    motion: np.ndarray
    direct: np.ndarray

    @classmethod
    def of(cls, outputs: _Outputs, part: TransitionPart, channels: Sequence[Channel]) -> _Rows:
        local, slots = outputs.local, direct(outputs.piece)
        kinematics = outputs.kinematics.at(part.nodes)
        basis = _basis(outputs.moves, kinematics)
        n = outputs.moves.rows
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
                    timeline = outputs.moves.prediction.timeline
                    rate = -outputs.rates[c.name][part.nodes] @ c.whitening.T
                    if s.kind == "clock_drift":
                        times = timeline.evaluations[timeline.node_evaluation[part.nodes]]
                        rate = rate * (times - timeline.edges[0])[:, None]
                    own[..., place] = rate
                elif s.kind == "scale" and s.channel == c.name:
                    own[..., place] = kinematics.output(c.sensor, c.quantity) @ c.whitening.T
                place += s.size
            found.append(
                (
                    maps[..., :n] + of_slope @ part.slope_state,
                    of_slope @ part.slope_moving,
                    of_slope @ part.slope_motion,
                    own,
                )
            )
        return cls(*(np.concatenate(x, axis=1) for x in zip(*found, strict=True)))

    def at(self, nodes: slice, x: np.ndarray, part: TransitionPart) -> np.ndarray:
        """Return the rows (nodes, k, z) of some nodes, from x (nodes, n, z) there."""
        n, k, width = x.shape[1], self.moving.shape[2], self.motion.shape[2]
        own = slice(nodes.start - part.nodes.start, nodes.stop - part.nodes.start)
        out = self.state[own] @ x
        out[..., n : n + k] += self.moving[own]
        out[..., n + k : n + k + self.direct.shape[2]] += self.direct[own]
        if width:
            stop = part.first[own.stop - 1] + WINDOW
            for rows, motion, first in zip(out, self.motion[own], part.first[own], strict=True):
                place = x.shape[2] - part.joints * (stop - first)
                rows[:, place : place + width] += motion
        return out


def _residuals_at_nodes(channels: Sequence[Channel], residuals: Sequence[np.ndarray]) -> np.ndarray:
    """Whitened residuals taken back to the nodes (nodes, k)."""
    parts = [c.to_coarse(r @ c.whitening.T) for c, r in zip(channels, residuals, strict=True)]
    return np.concatenate(parts, axis=1)


def _basis(moves: VariationalEquations, kinematics: Kinematics) -> NodeSensitivity:
    """Unit derivatives of state and free accelerations: columns (n + free)."""
    nodes, nv = kinematics.v.shape
    n, free, rest = moves.rows, moves.drive.free, moves.prediction.rest_v
    width = n + len(free)
    pose, q, v, a = np.zeros((6, width)), *np.zeros((3, nv, width))
    pose[:, :POSE] = np.eye(POSE)
    q[rest, POSE + np.arange(len(rest))] = 1.0
    v[free, POSE + len(rest) + np.arange(len(free))] = 1.0
    a[free, n + np.arange(len(free))] = 1.0
    return NodeSensitivity(*(np.broadcast_to(x, (nodes, *x.shape)) for x in (pose, q, v, a)))
