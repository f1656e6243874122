"""An estimate: how well each parameter is known, and how far from the truth or the description it is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from smsid._statistics import NORMAL95
from smsid.errors import NotIdentifiableError
from smsid.figures.canvas import COLOURS, canvas, legend_above
from smsid.identify.estimate import IDENTIFIABLE_BELOW, Estimate
from smsid.identify.estimate_text import asked_for
from smsid.report.parameters import SMALLEST, clip_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def estimate_figure(estimate: Estimate, truth: Estimate | None = None, title: str = "") -> Figure:
    """Return bars of 95 % half-widths relative to size, with the distance from what is known.

    ``truth``: an estimate whose values are true; without it the distance is that from the description. Raises
    `NotIdentifiableError` when no parameter has an interval.
    """
    shown = [p for p in asked_for(estimate) if math.isfinite(p.relative_sigma) and p.relative_sigma > 0.0]
    if not shown:
        raise NotIdentifiableError("No parameter of the estimate has an interval.", advice="See its notes.")
    label = "off the described value" if truth is None else "off the true value"
    with canvas(height=0.8 + 0.155 * len(shown)) as (figure, ax):
        for good, colour, name in (
            (True, 0, "half of the 95 % interval"),
            (False, 2, "not identifiable"),
        ):
            rows = [k for k, p in enumerate(shown) if (p.status == "identifiable") is good]
            widths = [NORMAL95 * shown[k].relative_sigma for k in rows]
            if rows:
                ax.barh(rows, widths, height=0.55, color=COLOURS[colour], label=name, left=0.0)
        places, values = [], []
        for k, p in enumerate(shown):
            known = p.nominal if truth is None else truth[p.name].value if p.name in truth else None
            if known is not None and math.isfinite(p.relative_error(known, p.reference)):
                places.append(k)
                values.append(max(p.relative_error(known, p.reference), SMALLEST))
        ax.plot(values, places, "o", color=COLOURS[1], ms=3.0, label=label)
        ax.axvline(IDENTIFIABLE_BELOW * NORMAL95, color="#555", ls="--", lw=0.8)
        ax.set_xscale("log")
        ax.set_yticks(range(len(shown)), [clip_text(p.name, 44) for p in shown], fontsize=6.5)
        ax.set_ylim(len(shown) - 0.4, -0.6)
        ax.grid(axis="y", visible=False)
        ax.set_xlabel("share of the parameter's size")
        legend_above(ax)
        if title:
            figure.suptitle(title, fontsize=9)
    return figure
