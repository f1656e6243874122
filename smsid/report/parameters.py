"""Parameters in a report: the table with intervals, what is identifiable, and what moves together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from smsid._statistics import NORMAL95
from smsid.identify.estimate import IDENTIFIABLE_BELOW, Estimate, ParameterEstimate
from smsid.identify.estimate_text import asked_for
from smsid.report.axes import Axis
from smsid.report.heat import correlation_map
from smsid.report.model import Cell, Figure, Section, Table, Tone, cells
from smsid.report.numbers import half, number, share, unit
from smsid.report.rows import Bar, Mark, Row, RowChart

STATUS: dict[str, Tone] = {"identifiable": "good", "not_identifiable": "warn"}
SMALLEST = 1e-7  # relative: shares below are drawn at the end of the axis
ROWS = 70
ALIASES = 15


@dataclass(frozen=True)
class Known:
    """What is known beside an estimate: the truth, the paper's errors [1], another method's estimate."""

    truth: Mapping[str, float] = field(default_factory=dict)
    paper: Mapping[str, float] = field(default_factory=dict)
    other: Estimate | None = None
    other_name: str = ""


def reported_parameters(estimate: Estimate) -> tuple[ParameterEstimate, ...]:
    """Return the parameters of a spacecraft in an estimate: no nuisances, no second view of the same."""
    return asked_for(estimate)


def parameter_table(title: str, parameters: Iterable[ParameterEstimate], known: Known) -> Table:
    """Return a table of parameters with intervals beside the description, the truth and another method."""
    parameters = tuple(parameters)
    guessed = any(p.nominal != known.truth.get(p.name) for p in parameters)
    columns = ["parameter", "#value", "#95 % interval", "unit"] + (["#described"] if guessed else [])
    columns += ["#truth", "#error"] if known.truth else []
    columns += [f"#{known.other_name}", "#95 %"] if known.other is not None else []
    columns += ["#relative σ", "status"]
    rows = []
    for p in parameters:
        row = [*cells(p.name, (p.value, 6)), _interval(p), Cell(unit(p.unit))]
        row += cells(None if p.nominal is None else (p.nominal, 6)) if guessed else ()
        if known.truth:
            row += _truth(p, known.truth.get(p.name))
        if known.other is not None:
            q = {q.name: q for q in known.other.parameters}.get(p.name)
            row += cells(None, None) if q is None else cells((q.value, 6), _interval(q))
        status = Cell(p.status.replace("_", " "), tone=STATUS.get(p.status, "neutral"))
        rows.append((*row, Cell(share(p.relative_sigma), p.relative_sigma), status))
    return Table(title, columns, rows)


def _interval(p: ParameterEstimate) -> Cell:
    low, high = p.interval
    return Cell(half(p.value, low, high), 0.5 * (high - low))


def _truth(p: ParameterEstimate, truth: float | None) -> tuple[Cell, ...]:
    if truth is None:
        return cells(None, None)
    low, high = p.interval
    error = p.relative_error(truth, p.reference)
    tone: Tone = "good" if low <= truth <= high else "warn"
    if math.isfinite(error):
        return cells((truth, 6), Cell(share(error), error, tone))
    off = p.absolute_error(truth)  # nothing is a share of zero
    return cells((truth, 6), Cell(f"{number(off, 2)} {unit(p.unit)}".rstrip(), off, tone))


def identifiability(name: str, parameters: Sequence[ParameterEstimate], known: Known) -> Figure:
    """Return how well each parameter is known: its interval, and how far truth, description and paper are.

    All relative to the parameter's size (of its kind on the body, for a small one), on one logarithmic axis.
    """
    shown = [p for p in parameters if math.isfinite(p.relative_sigma) and p.relative_sigma > 0.0][:ROWS]
    values: list[float] = [IDENTIFIABLE_BELOW * NORMAL95]
    rows = []
    for p in shown:
        width = NORMAL95 * p.relative_sigma
        known_well = p.status == "identifiable"
        items: list[Mark | Bar] = [Bar(width, 0 if known_well else 2, tip=f"± {share(width)}")]
        values.append(width)
        for label, value, series, shape in (
            ("description", p.nominal, 5, "ring"),
            ("truth", known.truth.get(p.name), 1, "dot"),
        ):
            if value is None or (label == "description" and known.truth):
                continue
            off = np.maximum(p.relative_error(value, p.reference), SMALLEST)
            if math.isfinite(off):  # not of a zero truth
                items.append(Mark(off, series=series, shape=shape, tip=f"off the {label} by {share(off)}"))
                values.append(off)
        if p.name in known.paper:
            off = max(known.paper[p.name], SMALLEST)
            items.append(Mark(off, series=4, shape="square", tip=f"the paper: {share(off)}"))
            values.append(off)
        rows.append(Row(p.name, items, f"± {share(width)}", tone="neutral" if known_well else "warn"))
    legend = [("half of the 95 % interval", 0, "bar")]
    legend += [("the same, not identifiable", 2, "bar")] if any(r.tone == "warn" for r in rows) else []
    described = not known.truth and any(p.nominal is not None for p in shown)
    legend += [("error against the truth", 1, "dot")] if known.truth else []
    legend += [("off the description", 5, "ring")] if described else []
    legend += [("error in the paper", 4, "square")] if any(p.name in known.paper for p in shown) else []
    axis = Axis.over("share of the parameter's size", values, log=True, within=(SMALLEST, 1e3))
    alt = f"95 % intervals of {len(rows)} parameters relative to their size"
    chart = RowChart(axis, rows, alt, legend, ((IDENTIFIABLE_BELOW * NORMAL95, "limit of identifiable"),))
    caption = "Left is better."
    if known.truth:
        caption += " The error against the truth lies within the bar for 95 % of parameters when intervals "
        caption += "are right."
    elif described:
        caption += " A ring to the right of its bar: the recordings contradict the description's value."
    return Figure(name, "How well each parameter is known", chart, caption)


def parameter_section(
    parameters: Sequence[ParameterEstimate], known: Known, single: str, prefix: str = ""
) -> Section:
    """Return the section "Parameters": those that are named alone, titled ``single``, then combinations."""
    parts: list[Figure | Table] = []
    mixed = "Combinations of inertial parameters that the motion depends on"
    for key, title, combined in (("single", single, False), ("mixed", mixed, True)):
        some = [p for p in parameters if (" " in p.name) is combined]
        if some:
            parts += [
                identifiability(f"{prefix}known-{key}", some, known),
                parameter_table(title, some, known),
            ]
    return Section(f"{prefix}parameters", "Parameters", parts, f"{len(parameters)} with intervals")


def correlations(name: str, parameters: Sequence[ParameterEstimate], covariance: np.ndarray) -> Figure | None:
    """Return the parameters that most move together, as a map of correlations; covariance (n, n)."""
    sigma = np.sqrt(np.diag(covariance))
    good = np.isfinite(sigma) & (sigma > 0.0)
    index = np.flatnonzero(good)
    if len(index) < 2:
        return None
    r = covariance[np.ix_(index, index)] / np.outer(sigma[index], sigma[index])
    strongest = np.abs(r - np.eye(len(r))).max(axis=1)
    kept = np.sort(np.argsort(-strongest)[:ALIASES])
    names = [parameters[int(index[k])].name for k in kept]
    labels = [clip_text(n, 30) for n in names]
    alt = "correlations of the parameters that move together most"
    body = correlation_map(names, labels, r[np.ix_(kept, kept)], alt)
    caption = (
        f"The {len(names)} parameters with the strongest correlations. Where two have almost one, this "
        "experiment knows their sum or difference better than either."
    )
    return Figure(name, "Alias matrix: which parameters move together", body, caption)


def clip_text(text: str, length: int) -> str:
    """Return a text of at most ``length`` characters."""
    return text if len(text) <= length else text[: length - 1] + "…"
