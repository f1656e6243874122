"""Coverage and spread of a Monte Carlo campaign, with the bands where they lie when intervals are right."""

from __future__ import annotations

from typing import TYPE_CHECKING

from smsid.campaign.summary import Summary
from smsid.errors import SmsidError
from smsid.figures.canvas import COLOURS, canvas
from smsid.report.parameters import clip_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def campaign_figure(summary: Summary, title: str = "") -> Figure:
    """Return coverage and relative spread by parameter; raises `SmsidError` where no interval was tested."""
    tested = [p for p in summary.parameters if p.coverage is not None and p.coverage_band is not None]
    if not tested:
        raise SmsidError("No interval of the campaign was tested.", advice="It needs a truth and sigmas.")
    places = range(len(tested))
    with canvas(1, 2, height=0.9 + 0.17 * len(tested), sharey=True) as (figure, (left, right)):
        for k, p in zip(places, tested, strict=True):
            _band(left, k, p.coverage, p.coverage_band, p.coverage_holds)
            _band(right, k, p.ratio, p.ratio_band, p.ratio_holds)
        left.axvline(0.95, color="#555", ls="--", lw=0.8)
        right.axvline(1.0, color="#555", ls="--", lw=0.8)
        left.set_yticks(list(places), [clip_text(p.name, 40) for p in tested], fontsize=6.5)
        left.set_ylim(len(tested) - 0.4, -0.6)
        left.set_xlabel("share of runs whose 95 % interval holds the truth")
        right.set_xlabel("spread / predicted standard deviation")
        for ax in (left, right):
            ax.grid(axis="y", visible=False)
        left.set_title(f"{summary.runs} runs; shaded: bands at {summary.level:g} over all parameters")
        if title:
            figure.suptitle(title, fontsize=9)
    return figure


def _band(ax, k: int, value: float | None, band: tuple[float, float] | None, holds: bool | None) -> None:  # type: ignore[no-untyped-def]
    if value is None or band is None:
        return
    ax.barh(k, band[1] - band[0], left=band[0], height=0.6, color="#e9edf2")
    ax.plot(value, k, "o" if holds else "D", color=COLOURS[0 if holds else 1], ms=3.2)
