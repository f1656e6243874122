"""Tables of a diagnosis: causes with aliases, gain by channel, what remains, detection limits."""

from __future__ import annotations

import math
from collections.abc import Iterator

from smsid._statistics import NORMAL95
from smsid.diagnose.result import Diagnosis, FoundCause
from smsid.diagnose.validation import Gain
from smsid.report.axes import Axis
from smsid.report.model import Cell, Figure, Table, Text
from smsid.report.numbers import half, number, share, unit
from smsid.report.rows import Mark, Row, RowChart


def cause_tables(d: Diagnosis) -> Iterator[Table]:
    """Yield the causes, or hints where the whole stays unexplained, and the aliases of each."""
    hints = "Hints: they explain a part, and the whole stays unexplained"
    for title, causes in (("Causes with their parameters", d.causes), (hints, d.partial)):
        if not causes:
            continue
        rows = [row for c in causes for row in _parameters(c)]
        columns = ("cause", "where", "family", "parameter", "#value", "#95 % interval", "unit", "#believed",
                   "#likelihood ratio", "#corrected p")  # fmt: skip
        yield Table(title, columns, tuple(rows))
        aliases = [
            (
                Cell(f"{c.label} at {c.location}"),
                Cell(f"{a.shape} ({a.effect})"),
                Cell(a.location),
                Cell(number(a.correlation, 4), a.correlation),
                Cell(a.separate),
            )
            for c in causes
            for a in c.aliases
        ]
        if aliases:
            columns = ("cause", "not told from", "where", "#correlation", "an experiment that would tell")
            yield Table("Aliases in this experiment", columns, tuple(aliases))


def _parameters(c: FoundCause) -> list[tuple[Cell, ...]]:
    name = f"{c.label} ({c.effect})"
    if c.onset is not None:
        known_to = "" if c.onset_sigma is None else f" ± {number(NORMAL95 * c.onset_sigma, 2)}"
        name += f", from {number(c.onset, 4)}{known_to} s on"
    name += f", in '{c.recording}'" if c.recording else ""
    ratio, p = c.evidence.get("likelihood_ratio"), c.evidence.get("p_value")
    out = []
    for v in c.parameters:
        low, high = v.interval
        out.append(
            (
                Cell(name),
                Cell(c.location),
                Cell(c.family),
                Cell(v.name.partition(".")[2]),
                Cell(number(v.value, 5), v.value),
                Cell(half(v.value, low, high), 0.5 * (high - low)),
                Cell(unit(v.unit)),
                Cell("" if v.nominal is None else number(v.nominal, 5), v.nominal),
                Cell("" if ratio is None else number(ratio, 5), ratio),
                Cell("" if p is None else number(p, 2), p),
            )
        )
    return out


def gain_parts(g: Gain) -> list[Text | Table | Figure]:
    """Return the gain in words, by model, and by channel open loop."""
    models = (
        ("as given", g.whitened_given, g.excess_given),
        ("nominal parameters refitted", g.whitened_nominal, g.excess_nominal),
        ("extended", g.whitened_extended, g.excess_extended),
    )
    whole = Table(
        f"Whitened innovations on {g.recording} ({g.samples} samples)",
        ("model", "#whitened rms (noise: 1)", "#excess chi-squared"),
        tuple((Cell(n), Cell(number(w, 5), w), Cell(number(x, 5), x)) for n, w, x in models),
    )
    told = math.isfinite(g.explained)
    text = (
        f"The extension explains {share(g.explained, 3)} of the excess chi-squared on data it has not seen."
        if told
        else "The model as given has no significant excess on the held-out data: there is nothing to gain."
    )
    if g.left_out:
        text += f" {g.left_out} readings of sensors that are found faulty there, too, are left out with it."
    rows, table, values = [], [], []
    for c in g.channels:
        shown = "rad" if c.channel.endswith(".attitude") else unit(c.unit)  # compared as rotation vectors
        marks = (
            Mark(c.noise, series=2, shape="tick", tip=f"noise {number(c.noise, 3)} {shown}"),
            Mark(c.given, series=1, shape="ring", tip=f"as given {number(c.given, 3)} {shown}"),
            Mark(c.extended, series=0, shape="dot", tip=f"extended {number(c.extended, 3)} {shown}"),
        )
        marks = tuple(m for m in marks if m.value > 0.0)
        factor = c.given / c.extended if c.extended > 0.0 else math.nan
        rows.append(Row(f"{c.channel} [{shown}]", marks, f"÷ {number(factor, 3)}"))
        values += [m.value for m in marks]
        table.append(
            (
                Cell(c.channel),
                Cell(shown),
                Cell(number(c.given, 4), c.given),
                Cell(number(c.extended, 4), c.extended),
                Cell(number(c.noise, 4), c.noise),
                Cell(number(factor, 3), factor),
            )
        )
    chart = RowChart(
        Axis.over("open-loop error, rms (in each channel's unit)", values, log=True),
        tuple(rows),
        "open-loop errors by channel, as given and extended, beside the noise",
        (("as given", 1, "ring"), ("extended", 0, "dot"), ("noise", 2, "tick")),
    )
    figure = Figure(
        "gain-chart", "Simulated open loop: error by channel", chart, "To the right: the factor gained."
    )
    columns = ("channel", "unit", "#as given, rms", "#extended, rms", "#noise", "#factor")
    return [Text((text,)), whole, figure, Table("Open-loop error by channel", columns, tuple(table))]


def remaining_table(d: Diagnosis) -> Table:
    """Return the generic tests that are significant."""
    rows = tuple(
        (
            Cell(r.where),
            Cell(r.dependence),
            Cell(number(r.ratio, 5), r.ratio),
            Cell(str(r.freedom), float(r.freedom)),
            Cell(number(r.p_value, 2), r.p_value, "bad"),
        )
        for r in d.remaining
    )
    columns = ("equation or channel", "depends on", "#chi-squared", "#freedom", "#corrected p")
    return Table("Generic tests that are significant", columns, rows)


def limit_table(d: Diagnosis) -> Table:
    """Return the least strength of every candidate that the recording would have shown."""
    rows = tuple(
        (
            Cell(f"{x.shape} ({x.effect})"),
            Cell(x.location),
            Cell(x.parameter.partition(".")[2] or x.parameter),
            Cell(number(x.value, 3), x.value) if math.isfinite(x.value) else Cell("not excited"),
            Cell(unit(x.unit)),
        )
        for x in d.limits
    )
    columns = ("candidate", "where", "parameter", "#limit", "unit")
    note = (
        "Strength found with 95 % chance at the level used, everything nominal free to move within its prior."
    )
    return Table("Least strength this recording would have shown", columns, rows, note)
