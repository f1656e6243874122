"""Measured against several models simulated open loop, in the channels where they differ most."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from smsid._time_text import about_text
from smsid.diagnose.validation import SETTLE, Gain, read_like
from smsid.errors import SmsidError
from smsid.estimation.kalman import run_filter
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Problem
from smsid.model.column_order import order_columns
from smsid.recording import Recording
from smsid.report._traces import Trace, rotation_vectors
from smsid.report.axes import Axis
from smsid.report.model import Cell, Figure, Grid, Part, Section, Table, Text, cells
from smsid.report.numbers import number, share, unit
from smsid.report.plot import Curve, Plot, Rule

LOGGER = logging.getLogger(__name__)
SHOWN = 4
VISIBLE = 3.0  # times its noise that an error must have to be shown
POINTS = 900


@dataclass(frozen=True)
class Component:
    """One component of a channel: ``measured`` (N,) and, by model, ``simulated`` and ``errors`` (N,).

    An attitude's values are rotation vectors from the first sample. Errors are measured minus simulated.
    """

    name: str
    channel: str
    unit: str
    measured: np.ndarray
    simulated: Mapping[str, np.ndarray]
    errors: Mapping[str, np.ndarray]
    noise: float


@dataclass(frozen=True)
class OpenLoop:
    """A recording and models simulated alone from ``begin`` [s] on; ``failed`` says which could not be."""

    recording: str
    times: np.ndarray
    begin: float
    components: tuple[Component, ...]
    models: tuple[str, ...]
    failed: Mapping[str, str]

    def rms(self, component: Component, model: str) -> float:
        """Return the root mean square error of a component from ``begin`` on, in its unit."""
        x = component.errors[model][self.times > self.begin]
        return float(np.sqrt(np.nanmean(x**2))) if np.isfinite(x).any() else float("nan")

    def traces(self, before: str, after: str) -> list[Trace]:
        """Return every component as the model ``after`` simulates it, with the error of ``before``."""
        out = []
        for c in self.components:
            values = c.measured, c.simulated[after], c.errors[after], c.noise, c.errors[before]
            out.append(Trace(c.name, c.unit, self.times, *values))
        return out

    def channel_rms(self, channel: str, model: str) -> float:
        """Return the root mean square error of a whole channel, over components and samples."""
        own = [self.rms(c, model) for c in self.components if c.channel == channel]
        return float(np.sqrt(np.mean(np.square(own))))


def open_loop(models: Mapping[str, Point], like: Problem, recording: Recording, rate: float) -> OpenLoop:
    """Simulate models open loop on a recording.

    Each starts from a state filtered over the first `SETTLE` seconds and is never corrected after them.

    Args:
        models: by name, in the order to be shown; the channels are those of the last.
        like: the problem whose noise levels and timing hold here too.
        recording: what was measured.
        rate: most samples a second [Hz].

    A model that cannot be simulated is named in ``failed``; raises `SmsidError` where none can.
    """
    runs, data, failed = {}, like.data, {}
    recording = order_columns(recording, next(iter(models.values())).model())
    with threadpool_limits(limits=1, user_api="blas"):
        for name, point in models.items():
            try:
                model, problem = read_like(point, recording, like, rate)
                data = problem.data
                runs[name] = run_filter(model, problem, until=float(data.times[0]) + SETTLE)
            except (SmsidError, np.linalg.LinAlgError) as error:
                LOGGER.info("%s, open loop: %s", name, error)
                failed[name] = str(error)
    if not runs:
        raise SmsidError(f"No model can be simulated on '{recording.name}': {'; '.join(failed.values())}")
    components = []
    for block in data.blocks:
        attitude = block.quantity == "attitude"
        unit = "rad" if attitude else recording.units.get(block.channel, "")
        label = block.channel.replace(".", " ", 1).replace("_", " ")
        rows = list(range(block.rows.start, block.rows.stop))
        errors = {name: run.errors[:, rows] for name, run in runs.items()}
        if attitude:
            samples = data.attitude[block.channel]
            values = rotation_vectors(samples)
            simulated = {name: rotation_vectors(samples, error) for name, error in errors.items()}
        else:
            values = data.values[:, rows]
            simulated = {name: run.predicted[:, rows] for name, run in runs.items()}
        for k, row in enumerate(rows):
            own = data.names[row].replace(".", " ", 1).replace("_", " ")
            made, off = ({name: x[:, k] for name, x in several.items()} for several in (simulated, errors))
            components.append(Component(own, label, unit, values[:, k], made, off, float(data.sigma[row])))
    times = problem.own_times
    begin = float(times[0]) + SETTLE
    return OpenLoop(recording.name, times, begin, tuple(components), tuple(runs), failed)


def most_different(found: OpenLoop, before: str, after: str, most: int = SHOWN) -> tuple[Component, ...]:
    """Return the components in which two models differ most beside what was measured, one a channel."""
    best: dict[str, tuple[float, Component]] = {}
    for c in found.components:
        was, now = found.rms(c, before), found.rms(c, after)
        span = float(np.nanmax(c.measured) - np.nanmin(c.measured))
        if not (was > VISIBLE * c.noise and was > now and span > 0.0):
            continue
        score = (was - now) / span
        if c.channel not in best or score > best[c.channel][0]:
            best[c.channel] = (score, c)
    return tuple(c for _, c in sorted(best.values(), key=lambda x: -x[0])[:most])


def curves(found: OpenLoop, shown: Sequence[Component], title: str, colours: Mapping[str, int]) -> Grid:
    """Return small figures of measured and simulated over time; ``colours``: of the models, last on top."""
    step = max(1, len(found.times) // POINTS)
    t, simulated = found.times[::step], [m for m in colours if m in found.models]
    figures = []
    for k, c in enumerate(shown):
        drawn = [Curve("measured", t, c.measured[::step], 2, "broad")]
        drawn += [Curve(m, t, c.simulated[m][::step], colours[m]) for m in simulated]
        # a model that runs away is cut off: what was measured has to be seen
        low, high = float(np.nanmin(c.measured)), float(np.nanmax(c.measured))
        room = 1.5 * (high - low)
        near = [np.clip(x.y, low - room, high + room) for x in drawn]
        label = f"{c.name} [{unit(c.unit)}]" if unit(c.unit) else c.name
        x, y = Axis.over("time [s]", [t], room=0.0, count=6), Axis.over(label, near, count=5, room=0.14)
        alt = f"{c.name}: measured, and simulated by {' and by '.join(colours)}"
        plot = Plot(x, y, (*drawn, Rule("simulated alone from here", found.begin)), alt, 230)
        tells = ", ".join(f"{m} {number(found.rms(c, m), 2)}" for m in simulated)
        caption = f"Error, rms [{unit(c.unit)}]: {tells}; noise {number(c.noise, 2)}."
        figures.append(Figure(f"before-after-{k}", c.name, plot, caption))
    caption = (
        f"Only the commands of '{found.recording}' are given to the models: each starts from the state known "
        f"after {SETTLE:g} s and is not corrected after that."
    )
    failed = "".join(f" Not simulated: {m} ({why})." for m, why in found.failed.items())
    return Grid(title, figures, caption + failed, wide=True)


def error_table(found: OpenLoop, before: str, after: str) -> Table:
    """Return the error of every channel by model, its noise, and the factor from one model to another."""
    rows = []
    for channel in dict.fromkeys(c.channel for c in found.components):
        own = [c for c in found.components if c.channel == channel]
        noise = float(np.sqrt(np.mean([c.noise**2 for c in own])))
        rms = {m: found.channel_rms(channel, m) for m in found.models}
        gained = Cell("–")
        if before in rms and after in rms and rms[after] > 0.0:
            factor = rms[before] / rms[after]
            gained = Cell(f"÷ {number(factor, 3)}", factor, "good" if factor > 1.2 else "neutral")
        rows.append(cells(channel, unit(own[0].unit), *((x, 3) for x in rms.values()), (noise, 3), gained))
    columns = ("channel", "unit", *(f"#{m}" for m in found.models), "#noise", "#gained")
    note = f"Root mean square from {about_text(found.begin)} s on. Gained: from '{before}' to '{after}'."
    return Table(f"Error of the simulation on '{found.recording}'", columns, rows, note)


PALETTE = (1, 4, 0)


def story_section(
    models: Mapping[str, Point],
    like: Problem,
    recording: Recording,
    *,
    seen: bool,
    rate: float,
    gain: Gain | None = None,
) -> tuple[Section, OpenLoop | None]:
    """Return measured against simulated before and after, with the errors, and what it was made from.

    Args:
        models: by what they are called, from the one as given to the extended one; two or three.
        like: the problem whose noise levels and timing hold.
        recording: what is simulated; ``seen``: whether the diagnosis was made from it.
        rate: most samples a second [Hz].
        gain: of the extension on this recording, where it was evaluated.
    """
    title = "Measured against simulated, before and after"
    kind = "the recording that was diagnosed" if seen else "a recording not used for estimation or diagnosis"
    try:
        found = open_loop(models, like, recording, rate)
    except SmsidError as error:
        LOGGER.info("open loop: %s", error)
        return Section("story", title, (Text((f"Not evaluated: {error}",)),), kind), None
    before, after = next(iter(models)), list(models)[-1]
    parts: list[Part] = []
    if before in found.models and after in found.models:
        palette = dict(zip(models, PALETTE if len(models) == 3 else (PALETTE[0], PALETTE[-1]), strict=True))
        heading = f"'{recording.name}': {kind}"
        if shown := most_different(found, before, after):
            parts.append(curves(found, shown, heading, palette))
        else:
            parts.append(Text(("In no channel do the models differ by more than three times its noise.",)))
    parts.append(error_table(found, before, after))
    if gain is not None and math.isfinite(gain.explained):
        parts.insert(1, Text((gain_sentence(gain),)))
    return Section("story", title, parts, kind), found


def gain_sentence(g: Gain) -> str:
    """Return what an extension gains on a recording not used, in one sentence."""
    return (
        f"On '{g.recording}', which was not used, predictions one sample ahead are off by "
        f"{number(g.whitened_given, 3)} times the noise with the model as given, by "
        f"{number(g.whitened_nominal, 3)} with its parameters refitted and nothing added, and by "
        f"{number(g.whitened_extended, 3)} with the cause: "
        + (
            f"{share(g.explained, 4)} of what exceeds the noise is gone."
            if g.explained >= 0.0
            else "it predicts worse."
        )
    )
