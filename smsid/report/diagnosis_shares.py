"""Where a misfit comes from, as shares: which place and which candidate account for how much of it."""

from __future__ import annotations

from smsid.diagnose.score_test import Candidate
from smsid.report.axes import Axis, ticks_of
from smsid.report.diagnosis_map import COLUMNS, column_of, order_rows, row_of
from smsid.report.heat import HeatCell, HeatMap, step_of
from smsid.report.model import Figure
from smsid.report.numbers import share
from smsid.report.rows import Bar, Row, RowChart
from smsid.report.shares import TELLING, Place, Shares

EDGES = (0.02, 0.1, 0.25, 0.45, 0.65, 0.8, 0.95)
SHOWN = 14
SCALE = (
    (0, "below 2 %"),
    (1, "2 %"),
    (2, "10 %"),
    (3, "25 %"),
    (4, "45 %"),
    (5, "65 %"),
    (6, "80 %"),
    (7, "95 %"),
    (-1, "where it comes from"),
)
OF_CAUSES = (
    "What the named cause does to the predictions is taken as the whole. A cell is the share of it that "
    "the equation or channel could produce in the cause's stead, if it depended on the column's quantity in "
    "any of the usual ways, everything nominal free to move within its prior. Rows are torques of joints and "
    "wheels, forces and torques on the bus, then sensor channels. Places share effects, so shares do "
    "not add up."
)
OF_REST = (
    "The whole is what the nominal parameters leave, noise included. A cell is the share of its "
    "squares that the "
    "equation or channel could produce, if it depended on the column's quantity in any of the usual ways."
)


def share_map(found: Shares) -> Figure | None:
    """Return the map of equation by dependence in shares, the one strongest place framed."""
    best: dict[tuple[str, str], Place] = {}
    for p in found.places:
        key = row_of(p.where), column_of(p.dependence)
        if key not in best or p.share > best[key].share:
            best[key] = p
    if not best:
        return None
    rows = order_rows(dict.fromkeys(k for k, _ in best))
    known = [c for c in COLUMNS if any(d == c for _, d in best)]
    columns = [*known, *dict.fromkeys(d for _, d in best if d not in COLUMNS)]
    top = found.places[0]
    place = (row_of(top.where), column_of(top.dependence)) if top.share >= TELLING else None
    cells = tuple(tuple(_cell(best.get((r, c)), (r, c) == place) for c in columns) for r in rows)
    where = (
        f"strongest: {top.where} against {top.dependence}, {percent(top.share)}"
        if place
        else "none stands out"
    )
    body = HeatMap(
        tuple(rows), tuple(columns), cells, f"shares of the misfit by place; {where}", SCALE, "share"
    )
    title = (
        f"Where it comes from: {top.where}, as a function of its {top.dependence}"
        if place
        else "Where it comes from: no one place"
    )
    return Figure(
        "share-map", title.replace("its its", "its"), body, OF_CAUSES if found.of_causes else OF_REST
    )


def share_ranking(found: Shares) -> Figure | None:
    """Return the candidates' shares on a linear axis from none to all, the causes marked."""
    shown = found.candidates[:SHOWN]
    if not shown:
        return None
    rows = []
    for c in shown:
        series = 0 if c.cause else 1 if c.alias else 2
        what = {0: "the cause", 1: "not told from it"}.get(series, "")
        text = f"{percent(c.share)} {what}".strip()
        rows.append(Row(in_words(c.candidate), (Bar(c.share, series, tip=text),), text))
    legend = [
        ("named as cause", 0, "bar"),
        ("not told from a cause", 1, "bar"),
        ("other candidates", 2, "bar"),
    ]
    used = {r.items[0].series for r in rows}
    ticks = tuple((v, f"{100 * v:g} %") for v, _ in ticks_of(0.0, 1.0, count=6))
    axis = Axis("share explained by one candidate alone", 0.0, 1.02, False, ticks)
    chart = RowChart(
        axis, tuple(rows), "shares that candidates explain", tuple(x for x in legend if x[1] in used)
    )
    caption = (
        "How much of what the cause does each other candidate could do alone in its stead; the cause "
        "has all of "
        "it by definition. Of strong effects even one per cent is far beyond the noise: this is how "
        "the causes "
        "were told apart."
        if found.of_causes
        else "How much of the squares left each candidate alone would explain, everything nominal "
        "free to move."
    )
    return Figure("ranking", "What each candidate would explain", chart, caption)


def percent(x: float) -> str:
    """Return a share in whole per cents, with one digit where it is small."""
    return share(x, 2) if x < 0.0995 else f"{100 * x:.0f} %"


def in_words(c: Candidate) -> str:
    """Return a candidate as shape and place."""
    return f"{c.shape.replace('_', ' ')} at {c.location}"


def _cell(p: Place | None, here: bool) -> HeatCell:
    if p is None:
        return HeatCell()
    text = "0" if p.share < 0.005 else f"{100 * p.share:.0f}"
    tip = f"{p.where} against {p.dependence}: {percent(p.share)}, by {p.freedom} functions of it"
    return HeatCell(step_of(p.share, EDGES), text, tip, here)
