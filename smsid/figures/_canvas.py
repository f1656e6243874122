"""Figures of reports on paper: size of a column, colours that everyone can tell apart, fonts that print."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from smsid._files import atomic_write, check_target
from smsid.errors import SmsidError, require
from smsid.report.heat import STEPS, HeatMap
from smsid.report.model import Figure as Chart
from smsid.report.parameters import clip_text
from smsid.report.plot import Band, Plot, Rule, Style
from smsid.report.rows import Bar, Mark, RowChart

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#0063a3", "#c44f00", "#8a919c", "#00845f", "#a8468a", "#9a7400")
SHADES = ("#eeeeea", "#e0e3e0", "#cfd6d6", "#f6d9a6", "#eda95c", "#d96f32", "#ad3b34", "#661f45")  # of a map
CURVES: dict[Style, dict[str, Any]] = {
    "line": {"lw": 0.8},
    "thin": {"lw": 0.6},
    "broad": {"lw": 2.0},
    "dash": {"ls": "--"},
    "points": {"marker": ".", "ls": "none", "ms": 3},
    "ticks": {"marker": ".", "ls": "none", "ms": 3},
    "rings": {"marker": "o", "ls": "none", "ms": 4, "mfc": "none"},
}
MARKERS = {"dot": "o", "ring": "o", "square": "D", "tick": "|"}
WIDE = 7.16  # [in] of two columns
FORMATS = (".png", ".svg", ".pdf")
STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e4e1",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "savefig.dpi": 300,
    "figure.constrained_layout.use": True,
}


def picture(charts: Sequence[Chart], title: str = "") -> Figure:
    """Return figures of a report as one for print: plots below each other, rows and maps side by side.

    No window is opened. Raises `MissingDependencyError` without matplotlib.
    """
    require("matplotlib", "plot")
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    bodies = [chart.body for chart in charts]
    plots = [b for b in bodies if isinstance(b, Plot)]
    heights = [0.01 * b.height for b in plots] or [1.0 + 0.18 * len(b.rows) for b in bodies]  # type: ignore[union-attr]
    # what has the same axis, or the same rows, says so once
    same = len({str(b.x if isinstance(b, Plot) else [getattr(r, "name", r) for r in b.rows]) for b in bodies})  # type: ignore[union-attr]
    shape, alike = (len(bodies), 1) if plots else (1, len(bodies)), same == 1
    with rc_context(STYLE):
        figure = Figure(figsize=(WIDE, 0.4 + (sum(heights) if plots else max(heights))))
        axes = figure.subplots(
            *shape, squeeze=False, sharex=alike and bool(plots), sharey=alike and not plots
        )
        for ax, chart in zip(axes.ravel(), charts, strict=True):
            DRAWN[type(chart.body)](ax, chart)
            if plots and alike:
                ax.label_outer()
        if title:
            figure.suptitle(title, fontsize=9)
    return figure


def _draw_plot(ax: Any, chart: Chart) -> None:
    body = chart.body
    assert isinstance(body, Plot)
    for m in body.marks:
        colour = COLOURS[m.colour]
        if isinstance(m, Band):
            ax.fill_between(m.x, m.low, m.high, color=colour, alpha=0.2, lw=0.0, label=m.label or None)
        elif isinstance(m, Rule):
            (ax.axvline if m.upright else ax.axhline)(m.value, color=colour, ls="--", lw=0.8)
            if m.upright:
                where = ax.get_xaxis_transform()
                ax.text(m.value, 0.02, f" {m.label}", transform=where, size=6.5, rotation=90, va="bottom")
        else:
            ax.plot(m.x, m.y, color=colour, label=m.label or None, **CURVES[m.style])
    for axis, which in ((body.x, "x"), (body.y, "y")):
        if axis.log:
            getattr(ax, f"set_{which}scale")("log")
        getattr(ax, f"set_{which}lim")(axis.low, axis.high)
        getattr(ax, f"set_{which}label")(axis.label)
    ax.set_title(chart.title)
    if 1 < len(body.legend) <= len(COLOURS):
        ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, handlelength=1.0)


def _draw_rows(ax: Any, chart: Chart) -> None:
    body = chart.body
    assert isinstance(body, RowChart)
    names = {series: label for label, series, _ in body.legend}
    groups: dict[tuple[int, str], list[tuple[int, Bar | Mark]]] = {}
    for k, row in enumerate(body.rows):
        if row.band is not None:
            ax.barh(k, row.band[1] - row.band[0], left=row.band[0], height=0.6, color="#e9edf2")
        for item in row.items:
            groups.setdefault((item.series, getattr(item, "shape", "bar")), []).append((k, item))
    for (series, shape), own in groups.items():
        colour, label = COLOURS[series], names.get(series)
        places, values = [k for k, _ in own], [item.value for _, item in own]
        if shape == "bar":
            starts = [item.start or 0.0 for _, item in own if isinstance(item, Bar)]
            widths = [value - start for value, start in zip(values, starts, strict=True)]
            ax.barh(places, widths, left=starts, height=0.55, color=colour, label=label)
            continue
        style = {"marker": MARKERS[shape], "mfc": "none" if shape == "ring" else colour}
        ax.plot(values, places, ls="none", color=colour, ms=3.2, label=label, **style)
        ends = [(k, m.low, m.high) for k, m in own if isinstance(m, Mark) and m.low is not None]
        ax.hlines([k for k, _, _ in ends], [e[1] for e in ends], [e[2] for e in ends], color=colour, lw=0.8)
    for value, _ in body.rules:
        ax.axvline(value, color="#555", ls="--", lw=0.8)
    if body.axis.log:
        ax.set_xscale("log")
    ax.set_xlim(body.axis.low, body.axis.high)
    ax.set_yticks(range(len(body.rows)), [clip_text(row.name, 44) for row in body.rows], fontsize=6.5)
    ax.set_ylim(len(body.rows) - 0.4, -0.6)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel(body.axis.label)
    if body.legend:
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2)


def _draw_map(ax: Any, chart: Chart) -> None:
    from matplotlib.colors import ListedColormap

    body = chart.body
    assert isinstance(body, HeatMap)
    shown = np.ma.masked_less([[c.step for c in row] for row in body.cells], 0)
    ax.imshow(shown, cmap=ListedColormap(SHADES), vmin=-0.5, vmax=STEPS - 0.5, aspect="auto")
    for i, row in enumerate(body.cells):
        for j, c in enumerate(row):
            if c.step >= 0:
                look = {"color": "white" if c.step >= STEPS - 3 else "#222", "size": 5.5}
                ax.text(
                    j, i, c.text, ha="center", va="center", weight="bold" if c.marked else "normal", **look
                )
    ax.set_xticks(range(len(body.columns)), body.columns, rotation=55, ha="right", fontsize=6.5)
    ax.set_yticks(range(len(body.rows)), body.rows, fontsize=6.5)
    ax.set_title(chart.title)
    ax.set_xlabel(f"{body.corner}; bold: significant")
    ax.grid(visible=False)
    ax.tick_params(length=0)
    ax.spines[["left", "bottom"]].set_visible(False)


DRAWN = {Plot: _draw_plot, RowChart: _draw_rows, HeatMap: _draw_map}


def save(figure: Figure, path: Path) -> Path:
    """Write a figure, whole or not at all; the suffix decides the format.

    Raises `SmsidError` for a suffix that is none of PNG, SVG and PDF.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    kind = path.suffix.lower()
    if kind not in FORMATS:
        raise SmsidError(f"'{path.name}' is no PNG, SVG or PDF.", advice=f"End it in {', '.join(FORMATS)}.")
    FigureCanvasAgg(figure)
    _plain_where_no_formula(figure)
    # no date in the file: the same figure is the same file
    meta: dict[str, Any] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(
        kind, {"Software": "smsid"}
    )
    style: dict[Any, Any] = {**STYLE, "svg.hashsalt": "smsid"}
    check_target(path)
    content = BytesIO()  # matplotlib's writer of PDFs ends in an error of its own where a disk is full
    with rc_context(style):
        figure.savefig(content, format=kind[1:], metadata=meta)
    return atomic_write(path, content.getvalue())


def _plain_where_no_formula(figure: Figure) -> None:
    """Show a text as it stands where what it has between dollars is no formula, such as a user's title."""
    from matplotlib.mathtext import MathTextParser
    from matplotlib.text import Text

    parser = MathTextParser("path")
    for text in figure.findobj(Text):
        shown = text.get_text()  # type: ignore[attr-defined]
        if "$" in shown:
            try:
                for line in shown.splitlines():
                    parser.parse(line)
            except Exception:  # matplotlib raises its own errors and those of pyparsing
                text.set_parse_math(False)  # type: ignore[attr-defined]
