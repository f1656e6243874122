"""What an extended model gains on data it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.diagnose.faults import Fault, stuck_channels, without
from smsid.diagnose.outliers import outliers
from smsid.estimation.kalman import Problem, run_filter
from smsid.estimation.measurements import measured
from smsid.estimation.parameter_vector import Point
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

SETTLE = 5.0  # [s] of a validation recording that an open-loop simulation takes its start from


@dataclass(frozen=True)
class ChannelGain:
    """One channel open loop: rms of measured minus simulated, as given and extended, and its noise level."""

    channel: str
    unit: str
    given: float
    extended: float
    noise: float


@dataclass(frozen=True)
class Gain:
    """The model as given, with its nominal parameters refitted, and extended, on a validation recording.

    ``whitened`` are rms of the whitened innovations by model (noise floor: 1), ``excess`` what their sums of
    squares exceed the expected ones by. ``left_out`` readings of faulty sensors do not count for the extended
    model; where it simulates alone they count for none.
    """

    recording: str
    samples: int
    whitened_given: float
    whitened_nominal: float
    whitened_extended: float
    excess_given: float
    excess_nominal: float
    excess_extended: float
    channels: tuple[ChannelGain, ...]
    left_out: int = 0

    @property
    def explained(self) -> float:
        """Share of the given model's excess that is gone; not a number where there is no excess."""
        floor = 3.0 * np.sqrt(2.0 * self.samples)
        return 1.0 - self.excess_extended / self.excess_given if self.excess_given > floor else np.nan


def gain(
    given: Point,
    nominal: Point,
    extended: Point,
    recording: Recording,
    like: Problem,
    rate: float,
    faults: Sequence[Fault] = (),
) -> Gain:
    """Return what the extension gains on a recording, thinned to ``rate`` [Hz].

    Noise levels and timing are those of ``like``. With the extended model, what is stuck or an outlier in
    components with such ``faults`` is left out, as it was where they were found.
    """
    first, second = (_read(point, recording, like, rate) for point in (given, nominal))
    stuck, wild = (frozenset(f.component for f in faults if f.kind == kind) for kind in ("stuck", "outliers"))
    third = second
    if extended is not nominal or stuck or wild:
        third = _read(extended, recording, like, rate, stuck)
    closed = [run_filter(*first), run_filter(*second)]
    closed.append(closed[1] if third is second else run_filter(*third))
    if wild:
        model, problem = third
        here = [f for f in outliers(problem.data, closed[2]) if f.component in wild]
        third = model, replace(problem, data=without(problem.data, here))
        closed[2] = run_filter(*third)
    data = third[1].data
    begin = float(data.times[0]) + SETTLE  # corrected up to there only, to find its start
    opened = [run_filter(*read, until=begin) for read in (first, third)]
    excess = [float((r.innovations**2).sum()) - r.samples for r in closed]
    rms = [float(np.sqrt((r.innovations**2).sum() / r.samples)) for r in closed]
    channels = []
    later = data.times > begin
    there = np.isfinite(opened[1].errors)
    for block in data.blocks:
        errors = [_open_loop(np.where(there, run.errors, np.nan), later, block.rows) for run in opened]
        noise = float(np.sqrt(np.mean(data.sigma[block.rows] ** 2)))
        unit = recording.unit(block.channel)
        channels.append(ChannelGain(block.channel, unit, errors[0], errors[1], noise))
    name, samples = recording.name, closed[0].samples
    left_out = samples - closed[2].samples
    return Gain(
        name, samples, rms[0], rms[1], rms[2], excess[0], excess[1], excess[2], tuple(channels), left_out
    )


def _read(
    point: Point,
    recording: Recording,
    like: Problem,
    rate: float,
    stuck: frozenset[str] = frozenset(),
) -> tuple[SpacecraftModel, Problem]:
    model = point.model()
    whole = measured(model, recording, point.description.effective_sensors())
    if stuck:
        whole = without(whole, [f for f in stuck_channels(whole) if f.component in stuck])
    fresh = whole.thinned(rate)
    data = replace(fresh.with_blocks(point.sensors()), sigma=like.data.sigma)
    return model, replace(like, recording=recording, data=data)


def _open_loop(errors: np.ndarray, later: np.ndarray, rows: slice) -> float:
    x = errors[later, rows]
    return float(np.sqrt(np.nanmean(x**2))) if np.isfinite(x).any() else float("nan")
