"""A spacecraft with its sensors and parameters as the arrays that the compiled filter takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smsid.estimation._measurement_model import MeasurementModel
from smsid.estimation.filter_pass import REGULARISATION, Instance
from smsid.kernel import columns as c
from smsid.kernel.arrays import Force, in_axes_of_table, row_of
from smsid.kernel.filter_arrays import Model, StateParameters, TreeTables
from smsid.kernel.readings import (
    ANGLE,
    ANGULAR_RATE,
    ATTITUDE,
    POSITION,
    TURN_RATE,
    VELOCITY,
    Readings,
)

BUS = {"position": POSITION, "attitude": ATTITUDE, "velocity": VELOCITY, "angular_rate": ANGULAR_RATE}
GEOMETRY = slice(c.ROTATION, c.MASS)  # columns of bodies that inverse dynamics are not linear in


@dataclass(frozen=True)
class ParameterDifference:
    """Two spacecraft that differ in one parameter, number ``index``: the derivative is ``factor`` times what
    the second has beyond the first.
    """

    index: int
    low: Instance
    high: Instance
    factor: float


@dataclass(frozen=True)
class Tables:
    """Tables of bodies (k, n, 28) and roots (k, 26 + ...) whose inverse dynamics are derivatives by
    parameters, as `smsid.kernel.filter_arrays.StateParameters` has them, and the same of sensors (k,).
    """

    bodies: tuple[np.ndarray, ...] = ()
    roots: tuple[np.ndarray, ...] = ()
    terms: tuple[tuple[int, float], ...] = ()
    senses: tuple[Readings, ...] = ()
    read_terms: tuple[tuple[int, float], ...] = ()


NOTHING = StateParameters(
    np.zeros(0),
    np.zeros(0),
    np.zeros(0),
    np.zeros((0, 2), dtype=np.int64),
    np.zeros(0),
    np.zeros((0, 2), dtype=np.int64),
    np.zeros(0),
    np.zeros((0, 0)),
    np.zeros(0, dtype=np.int64),
    np.zeros((0, 2), dtype=np.int64),
    np.zeros(0),
    np.zeros(0),
    REGULARISATION,
)


def compiled_model(base: Instance) -> Model | None:
    """Return a spacecraft without parameters in the filter's state, or ``None``: it goes the plain way."""
    bodies, senses = base.plant.kernel(), None
    if bodies is not None:
        senses = senses_of(base.outputs)
    if bodies is None or senses is None:
        return None
    return Model(TreeTables(bodies.tree, bodies.bodies[None], bodies.root[None]), senses, NOTHING)


def inertial_tables(
    base: Instance, columns: np.ndarray, indices: np.ndarray, scales: np.ndarray
) -> Tables | None:
    """Return the tables of inertial parameters ``columns`` (k,), ten a body in Pinocchio's order.

    They are per ``scales`` (k,) and stand at ``indices`` (k,) of the parameters. ``None`` where they go the
    plain way.
    """
    own, free, m = base.plant.kernel(balanced=False), base.model.free, base.model.pin
    if own is None:
        return None
    bodies, roots = [], []
    for column, scale in zip(columns, scales, strict=True):
        joint, element = int(column) // 10 + 1, int(column) % 10
        row, root = np.zeros_like(own.bodies), own.root.copy()
        root[[*range(10), c.FORCES, c.BEAMS, c.ROTORS]] = 0.0
        i, unit = row_of(m, free, joint), scale * np.eye(10)[element]
        if i < 0:
            root[element] = scale
        else:
            row[i, c.MASS : c.MASS + 10] = in_axes_of_table(own, i, unit)
        bodies.append(row)
        roots.append(root)
    return Tables(tuple(bodies), tuple(roots), tuple((int(i), 1.0) for i in indices))


def effect_tables(changes: Sequence[ParameterDifference]) -> Tables | None:
    """Return the tables of parameters by differences, ``None`` where they go the plain way."""
    bodies, roots, terms, senses, read_terms = [], [], [], [], []
    for change in changes:
        low, high = (x.plant.kernel(balanced=False) for x in (change.low, change.high))
        seen, then = (senses_of(x.outputs) for x in (change.low, change.high))
        if low is None or high is None or seen is None or then is None or len(seen.twists) + len(then.twists):
            return None
        if not np.array_equal(low.tree, high.tree) or _by_load(change.low) != _by_load(change.high):
            return None
        same = len(low.root) == len(high.root)
        bodies_alone = same and np.array_equal(low.root[c.FREE :], high.root[c.FREE :])
        if bodies_alone and np.array_equal(low.bodies[:, GEOMETRY], high.bodies[:, GEOMETRY]):  # linear
            root = low.root.copy()
            root[[c.FORCES, c.BEAMS, c.ROTORS]] = 0.0
            root[:10] = change.factor * (high.root[:10] - low.root[:10])
            row = change.factor * (high.bodies - low.bodies)
            if row.any() or root[:10].any():
                bodies.append(row)
                roots.append(root)
                terms.append((change.index, 1.0))
        else:
            bodies += [low.bodies, high.bodies]
            roots += [low.root, high.root]
            terms += [(change.index, -change.factor), (change.index, change.factor)]
        if not _same(seen, then):
            senses += [seen, then]
            read_terms += [(change.index, -change.factor), (change.index, change.factor)]
    return Tables(tuple(bodies), tuple(roots), tuple(terms), tuple(senses), tuple(read_terms))


def with_parameters(
    base: Instance,
    tables: Sequence[Tables],
    scales: np.ndarray,
    at: np.ndarray,
    rates: np.ndarray,
    trends: tuple[np.ndarray, np.ndarray],
    columns: np.ndarray,
    pushed: Sequence[int],
    close: np.ndarray,
) -> Model | None:
    """Return a spacecraft with parameters, or ``None`` where one of it goes the plain way.

    ``scales``, values ``at``, ``rates``, ``close`` (m,) and ``trends`` are the parameters', ``columns``
    (rows, m) how readings change with them at any motion; applied forces change with those ``pushed``.
    """
    own, senses = base.plant.kernel(balanced=False), senses_of(base.outputs)
    if own is None or senses is None or len(senses.twists):
        return None
    bodies, roots = [own.bodies], [own.root]
    for table in tables:
        for row, root in zip(table.bodies, table.roots, strict=True):
            linear = not row[:, GEOMETRY].any()
            bodies.append(np.hstack([own.bodies[:, GEOMETRY], row[:, c.MASS :]]) if linear else row)
            roots.append(root)
    terms = [x for t in tables for x in t.terms]
    read_terms = [x for t in tables for x in t.read_terms]
    parameters = StateParameters(
        scales,
        at,
        rates,
        np.array([(k + 1, i) for k, (i, _) in enumerate(terms)], dtype=np.int64).reshape(-1, 2),
        np.array([w for _, w in terms]),
        np.array([(k + 1, i) for k, (i, _) in enumerate(read_terms)], dtype=np.int64).reshape(-1, 2),
        np.array([w for _, w in read_terms]),
        columns,
        np.array(pushed, dtype=np.int64),
        *trends,
        close,
        REGULARISATION,
    )
    every = [senses, *(x for t in tables for x in t.senses)]
    stacked = {name: np.concatenate([getattr(x, name) for x in every]) for name in _NUMBERS}
    for name in ("mixed", "late"):  # of any of them
        stacked[name] = np.unique(np.concatenate([getattr(x, name) for x in every]), axis=0)
    return Model(
        TreeTables(own.tree, np.array(bodies), _of_one_length(roots)), senses._replace(**stacked), parameters
    )


def _of_one_length(roots: Sequence[np.ndarray]) -> np.ndarray:
    """Return roots as rows; of those with fewer tables the rest is not read."""
    out = np.zeros((len(roots), max(map(len, roots))))
    for row, root in zip(out, roots, strict=True):
        row[: len(root)] = root
    return out


def _by_load(instance: Instance) -> list[tuple[int, float]]:
    """Return the forces that go by the applied ones, by degree of freedom: inverse dynamics have no load."""
    return [(int(k), x.by_load()) for x in instance.model.loads if isinstance(x, Force) for k in x.rows]


_NUMBERS = ("places", "rest", "shapes", "drawn", "axes", "gain", "bias", "delay")


def _same(a: Readings, b: Readings) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in (*_NUMBERS, "later", "added"))


def senses_of(outputs: MeasurementModel) -> Readings | None:
    """Return sensors as arrays, ``None`` where one reads what compiled code does not know."""
    model, rows = outputs.model, outputs.data.rows
    start = 6 if model.free else 0
    scalars, bus, places, late, delay = [], [], [], [], np.zeros((1, rows))
    stations: list[tuple[int, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
    mixed, gain, bias = [], np.eye(rows)[None].copy(), np.zeros((1, rows))
    later, added = [], []
    twists = np.zeros((len(model.twists), 7))
    for k, (_, v, twist) in enumerate(model.twists):
        if twist.turning is not None:
            return None
        twists[k] = v - start, twist.read, twist.inertia, *twist.numbers
    for block in outputs.data.blocks:
        first, r = block.rows.start, np.asarray(block.sensor.position, dtype=float)
        if block.bend is not None or (block.quantity in ("attitude", "acceleration") and not model.free):
            return None
        if block.quantity in ("joint_position", "joint_velocity", "wheel_rate"):
            arm = block.quantity != "wheel_rate"
            group, motors = (model.arm_joints, model.motors) if arm else (model.wheels, ())
            behind = {i: kv - start for i, _, kv in motors}
            kind = ANGLE if block.quantity == "joint_position" else TURN_RATE
            scalars += [(first + i, kind, int(v) - start, behind.get(i, -1)) for i, v in enumerate(group.v)]
        elif block.quantity in BUS:
            if model.free:
                bus.append((first, BUS[block.quantity]))
                places.append(r)
        elif block.sensor.kind == "accelerometers":
            own = outputs.stations(block)
            for k in range(len(own.rest)):
                drawn = np.zeros((len(own.v),) * 2) if own.drawn is None else own.drawn[k]
                stations.append((first + 3 * k, own.v - start, own.rest[k], own.shapes[k], drawn, own.axis))
        else:
            nothing = np.zeros((3, 0)), np.zeros((0, 0)), np.zeros(3)
            stations.append((first, np.zeros(0, dtype=int), r, *nothing))
        if block.quantity == "attitude":
            bias[0, block.rows] = block.bias
        elif not block.plain:
            width = len(block.gain)
            for i in range(first, block.rows.stop, width):
                mixed.append((i, width))
                gain[0, i : i + width, i : i + width], bias[0, i : i + width] = block.gain, block.bias
        if block.delay:
            late.append((first, block.rows.stop - first))
            delay[0, first] = block.delay
        for since, offset in block.later:
            later.append(since)
            more = np.zeros(rows)
            more[block.rows] = np.resize(offset, block.rows.stop - first)
            added.append(more)
    most = max((len(x[1]) for x in stations), default=0)
    n = len(stations)
    modes, rest, axes = np.full((n, most), -1, dtype=np.int64), np.zeros((1, n, 3)), np.zeros((1, n, 3))
    shapes, drawn = np.zeros((1, n, 3, most)), np.zeros((1, n, most, most))
    for k, (_, where, at, shape, pull, axis) in enumerate(stations):
        m = len(where)
        modes[k, :m], rest[0, k], axes[0, k] = where, at, axis
        shapes[0, k, :, :m], drawn[0, k, :m, :m] = shape, pull

    def integers(x: Sequence[tuple[int, ...]], width: int) -> np.ndarray:
        return np.array(x, dtype=np.int64).reshape(-1, width)

    return Readings(
        integers(scalars, 4),
        integers(bus, 2),
        np.array(places).reshape(1, -1, 3),
        np.array([x[0] for x in stations], dtype=np.int64),
        modes,
        rest,
        shapes,
        drawn,
        axes,
        integers(mixed, 2),
        gain,
        bias,
        np.array(later, dtype=float),
        np.array(added).reshape(len(later), rows),
        integers(late, 2),
        delay,
        twists,
    )
