"""Faults of single samples, found before any model is asked: stuck channels, coarse steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SimulationError
from smsid.estimation.kalman import run_filter
from smsid.estimation.map_estimate import MapFit
from smsid.estimation.measurements import ChannelSlice, Measurements


@dataclass(frozen=True)
class Fault:
    """A fault of one channel: ``kind`` is stuck, outliers or quantisation.

    ``component`` is the row's name; ``value`` is the time it stuck [s], the share of outliers, or the step
    [unit of the channel; of an attitude, 1: that of its quaternion's components], ``sigma`` its standard
    deviation; ``samples`` (N, rows) marks what to leave out.
    ``doubtful`` is one that reads in steps that show: what seems stuck may rest, see
    `smsid.diagnose._sensor_faults`.
    """

    kind: str
    channel: str
    component: str
    value: float
    sigma: float
    samples: np.ndarray
    doubtful: bool = False


def drop_samples(data: Measurements, faults: Sequence[Fault]) -> Measurements:
    """Return the data without the samples of faults."""
    for fault in faults:
        data = data.without(fault.samples)
    return data


def stuck_channels(data: Measurements) -> list[Fault]:
    """Return the channels that repeat one value to the end of the recording, or for long within it.

    A noisy channel does not repeat itself; one whose noise is below its rounding step may, and is then only
    called stuck when the repeats go far beyond what they are elsewhere. Those when the recording begins are
    of a rest, and tell how long rests last.
    """
    found = []
    for row, name in enumerate(data.names):
        block = next(b for b in data.blocks if b.rows.start <= row < b.rows.stop)
        x = _readings(data, block, row)
        there = np.flatnonzero(np.isfinite(x).all(axis=1))
        if len(there) < 2 * THRESHOLDS.stuck_run:
            continue
        same = np.append((np.diff(x[there], axis=0) == 0.0).all(axis=1), False)
        runs = _runs(same)
        rests = len(runs) > 1 and runs[0][0] == 0
        if not runs:
            continue
        start, length = max(runs[rests:], key=lambda r: r[1])
        others = max((n for s, n in runs if s != start), default=0)
        fine = not others and _is_finely_read(x[there, 0], float(data.sigma[row]))
        if length < (THRESHOLDS.repeats if fine else THRESHOLDS.stuck_run) or length < 4 * others:
            continue
        marked = np.zeros(data.values.shape, dtype=bool)
        marked[there[start + 1 : start + length + 1], row] = True
        step = float(np.median(np.diff(data.times)))
        begins = float(data.times[there[start]])
        found.append(Fault("stuck", block.channel, name, begins, step, marked, doubtful=not fine))
    return found


def _readings(data: Measurements, block: ChannelSlice, row: int) -> np.ndarray:
    """Return what a component is told by (N, d): its values, an attitude's all four of its quaternion."""
    return data.attitude[block.channel] if block.quantity == "attitude" else data.values[:, [row]]


def _is_finely_read(x: np.ndarray, sigma: float) -> bool:
    """Whether values are read in steps far below their noise, or in none that shows."""
    gaps = np.diff(np.unique(x))
    step = float(gaps.min(initial=np.inf))
    return sigma > THRESHOLDS.fine * step or (len(gaps) > THRESHOLDS.stuck_run and not _on_grid(gaps, step))


def quantised_channels(data: Measurements) -> list[Fault]:
    """Return the channels whose values lie on a grid that is coarse against their noise and not stated."""
    found = []
    for row, name in enumerate(data.names):
        block = next(b for b in data.blocks if b.rows.start <= row < b.rows.stop)
        if block.quantity == "attitude":
            continue
        x = data.values[np.isfinite(data.values[:, row]), row]
        gaps: np.ndarray = np.diff(np.unique(x)).astype(float)
        if len(gaps) < 3:
            continue
        step = min((float(g) for g in gaps[gaps > 1e-9 * np.ptp(x)]), default=np.inf)
        if not np.isfinite(step) or step < THRESHOLDS.coarse_step * data.sigma[row]:
            continue
        stated = block.sensor.error(block.quantity).quantisation
        if _on_grid(gaps, step) and step > 1.01 * stated:
            none = np.zeros(data.values.shape, dtype=bool)
            found.append(Fault("quantisation", block.channel, name, step, 1e-3 * step, none))
    return found + _slow_beside(data, found) + _rounded_attitudes(data)


def _rounded_attitudes(data: Measurements) -> list[Fault]:
    """Return the components of attitudes whose quaternions are read in steps not stated."""
    found = []
    for block in data.blocks:
        if block.quantity != "attitude":
            continue
        there = np.isfinite(data.values[:, block.rows]).all(axis=1)
        least = 0.3 * float(data.sigma[block.rows].max()) / 2.0  # a step is a turn of two [rad]
        read = data.attitude[block.channel][there]
        if any(block.sensor.orientation) and len(read):  # it is rounded in its own axes
            read = (Rotation.from_quat(read) * Rotation.from_matrix(block.sensor.rotation)).as_quat()
        coarse = step_of(read, least)
        stated = block.sensor.error(block.quantity).quantisation
        if coarse is not None and coarse[0] - 3.0 * coarse[1] > 1.01 * stated:
            none = np.zeros(data.values.shape, dtype=bool)
            found += [Fault("quantisation", block.channel, name, *coarse, none) for name in block.names]
    return found


def _on_grid(x: np.ndarray, step: float) -> bool:
    return bool(np.abs(x / step - np.round(x / step)).max(initial=0.0) < 1e-3)


def _slow_beside(data: Measurements, found: Sequence[Fault]) -> list[Fault]:
    """Return the components that move too little to show a grid, but lie on that of another."""
    grids = {f.channel: f for f in found}
    known, more = {f.component for f in found}, []
    for block in data.blocks:
        for row, name in zip(range(block.rows.start, block.rows.stop), block.names, strict=True):
            x = data.values[np.isfinite(data.values[:, row]), row]
            beside = grids.get(block.channel)
            if beside is not None and name not in known and len(x) and _on_grid(x, beside.value):
                more.append(replace(beside, component=name))
    return more


def inflate_for_quantisation(data: Measurements, rounded: Sequence[Fault]) -> Measurements:
    """Return the samples with the noise that reading in steps adds: a uniform error of each step.

    It lasts as long as the value does: a slow component that stays on one step for n samples tells as much as
    one of them, so that each of them counts as noisier by the root of n.
    """
    factor, held = np.ones(data.rows), np.zeros(data.rows, dtype=bool)
    for fault in rounded:
        row = data.names.index(fault.component)
        block = next(b for b in data.blocks if b.rows.start <= row < b.rows.stop)
        x = _readings(data, block, row)[np.isfinite(data.values[:, row])]
        lasts = len(x) / (1.0 + np.count_nonzero((np.diff(x, axis=0) != 0.0).any(axis=1)))
        step = 2.0 * fault.value if block.quantity == "attitude" else fault.value
        factor[row] = np.hypot(1.0, step * np.sqrt(lasts / 12.0) / data.sigma[row])
        held[row] = True
    return replace(data.scaled(factor), coarse=held)


def _runs(flags: np.ndarray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [(int(a), int(b - a)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def resting_channels(found: MapFit, whole: Measurements, faults: Sequence[Fault]) -> list[Fault]:
    """Return the doubtful faults among ``faults`` that are none: the model predicts that the channel rests.

    ``found`` was fitted without their samples, and to some of ``whole`` as they were recorded. The samples of
    each are filtered again, and rest where they fit the motion that all other channels tell.
    """
    return [f for f in faults if f.doubtful and _fits(found, whole, f)]


def _fits(found: MapFit, whole: Measurements, fault: Fault) -> bool:
    problem = found.problem
    kept = np.searchsorted(whole.times, problem.data.times)
    values = np.where(fault.samples[kept], whole.values[kept], problem.data.values)
    data = replace(problem.data, values=values)
    try:
        run = run_filter(found.point.model(), replace(problem, data=data))
    except SimulationError:
        return False
    more = float((run.innovations**2).sum() - (found.run.innovations**2).sum())
    return more < THRESHOLDS.at_rest**2 * (run.samples - found.run.samples)


ROWS = 60  # readings that are looked at
FIRST = 6  # of them: when most of these are on no grid, it is left at that
ENOUGH = THRESHOLDS.grid_told
PRECISIONS = (2e-12, 2e-7)  # of double and of single numbers, a few roundings of them
FINEST = 30_000  # steps to a unit
COARSEST = 0.5  # step above which a few exact attitudes, at right angles to each other, pass for rounded


def step_of(quaternions: np.ndarray, least: float) -> tuple[float, float] | None:
    """Return the step [1] of unit quaternions (N, 4) and its standard deviation; ``None`` where there is none
    or it is below ``least``, at 0.5 or above, or finer than 1 / 30,000.

    Rounded to a step s, a quaternion is n s with n whole; normalised again, it still has the direction of n.
    The smallest n of each reading is found by trial, as one ratio's denominator after the other; their
    lengths are 1 / s within one, or that divided by a common factor.
    """
    if len(quaternions) < ENOUGH:
        return None
    distinct = quaternions[np.append(True, (np.diff(quaternions, axis=0) != 0.0).any(axis=1))]
    some = distinct[np.unique(np.linspace(0, len(distinct) - 1, ROWS).astype(int))]
    if len(some) < ENOUGH:
        return None
    largest = int(min(1.0 / max(least, 1e-12), FINEST))
    for precision in PRECISIONS:
        first = some[:: max(1, len(some) // FIRST)]
        if np.isnan([_length(q, largest, precision) for q in first]).mean() > 0.5:
            continue
        found = _common(np.array([_length(q, largest, precision) for q in some]))
        if found is not None:
            return found
    return None


def _length(q: np.ndarray, largest: int, precision: float) -> float:
    """Return the length of the shortest whole vector that has the direction of ``q``, up to ``largest``."""
    top = np.abs(q).max()
    times = np.arange(1.0, largest + 1.0)
    off = np.zeros(largest)
    for ratio in q / top:
        at = ratio * times
        off = np.maximum(off, np.abs(at - np.round(at)))
    whole = np.flatnonzero(off < precision * times)
    return float(times[whole[0]] / top) if len(whole) else np.nan


def _common(lengths: np.ndarray) -> tuple[float, float] | None:
    """Return the step and its standard deviation that lengths (N,) have in common."""
    seen = lengths[np.isfinite(lengths)]
    if len(seen) < ENOUGH:
        return None
    length = float(np.median(seen[seen > 0.7 * seen.max()]))
    factor = np.round(length / seen)
    near = np.abs(factor * seen - length) < THRESHOLDS.off_grid
    own = seen[near & (factor == 1.0)]
    if len(own) < ENOUGH or np.count_nonzero(near) < THRESHOLDS.on_grid * len(lengths):
        return None
    step = 1.0 / float(own.mean())
    if step >= COARSEST:
        return None
    return step, max(step**2 * float(own.std()), 1e-6 * step)  # those of a slow turn are all alike
