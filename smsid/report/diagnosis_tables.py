"""Tables of a diagnosis: causes with aliases, gain by channel, what remains, detection limits."""

from __future__ import annotations

import math
from collections.abc import Iterator

from smsid._statistics import NORMAL95
from smsid._time_text import about_text
from smsid.diagnose.result import Diagnosis, FoundCause, Value
from smsid.diagnose.validation import Gain
from smsid.effects.base import Effect, known_effect
from smsid.report.axes import Axis
from smsid.report.model import Cell, Figure, Table, Text, cells
from smsid.report.numbers import number, unit, with_half
from smsid.report.parameters import interval_cell
from smsid.report.rows import ChartRow, Mark, RowChart


def cause_tables(d: Diagnosis) -> Iterator[Table]:
    """Yield the causes, or hints where the whole stays unexplained, and the aliases of each."""
    hints = "Hints: they explain a part, and the whole stays unexplained"
    for title, causes in (("Causes with their parameters", d.causes), (hints, d.partial)):
        if not causes:
            continue
        rows = [row for c in causes for row in _parameters(c)]
        columns = ("cause", "where", "family", "parameter", "#value", "#95 % interval", "unit", "#believed",
                   "#likelihood ratio", "#corrected p")  # fmt: skip
        yield Table(title, columns, rows)
        aliases = []
        for c in causes:
            for a in c.aliases:
                other = f"{a.shape} ({a.effect})", a.places, (a.correlation, 4), a.separate
                aliases.append(cells(f"{c.label} at {c.location}", *other))
        if aliases:
            columns = ("cause", "not told from", "where", "#correlation", "an experiment that would tell")
            yield Table("Aliases in this experiment", columns, aliases)


def _parameters(c: FoundCause) -> list[tuple[Cell, ...]]:
    name = f"{c.label} ({c.effect})"
    if c.onset is not None:
        known_to = "" if c.onset_sigma is None else f" ± {number(NORMAL95 * c.onset_sigma, 2)}"
        name += f", from {about_text(c.onset)}{known_to} s on"
    name += f", in '{c.recording}'" if c.recording else ""
    ratio, p = c.evidence.get("likelihood_ratio"), c.evidence.get("p_value")
    told = cells(None if ratio is None else (ratio, 5), None if p is None else (p, 2))
    out = []
    for v in c.parameters:
        known = (v.value, 5), interval_cell(v), unit(v.unit)
        believed = None if v.nominal is None else (v.nominal, 5)
        out.append(cells(name, c.places, c.family, v.name.partition(".")[2], *known, believed, *told))
    return out


def gain_parts(g: Gain, *, extends: bool = True) -> list[Text | Table | Figure]:
    """Return the gain in words, by model, and by channel open loop; ``extends``: a cause was named."""
    models = (
        ("as given", g.whitened_given, g.excess_given),
        ("nominal parameters refitted", g.whitened_nominal, g.excess_nominal),
        ("extended", g.whitened_extended, g.excess_extended),
    )
    whole = Table(
        f"Whitened innovations on {g.recording} ({g.samples} samples)",
        ("model", "#whitened rms (noise: 1)", "#excess chi-squared"),
        [cells(n, (w, 5), (x, 5)) for n, w, x in models],
    )
    text = g.in_words(extends=extends)
    if g.left_out:
        text += f" {g.left_out} readings of sensors that are found faulty there, too, are left out with it."
    rows, table, values = [], [], []
    for c in g.channels:
        shown = "rad" if c.channel.endswith(".attitude") else unit(c.unit)  # compared as rotation vectors
        levels = (
            ("noise", c.noise, 2, "tick"),
            ("as given", c.given, 1, "ring"),
            ("extended", c.extended, 0, "dot"),
        )
        marks = [
            Mark(x, series=series, shape=shape, tip=f"{name} {number(x, 3)} {shown}")
            for name, x, series, shape in levels
            if x > 0.0
        ]
        factor = c.given / c.extended if c.extended > 0.0 else math.nan
        rows.append(ChartRow(f"{c.channel} [{shown}]", marks, f"÷ {number(factor, 3)}"))
        values += [m.value for m in marks]
        sizes = ((x, 4) for x in (c.given, c.refitted, c.extended, c.noise))
        table.append(cells(c.channel, shown, *sizes, (factor, 3)))
    axis = Axis.over("open-loop error, rms (in each channel's unit)", values, log=True)
    alt = "open-loop errors by channel, as given and extended, beside the noise"
    chart = RowChart(axis, rows, alt, (("as given", 1, "ring"), ("extended", 0, "dot"), ("noise", 2, "tick")))
    title = "Simulated open loop: error by channel"
    figure = Figure("gain-chart", title, chart, "To the right: the factor gained.")
    columns = ("channel", "unit", "#as given, rms", "#refitted", "#extended", "#noise", "#factor")
    return [Text((text,)), whole, figure, Table("Open-loop error by channel", columns, table)]


def remaining_table(d: Diagnosis) -> Table:
    """Return the generic tests that are significant."""
    rows = [cells(r.where, r.dependence, (r.ratio, 5), r.freedom, (r.p_value, 2, "bad")) for r in d.remaining]
    columns = ("equation or channel", "depends on", "#chi-squared", "#freedom", "#corrected p")
    return Table("Generic tests that are significant", columns, rows)


def limit_table(d: Diagnosis) -> Table:
    """Return the least strength of every candidate that the recording would have shown."""
    rows = []
    for x in d.limits:
        least = (x.value, 3) if math.isfinite(x.value) else "not excited"
        parameter = x.parameter.partition(".")[2] or x.parameter
        rows.append(cells(f"{x.shape} ({x.effect})", x.location, parameter, least, unit(x.unit)))
    columns = ("candidate", "where", "parameter", "#limit", "unit")
    note = "Strength found with 95 % chance at the level used, all that is nominal free within its prior."
    return Table("Least strength this recording would have shown", columns, rows, note)


def plain_words(d: Diagnosis) -> str:
    """Return what a diagnosis found as one or two sentences; empty where it names no cause."""
    words = [cause_in_words(c) for c in d.causes]
    if len(words) > 1:
        words[-1] = f"and {words[-1]}"
    return f"In plain words: {'; '.join(words)}." if words else ""


def cause_in_words(cause: FoundCause) -> str:
    """Return a cause in words with its strength, when it began, and what it is not told from."""
    shape = cause.shape.replace("_", " ") if cause.shape else ""
    effect = known_effect(cause.effect) or Effect
    template = effect.in_words
    kind = effect.summary or f"{cause.effect.replace('_', ' ')}{f', {shape}' if shape else ''}"
    what = " ".join(template.format(place=cause.places, shape=shape, kind=kind).split())
    value = strength(cause)
    if value is not None:
        what += f", {quantity(value)}"
        if value.nominal is not None:
            what += f" instead of {number(value.nominal, 4)}"
    if cause.onset is not None:
        what += f", from {about_text(cause.onset)} s on"
    if cause.recording:
        what += f", in the recording '{cause.recording}'"
    others = [f"{a.shape.replace('_', ' ')} at {a.places}" for a in cause.aliases[:2]]
    return what + (f" (this flight does not tell it from {' or '.join(others)})" if others else "")


def strength(cause: FoundCause) -> Value | None:
    """Return the parameter of a cause that is known best beside its size, as far as it has any."""
    own = [p for p in cause.parameters if p.sigma > 0.0]
    return max(own, key=lambda p: abs(p.value - (p.nominal or 0.0)) / p.sigma, default=None)


def quantity(p: Value) -> str:
    """Return a parameter with half its 95 % interval and its unit."""
    if p.profile is not None:
        low, high = (number(x, 2) for x in p.profile)
        return f"{number(p.value, 3)} ({low} to {high}) {unit(p.unit)}".rstrip()
    if p.name.endswith(".time"):
        return f"{about_text(p.value)} ± {number(NORMAL95 * p.sigma, 2)} {unit(p.unit)}"
    return f"{with_half(p.value, NORMAL95 * p.sigma)} {unit(p.unit)}".rstrip()
