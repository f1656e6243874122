"""Parameters in a report: the table with intervals, what is identifiable, and what moves together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from smsid._statistics import NORMAL95
from smsid.identify.estimate import IDENTIFIABLE_BELOW, ParameterEstimate
from smsid.report.axes import Axis
from smsid.report.heat import correlation_map
from smsid.report.model import Cell, Figure, Section, Table, Tone, cells
from smsid.report.numbers import half, share, unit
from smsid.report.rows import Bar, ChartRow, Mark, RowChart

if TYPE_CHECKING:
    from smsid.diagnose.result import Value

STATUS: dict[str, Tone] = {"identifiable": "good", "not_identifiable": "warn"}
SMALLEST = 1e-7  # relative: shares below are drawn at the end of the axis
ROWS = 70
ALIASES = 15


def parameter_table(title: str, parameters: Iterable[ParameterEstimate]) -> Table:
    """Return a table of parameters with intervals, beside the description."""
    parameters = tuple(parameters)
    guessed = any(p.nominal is not None for p in parameters)
    columns = ["parameter", "#value", "#95 % interval", "unit"] + (["#described"] if guessed else [])
    columns += ["#relative σ", "status"]
    rows = []
    for p in parameters:
        row = [*cells(p.name, (p.value, 6)), interval_cell(p), Cell(unit(p.unit))]
        row += cells(None if p.nominal is None else (p.nominal, 6)) if guessed else ()
        status = Cell(p.status.replace("_", " "), tone=STATUS.get(p.status, "neutral"))
        rows.append((*row, Cell(share(p.relative_sigma), p.relative_sigma), status))
    return Table(title, columns, rows)


def interval_cell(p: ParameterEstimate | Value) -> Cell:
    """Return the 95 % interval of a parameter: half of it, where it is symmetric."""
    low, high = p.interval
    return Cell(half(p.value, low, high), 0.5 * (high - low))


def identifiability(
    name: str, parameters: Sequence[ParameterEstimate], beside: str = "the description"
) -> Figure:
    """Return how well each parameter is known: its interval, and how far its nominal value, ``beside``, is.

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
        off = np.nan if p.nominal is None else max(p.relative_error(p.nominal, p.reference), SMALLEST)
        if math.isfinite(off):  # nothing is a share of zero
            items.append(Mark(off, series=5, shape="ring", tip=f"off {beside} by {share(off)}"))
            values.append(off)
        rows.append(ChartRow(p.name, items, f"± {share(width)}", tone="neutral" if known_well else "warn"))
    legend = [("half of the 95 % interval", 0, "bar")]
    legend += [("the same, not identifiable", 2, "bar")] if any(r.tone == "warn" for r in rows) else []
    described = any(p.nominal is not None for p in shown)
    legend += [(f"off {beside}", 5, "ring")] if described else []
    axis = Axis.over("share of the parameter's size", values, log=True, within=(SMALLEST, 1e3))
    alt = f"95 % intervals of {len(rows)} parameters relative to their size"
    chart = RowChart(axis, rows, alt, legend, ((IDENTIFIABLE_BELOW * NORMAL95, "limit of identifiable"),))
    caption = "Left is better."
    if described:
        caption += " A ring to the right of its bar: the recordings contradict the description's value."
    return Figure(name, "How well each parameter is known", chart, caption)


def parameter_section(parameters: Sequence[ParameterEstimate], single: str) -> Section:
    """Return the section "Parameters": those that are named alone, titled ``single``, then combinations."""
    parts: list[Figure | Table] = []
    mixed = "Combinations of inertial parameters that the motion depends on"
    for key, title, combined in (("single", single, False), ("mixed", mixed, True)):
        some = [p for p in parameters if (" " in p.name) is combined]
        if some:
            parts += [identifiability(f"known-{key}", some), parameter_table(title, some)]
    return Section("parameters", "Parameters", parts, f"{len(parameters)} with intervals")


def correlations(name: str, parameters: Sequence[ParameterEstimate], covariance: np.ndarray) -> Figure | None:
    """Return the parameters that most move together, as a map of correlations; covariance (n, n)."""
    sigma = np.sqrt(np.diag(covariance))
    index = np.flatnonzero(np.isfinite(sigma) & (sigma > 0.0))
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
