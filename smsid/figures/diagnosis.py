"""The map of equation by dependence, before any cause and with the causes, and the gain by channel."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from smsid.diagnose.result import Diagnosis
from smsid.errors import SmsidError
from smsid.figures.canvas import canvas
from smsid.report.diagnosis_map import EDGES, LEVEL, diagnosis_map
from smsid.report.heat import STEPS, HeatMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHADES = ("#eeeeea", "#e0e3e0", "#cfd6d6", "#f6d9a6", "#eda95c", "#d96f32", "#ad3b34", "#661f45")


def diagnosis_figure(diagnosis: Diagnosis, title: str = "") -> Figure:
    """Return the maps of a diagnosis; raises `SmsidError` for one that holds no tests."""
    tests = dict(diagnosis.tests)
    names = {"nominal": "before any cause", "extended": "with the causes"}
    if tests.get("nominal") == tests.get("extended"):
        tests, names = {"nominal": tests.get("nominal", ())}, {"nominal": "nominal parameters refitted"}
    maps: list[tuple[str, HeatMap]] = []
    for key, name in names.items():
        figure = diagnosis_map(key, name, tests.get(key, ()))
        if figure is not None and isinstance(figure.body, HeatMap):
            maps.append((name, figure.body))
    if not maps:
        raise SmsidError(
            f"The diagnosis holds no tests: {diagnosis.sentence}",
            advice="Make it again with `smsid diagnose`; one that is not evaluated has no map.",
        )
    rows = max(len(m.rows) for _, m in maps)
    with canvas(1, len(maps), height=1.3 + 0.19 * rows, squeeze=False, sharey=True) as (figure, axes):
        for ax, (name, m) in zip(axes[0], maps, strict=True):
            _draw(ax, m)
            ax.set_title(name)
        text = f"minus log10 of the p-value, corrected for all tests; bold: below {LEVEL:g}"
        figure.supxlabel(text, fontsize=7.5)
        if title:
            figure.suptitle(title, fontsize=9)
    return figure


def _draw(ax: Any, m: HeatMap) -> None:
    from matplotlib.colors import ListedColormap

    steps = np.array([[c.step for c in row] for row in m.cells], dtype=float)
    shown = np.ma.masked_less(steps, 0.0)
    ax.imshow(shown, cmap=ListedColormap(SHADES), vmin=-0.5, vmax=STEPS - 0.5, aspect="auto")
    for i, row in enumerate(m.cells):
        for j, c in enumerate(row):
            if c.step >= 0:
                light = c.step >= len(EDGES) - 2
                weight, colour = "bold" if c.marked else "normal", "white" if light else "#222"
                ax.text(j, i, c.text, ha="center", va="center", size=5.5, color=colour, fontweight=weight)
    ax.set_xticks(range(len(m.columns)), m.columns, rotation=55, ha="right", fontsize=6.5)
    ax.set_yticks(range(len(m.rows)), m.rows, fontsize=6.5)
    ax.grid(visible=False)
    ax.tick_params(length=0)
    for side in ("left", "bottom"):
        ax.spines[side].set_visible(False)
