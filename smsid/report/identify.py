"""The report of ``smsid identify``."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np

from smsid._listing import some_of
from smsid.description.schema import Description
from smsid.errors import SmsidError
from smsid.estimation.fit_quality import ChannelFit
from smsid.estimation.identify import IdentificationRun
from smsid.identify.estimate import Estimate, Iteration
from smsid.identify.estimate_text import asked_for
from smsid.identify.paper.pipeline import Identification
from smsid.likelihood.refine import Refinement
from smsid.model import build_model
from smsid.recording import Recording
from smsid.report._residuals import EXPLAINED, Residuals, residuals_of, trace_explorer
from smsid.report._spectra import spectrum_grid
from smsid.report.axes import Axis
from smsid.report.model import (
    Figure,
    Grid,
    Provenance,
    Report,
    Section,
    Table,
    Text,
    Tone,
    cells,
    notes_section,
)
from smsid.report.numbers import number, raise_exponents
from smsid.report.parameters import correlations, parameter_section
from smsid.report.plot import Curve, Plot, Rule
from smsid.report.stabilisation import diagrams, stabilisation_figures

LOGGER = logging.getLogger(__name__)
MOST = 6  # diagrams


def identify_report(
    description: Description,
    recordings: Sequence[Recording],
    linear: Identification,
    refined: Refinement | None,
    origin: Provenance,
) -> Report:
    """Return the report of an identification.

    Args:
        description: what it started from.
        recordings: what it was made from.
        linear: the linear method's result.
        refined: the refinement, if there is one.
        origin: versions, command, files.
    """
    estimate = refined.estimate if refined is not None else linear.estimate
    left: Sequence[Residuals] = ()
    own = asked_for(estimate)
    sections = [parameter_section(own, "Mass, slosh, appendages and single inertial parameters")]
    try:
        left = residuals_of(description, recordings, linear, refined)
        sections += residual_sections(left) if left else []
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("residuals: %s", error)
        text = Text((f"Not evaluated: {error}",))
        sections.append(Section("residuals", "Measured against simulated", (text,)))
    sections += convergence_section(estimate.history)
    sections += _modes(description, recordings, linear)
    sections += _aliases(refined)
    sections += notes_section((*linear.estimate.notes, *estimate.notes))
    sentence, tone = verdict(estimate, left)
    glance = [("identifiable", f"{sum(p.status == 'identifiable' for p in own)} of {len(own)}")]
    if "total.mass" in estimate:
        glance.append(("total mass", f"{number(estimate['total.mass'].value, 6)} kg"))
    worst = worst_ratio(left)
    glance += [("residual / noise, worst", number(worst[1], 3))] if worst else []
    seconds = linear.estimate.timing["total"] + (refined.estimate.timing["total"] if refined else 0.0)
    glance += [("time", f"{number(seconds, 3)} s")]
    method = "maximum likelihood" if refined is not None else "the paper's linear method"
    return Report(f"Identification by {method}", description.name, sentence, tone, sections, origin, glance)


def residual_sections(left: Sequence[Residuals]) -> list[Section]:
    """Return measured against simulated, and the spectra of what is left."""
    caption = (
        "Above: measured (grey) and simulated (blue). Below: measured minus simulated, with twice the noise "
        "that samples show between each other. Attitudes are rotation vectors from the start."
    )
    parts = trace_explorer([t.alone() for r in left for t in r.traces], "Measured and simulated", caption)
    worst = worst_ratio(left)
    gist = f"largest residual / noise {number(worst[1], 3)}, {worst[0]}" if worst else ""
    groups = {f"{r.recording}: {c}": traces for r in left for c, traces in r.channels.items()}
    grid = spectrum_grid("spectrum", groups, labels=("as described", "as identified"))
    before = "before: as described, initial pose and biases fitted"
    return [
        Section("residuals", "Measured against simulated", parts, gist),
        Section("spectra", "Spectra of the residuals, before and after", (grid,), before),
    ]


def verdict(estimate: Estimate, left: Sequence[Residuals]) -> tuple[str, Tone]:
    """Return one sentence on an identification, and what it is worth."""
    own = asked_for(estimate)
    weak = [p.name for p in own if p.status != "identifiable"]
    good = len(own) - len(weak)
    sentence = f"{good} of {len(own)} parameters are identified to better than 10 % (one standard deviation)"
    if weak:
        sentence += f"; not {some_of(weak)}"
    worst = worst_ratio(left)
    if worst is None:
        return f"{sentence}. Whether the simulation explains the recordings was not evaluated.", "neutral"
    if worst[1] <= EXPLAINED:
        return f"{sentence}. The simulation explains every channel to its noise.", "good" if good else "warn"
    text = f"The simulation leaves {number(worst[1], 3)} times the noise in {worst[0]}"
    return f"{sentence}. {text}; smsid diagnose says why.", "warn" if worst[1] < 2.0 else "bad"


def worst_ratio(left: Sequence[Residuals]) -> tuple[str, float] | None:
    """Return the channel with the largest residual beside its noise, with the ratio."""
    pairs = [(t.name, t.whitened_rms) for r in left for t in r.traces if t.sigma]
    return max(pairs, key=lambda x: x[1]) if pairs else None


def _modes(
    description: Description, recordings: Sequence[Recording], linear: Identification
) -> list[Section]:
    if linear.translation is None or not linear.translation.modes:
        return []
    known = {name: seen.modes.clamped for name, seen in linear.translation.modes.items()}
    model = build_model(description)
    try:
        found = [d for r in recordings for d in diagrams(model, r, known)][:MOST]
    except SmsidError as error:
        LOGGER.info("stabilisation diagram: %s", error)
        return []
    figures = stabilisation_figures(found)
    if not figures:
        return []
    caption = (
        "Poles of SSI-COV with the base acceleration as known input, by model order. A ring has the same "
        "frequency, damping and shape one order below. Modes are clusters of rings, no order picked by hand."
    )
    grid = Grid("Poles over model orders", figures, caption)
    count = sum(len(d.modes) for d in found)
    return [Section("modes", "Stabilisation diagram", (grid,), f"{count} modes read")]


def _aliases(refined: Refinement | None) -> list[Section]:
    if refined is None:
        return []
    own = asked_for(refined.estimate)
    figure = correlations("correlation", refined.estimate.parameters[: len(own)],
                          refined.covariance[: len(own), : len(own)])  # fmt: skip
    lines = tuple(raise_exponents(d.text) for d in refined.unseen)
    out = []
    if figure is not None:
        out.append(Section("aliases", "What moves together", (figure,), "correlations of estimates"))
    if lines:
        gist = f"{len(lines)} directions, in words"
        out.append(Section("unseen", "What is not seen", (Text(lines, True),), gist, open=False))
    return out


TICKS = 8
WIDE = 10.0  # ratio of costs above which their axis is logarithmic
PLOT_HEIGHT = 190


def convergence_section(history: Sequence[Iteration]) -> list[Section]:
    """Return the section "Convergence of the fit"; none for a method that does not iterate."""
    if len(history) < 2:
        return []
    cost = np.array([x.cost for x in history])
    # a start has no step, and what is exactly zero no place on a logarithmic axis
    step = np.array([x.step or math.nan for x in history])
    starts = [k for k, x in enumerate(history) if x.step is None][1:]
    rules = tuple(Rule("searched again", float(k), colour=2) for k in starts)
    n = np.arange(len(history), dtype=float)
    y = Axis.over("cost / samples", [cost], log=bool(cost.max() > WIDE * cost.min()), count=5)
    alt = f"cost by iteration, from {number(cost[0], 5)} to {number(cost[-1], 5)}"
    marks = (*rules, Curve("", n, cost), Curve("", n, cost, 0, "points"))
    body = Plot(_iteration_axis(len(history)), y, marks, alt, PLOT_HEIGHT)
    figures = [Figure("fit-cost", "Sum of squares per sample", body)]
    if np.isfinite(step).any():
        y = Axis.over("step [σ]", [step, [1.0]], log=True, count=5)
        alt = "largest step of a parameter by iteration"
        marks = (*rules, Rule("one σ", 1.0, False, 2), Curve("", n, step), Curve("", n, step, 0, "points"))
        body = Plot(_iteration_axis(len(history)), y, marks, alt, PLOT_HEIGHT)
        figures.append(Figure("fit-steps", "Largest step of a parameter", body))
    caption = (
        "Cost: residuals and priors in standard deviations of the noise, squared and summed. The noise is "
        "that of the residuals at the end, so that the cost ends near one, however good the fit. Step: how "
        "far the parameter that moved most went, in its own standard deviation. The search ends where the "
        "next step would gain next to nothing."
    )
    grid = Grid("The maximum-likelihood search, iteration by iteration", figures, caption)
    gist = f"{len(history) - 1} iterations"
    gist += "" if history[-1].step is None else f", last step {number(history[-1].step, 2)} σ"
    return [Section("convergence", "Convergence of the fit", (grid,), gist)]


def _iteration_axis(count: int) -> Axis:
    every = math.ceil((count - 1) / TICKS)
    room = 0.04 * (count - 1)
    ticks = tuple((float(k), str(k)) for k in range(0, count, every))
    return Axis("iteration", -room, count - 1 + room, ticks=ticks)


FIT_TONES: dict[str, Tone] = {"explained": "good", "roughly": "warn", "not explained": "bad"}


def flights_report(description: Description, found: IdentificationRun, origin: Provenance) -> Report:
    """Return the report of an identification that a filter made.

    Args:
        description: what it started from.
        found: the identification.
        origin: versions, command, files.
    """
    estimate, quality = found.estimate, found.quality
    own = asked_for(estimate)
    sections: list[Section] = []
    if quality is not None:
        text = [quality.sentence, *(c.sentence for c in found.contradictions)]
        body = (Text(tuple(text), bullets=len(text) > 1), _channel_table(quality.channels))
        sections.append(Section("fit", "Does the model explain the recordings?", body))
    sections.append(parameter_section(own, "Mass, effects and single inertial parameters"))
    sections += convergence_section(estimate.history)
    sections += notes_section(estimate.notes)
    good = [p for p in own if p.status == "identifiable"]
    sentence = quality.sentence if quality is not None else f"{len(own)} parameters are estimated."
    tone: Tone = "neutral" if quality is None else FIT_TONES[quality.judgement]
    if found.contradictions:
        sentence, tone = found.contradictions[0].sentence, "bad"
    glance = [
        ("identifiable", f"{len(good)} of {len(own)}"),
        ("recordings", f"{len(estimate.recordings)}"),
        ("time", f"{number(estimate.timing['total'], 3)} s"),
    ]
    title = "Identification by maximum likelihood"
    return Report(title, description.name, sentence, tone, sections, origin, glance)


def _channel_table(channels: tuple[ChannelFit, ...]) -> Table:
    rows = []
    for c in channels:
        name, tone = f"{c.recording}: {c.channel}", FIT_TONES[c.judgement]
        rows.append(cells(name, (c.ratio, 3, tone), (c.correlation, 2), c.component))
    columns = ("channel", "#over its stated noise", "#largest autocorrelation", "worst component")
    note = (
        "1 is the sensors' noise; less where an input that nobody recorded is estimated from sample to sample"
    )
    return Table("What is left of each channel", columns, rows, note=note)
