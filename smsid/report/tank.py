"""The report of ``smsid lab tank``: force measured and fitted, models compared, what sloshes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from smsid.lab.tank import COUNTS, TankFit, TankTest
from smsid.lab.tank_models import ABOVE, LEVEL, TankComparison
from smsid.report._residuals import trace_explorer
from smsid.report._traces import Trace
from smsid.report.axes import Axis
from smsid.report.model import Cell, Figure, Provenance, Report, Section, Table, Tone, cells, notes_section
from smsid.report.numbers import half, number, unit
from smsid.report.parameters import identifiability, parameter_table
from smsid.report.rows import ChartRow, Mark, RowChart

NOTE = (
    "Scale: what the named model leaves before the container moves, where nothing but noise is in the force."
)


def tank_report(name: str, test: TankTest, found: TankComparison, origin: Provenance) -> Report:
    """Return the report of a tank test.

    Args:
        name: of the recording.
        test: force and motion as they were compared.
        found: the models.
        origin: versions, command, files.
    """
    best = found.fits[found.named]
    quiet = best.quiet(test)
    traces = _traces(test, found, quiet)
    first = list(found.fits).index(found.named)
    simplest = next(iter(found.fits))
    labels = ("measured", "fitted", "residual", f"residual, {simplest}")
    caption = (
        "The force that moves the container, low-passed as it was compared. Below: measured minus fitted, "
        "with twice what is left before the motion. Choose another model to see what it leaves."
    )
    figure, left = trace_explorer(traces, "Force, measured and fitted", caption, labels, first=first,
                            band="± 2 σ at rest", scale="before the motion", note=NOTE)  # fmt: skip
    title, columns = "What every model leaves (choose one to see it above)", ("model", *left.columns[1:])
    left = replace(left, title=title, columns=columns)
    parameters = best.estimate.parameters
    chart = identifiability("known", [p for p in parameters if math.isfinite(p.sigma)])
    table = parameter_table(f"Model named: {found.named}", parameters)
    gist = f"{len(parameters)} with 95 % intervals"
    sections = (
        Section("parameters", "Parameters", (chart, table, _lags(test, best)), gist),
        Section("models", "Models compared", (_models(found), _values(found)), f"named: {found.named}"),
        Section("residuals", "Measured against fitted", (figure, left), name),
        *notes_section(best.estimate.notes),
    )
    sentence, tone = verdict(found, quiet)
    glance = [("model", found.named)]
    for label, key in (("slosh mass", "tank.slosh_mass"), ("frequency", "tank.frequency")):
        if key in best.estimate:
            p = best.estimate[key]
            glance.append((label, f"{number(p.value, 4)} {unit(p.unit)}"))
    glance.append(("left ringing down", f"{number(best.ring_down, 3)} N"))
    return Report("Tank test", name, sentence, tone, sections, origin, glance)


def verdict(found: TankComparison, quiet: float) -> tuple[str, Tone]:
    """Return one sentence on the test, with ``quiet`` left at rest [N], and what it is worth."""
    best = found.fits[found.named]
    e = best.estimate
    if not found.sloshes:
        sentence = f"A rigid container of {number(e['tank.rigid_mass'].value, 4)} kg is enough"
    else:
        m, f, d = (e[f"tank.{k}"] for k in ("slosh_mass", "frequency", "damping"))
        sentence = (
            f"{number(m.value, 3)} {half(m.value, *m.interval)} kg slosh at {number(f.value, 4)} "
            f"{half(f.value, *f.interval)} Hz, damping ratio {number(d.value, 2)}"
        )
        sentence += ", softer the larger the amplitude" if found.amplitude else ""
    ringing, moving = number(best.ring_down, 3), number(best.moving, 3)
    text = f"{ringing} N are left ringing down and {moving} N while moving"
    if not math.isfinite(quiet):
        return f"{sentence}; {text}. Nothing was recorded at rest before the motion.", "neutral"
    text += f", {number(quiet, 3)} N before the motion"
    if any("ended at a bound" in note for note in e.notes):
        return f"{sentence}; {text}. A parameter ended at a bound of its search.", "bad"
    if best.ring_down > ABOVE * quiet:
        return f"{sentence}; {text}: the model does not explain all of it.", "warn"
    if best.moving > ABOVE * quiet:
        return f"{sentence}; {text}: the ring-down is explained, the motion not to the end.", "warn"
    return f"{sentence}; {text}.", "good"


def _traces(test: TankTest, found: TankComparison, quiet: float) -> tuple[Trace, ...]:
    sigma = quiet if math.isfinite(quiet) and quiet > 0.0 else None
    rigid = next(iter(found.fits.values())).residual
    out = []
    for model, fit in found.fits.items():
        values = test.force, test.force - fit.residual, fit.residual
        was = None if fit.residual is rigid else rigid
        out.append(Trace(model, "N", test.time, *values, sigma, was))
    return tuple(out)


def _models(found: TankComparison) -> Table:
    rows = []
    for model, fit in found.fits.items():
        gain = found.gains.get(model)
        named = Cell("named", tone="good") if model == found.named else Cell("")
        left = (fit.ring_down, 3), (fit.moving, 3), None if gain is None else (gain, 3)
        rows.append(cells(model, COUNTS[model], *left, named))
    columns = ("model", "#parameters", "#left ringing down [N]", "#left moving [N]", "#gain", "")
    note = (
        "Gain: twice the increase of the log likelihood over the model named before, in independent samples; "
        "of two as rich the likelier comes first. A richer model is named where that is significant at "
        f"{LEVEL:g}."
    )
    return Table("What the data ask for", columns, rows, note)


def _values(found: TankComparison) -> Table:
    """Every model's parameters side by side."""
    estimates = [fit.estimate for fit in found.fits.values()]
    rows = []
    for name in dict.fromkeys(p.name for e in estimates for p in e.parameters):
        own = [next((p for p in e.parameters if p.name == name), None) for e in estimates]
        texts = [p and Cell(f"{number(p.value, 4)} {half(p.value, *p.interval)}", p.value) for p in own]
        rows.append(cells(name, *texts, next(unit(p.unit) for p in own if p)))
    columns = ("parameter", *(f"#{model}" for model in found.fits), "unit")
    return Table("Parameters by model, 95 % intervals", columns, rows)


def _lags(test: TankTest, best: TankFit) -> Figure:
    """The force's lag as the model has it, beside that of the cross-correlation, which knows no model."""
    p = best.estimate["tank.lag"]
    rows = []
    for label, value, (low, high) in (
        ("by the model", p.value, p.interval),
        ("by cross-correlation", test.lag.value, test.lag.interval),
    ):
        text = f"{number(1e3 * value, 3)} ms"
        rows.append(ChartRow(label, (Mark(1e3 * value, 1e3 * low, 1e3 * high),), text))
    ends = np.array([*p.interval, *test.lag.interval, 0.0]) * 1e3
    axis = Axis.over("force behind motion [ms]", [ends], room=0.08)
    chart = RowChart(axis, rows, "lag of the force behind the motion, two ways", rules=((0.0, "none"),))
    return Figure("lag", "Lag of the force", chart, "Intervals that do not meet: one of the clocks is off.")
