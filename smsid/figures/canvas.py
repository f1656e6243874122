"""One look for all figures: size of a column, colours that everyone can tell apart, fonts that print."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from smsid._files import atomic_write, check_target
from smsid.errors import SmsidError, require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0063a3", "#c44f00", "#8a919c", "#00845f", "#a8468a", "#9a7400")
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


@contextmanager
def canvas(
    rows: int = 1,
    columns: int = 1,
    *,
    height: float = 2.4,
    sharex: bool = False,
    sharey: bool = False,
    squeeze: bool = True,
) -> Iterator[tuple[Figure, Any]]:
    """Give a figure and its axes in this look; no window is opened.

    ``height`` [in] is that of the whole; ``sharex``, ``sharey``, ``squeeze`` as of `Figure.subplots`.
    Raises `MissingDependencyError` without matplotlib.
    """
    require("matplotlib", "plot")
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(STYLE):
        figure = Figure(figsize=(WIDE, height))
        yield figure, figure.subplots(rows, columns, sharex=sharex, sharey=sharey, squeeze=squeeze)


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


def legend_above(axes: Axes) -> None:
    """Put the legend above the axes, out of the way of the data."""
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2)
