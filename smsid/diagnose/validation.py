"""What an extended model gains on data it has not seen."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.diagnose._hidden_start import start_like
from smsid.diagnose._open_loop import open_loop
from smsid.diagnose._outliers import outliers
from smsid.diagnose._sensor_faults import Fault, drop_samples, stuck_channels
from smsid.diagnose.priors import sensor_errors
from smsid.errors import SmsidError
from smsid.estimation.clock_shift import clock_shift, on_shifted_clock
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.input_hold import locked_coordinates
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import run_filter
from smsid.estimation.map_estimate import fit
from smsid.estimation.measurements import measurements_of
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Problem
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

LOGGER = logging.getLogger(__name__)
OWN = 4  # steps at most that a recording's own errors of sensors are fitted in
SETTLE = 5.0  # [s] of a recording that a plot of an open-loop simulation takes its start from


@dataclass(frozen=True)
class ChannelGain:
    """One channel open loop: rms of measured minus simulated, as given, extended and refitted; and its noise.

    Each model simulates the recording by itself, from the initial state that it fits there (`open_loop`). Not
    a number where it loses the motion.
    """

    channel: str
    unit: str
    given: float
    extended: float
    noise: float
    refitted: float = float("nan")


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

    def in_words(self, *, extends: bool) -> str:
        """Return in a sentence what is gained; ``extends``: whether a cause was named."""
        if not np.isfinite(self.explained):
            return (
                "The model as given has no significant excess on the held-out data: there is nothing to gain."
            )
        given, other = (f"{x:.3g} times the noise" for x in (self.whitened_given, self.whitened_extended))
        if not extends:
            return (
                f"No cause was named, so that nothing is extended: data it has not seen are off by {other} "
                f"with the parameters refitted, by {given} as given."
            )
        if self.explained < 0.0:
            return (
                "The extension predicts data it has not seen worse than the model as given: off by "
                f"{other} instead of {given}."
            )
        share = f"{100.0 * self.explained:.3g} %"
        return f"The extension explains {share} of the excess chi-squared on data it has not seen."


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
    reads = [read_like(point, recording, like, rate) for point in (given, nominal)]
    stuck, wild = (frozenset(f.component for f in faults if f.kind == kind) for kind in ("stuck", "outliers"))
    if extended is not nominal or stuck or wild:
        reads.append(read_like(extended, recording, like, rate, stuck))
    samples, excess, opened = [], [], []
    for k, (model, problem) in enumerate(reads):  # a run is let go before the next: it takes much memory
        run = run_filter(model, problem)
        if wild and k == 2:
            here = [f for f in outliers(problem.data, run) if f.component in wild]
            problem = replace(problem, data=drop_samples(problem.data, here))
            run = run_filter(model, problem)
        samples.append(run.samples)
        excess.append(float((run.innovations**2).sum()) - run.samples)
        alone = _simulate_open_loop(model, problem, run)
        opened.append(None if alone is None else alone.errors)
    for of_models in (samples, excess, opened):
        of_models += of_models[1:2] if len(reads) == 2 else []
    rms = [float(np.sqrt(more / n + 1.0)) for more, n in zip(excess, samples, strict=True)]
    channels, data = [], problem.data
    there = np.isfinite(data.values)
    for block in data.blocks:
        given_, nominal_, extended_ = (_rms(errors, there, block.rows) for errors in opened)
        noise = float(np.sqrt(np.mean(data.sigma[block.rows] ** 2)))
        unit = recording.unit(block.channel)
        channels.append(ChannelGain(block.channel, unit, given_, extended_, noise, nominal_))
    own, (left, refitted, best), (more, fewer, least) = tuple(channels), rms, excess
    left_out = samples[0] - samples[2]
    return Gain(recording.name, samples[0], left, refitted, best, more, fewer, least, own, left_out)


def read_like(
    point: Point,
    recording: Recording,
    like: Problem,
    rate: float,
    stuck: frozenset[str] = frozenset(),
) -> tuple[SpacecraftModel, Problem]:
    """Return a model and a recording that was not searched as its problem, thinned to ``rate`` [Hz].

    The point is by the recording's clock, the model by the problem's. Noise levels are those of another
    problem, ``like``, where that has the channel. ``stuck`` components
    are left out where they are. Stated errors of sensors, which every recording has its own of, are fitted.
    """
    shift = clock_shift([recording])
    recording = recording.shifted(shift)
    description = on_shifted_clock(point.description, shift)
    point = replace(point, description=description, biases={})
    own = sensor_errors(point)
    model = point.model()
    whole = measurements_of(model, recording, point.description.effective_sensors())
    if stuck:
        whole = drop_samples(whole, [f for f in stuck_channels(whole) if f.component in stuck])
    fresh = whole.thinned(rate).with_blocks(point.sensors())
    known = dict(zip(like.data.names, like.data.sigma, strict=True))
    sigma = np.array([known.get(n, s) for n, s in zip(fresh.names, fresh.sigma, strict=True)])
    data, held = replace(fresh, sigma=sigma), locked_coordinates(model, recording)
    noise = replace(like.noise, shapes=())  # open loop nothing makes up for them
    problem = replace(like, recording=recording, data=data, locked=held, parts=(), noise=noise, shift=shift)
    problem = start_like(point, problem, like)
    return model, at_point(fit(point, own, problem, iterations=OWN).point, problem) if own else problem


def _simulate_open_loop(model: SpacecraftModel, problem: Problem, closed: FilterRun) -> FilterRun | None:
    """Return a simulation from the initial state the model fits; nothing where it loses the motion."""
    try:
        return open_loop(model, problem, closed)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("open loop is lost: %s", error)
        return None


def _rms(errors: np.ndarray | None, there: np.ndarray, rows: slice) -> float:
    if errors is None or not there[:, rows].any():
        return float("nan")
    return float(np.sqrt(np.mean(errors[:, rows][there[:, rows]] ** 2)))
