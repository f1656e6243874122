"""The report of ``smsid control --study table4``: the paper's cases flown, its numbers beside."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smsid.report.axes import Axis
from smsid.report.model import Cell, Figure, Provenance, Report, Section, Table, Tone
from smsid.report.numbers import number
from smsid.report.rows import ChartRow, Mark, RowChart

NAMES = {"base": "base attitude e_b", "joints": "joints e_i"}
TONES: dict[str, Tone] = {"holds": "good", "fails": "bad", "undecided": "neutral"}


def study_report(study: Mapping[str, Any], subject: str, origin: Provenance) -> Report:
    """Return the report of a study, from the document that the command writes."""
    rows, claims = study["rows"], study["orderings"]
    verdicts = [c[f"e_{k}"]["verdict"] for c in claims for k in NAMES]
    held, failed = verdicts.count("holds"), verdicts.count("fails")
    draws = rows[0]["draws"] if rows else 0
    often = "draw" if draws == 1 else "draws"
    sentence = (
        f"Of the paper's {len(verdicts)} orderings of tracking errors, {held} hold, {failed} fail and "
        f"{len(verdicts) - held - failed} are undecided over {draws} {often}; case D has {study['case_D']}."
    )
    if not held and not failed:
        sentence += " More draws decide (--draws)."
    errors = tuple(_chart(rows, k) for k in NAMES)
    sections = (
        Section("errors", "Largest tracking errors", (*errors, _table(rows)), f"{draws} {often} each"),
        Section(
            "orderings", "The paper's orderings", (_orderings(claims),), f"{held} of {len(verdicts)} hold"
        ),
        Section("improvements", "How much lower case D is", (_improvements(study["improvements"]),)),
    )
    tone: Tone = "neutral" if not held and not failed else "warn" if held else "bad"
    tone = "good" if held == len(verdicts) > 0 else tone
    return Report("Study of Table 4", subject, sentence, tone, sections, origin,
                  (("hold", str(held)), ("fail", str(failed)), ("draws per case", str(draws))))  # fmt: skip


def _chart(rows: list[dict[str, Any]], which: str) -> Figure:
    out, values = [], []
    for row in rows:
        found = row[f"e_{which}"]
        low, high = found["interval"]
        series = 0 if row["controller"] == "pd" else 3
        tip = f"median {number(found['median'], 3)}, 95 % {number(low, 3)} to {number(high, 3)}"
        marks = [Mark(found["median"], low, high, series, "dot", tip)]
        values += [low, high]
        printed = row.get(f"e_{which}_paper")
        if printed:
            marks.append(Mark(printed, series=4, shape="square", tip=f"the paper: {number(printed, 3)}"))
            values.append(printed)
        name = f"{row['case']} ({row['note']}), {'PD' if series == 0 else 'H-infinity'}"
        out.append(ChartRow(name, tuple(marks), number(found["median"], 3)))
    chart = RowChart(
        Axis.over("largest error [rad]", values, log=True),
        tuple(out),
        f"largest errors of the {NAMES[which]} by case",
        (("PD, median and 95 %", 0, "dot"), ("with H-infinity term", 3, "dot"), ("the paper", 4, "square")),
    )
    return Figure(f"errors-{which}", f"{NAMES[which].capitalize()}", chart)


def _table(rows: list[dict[str, Any]]) -> Table:
    columns = ["case", "controller", "#K_P", "#K_D"]
    for k in NAMES:
        columns += [f"#e_{k} [rad]", "#95 % from", "#to", "#paper"]
    columns.append("#flights at a limit")
    out = []
    for row in rows:
        cells = [Cell(str(row["case"])), Cell(str(row["controller"]))]
        cells += [Cell(number(row[k], 3), row[k]) for k in ("K_P", "K_D")]
        for k in NAMES:
            found = row[f"e_{k}"]
            printed = row.get(f"e_{k}_paper")
            cells += [Cell(number(x, 3), x) for x in (found["median"], *found["interval"])]
            cells.append(Cell("" if printed is None else number(printed, 3), printed))
        cells.append(Cell(str(row["runs_at_a_limit"]), float(row["runs_at_a_limit"])))
        out.append(tuple(cells))
    note = "The paper's numbers have no unit in print: they are read in degrees, which fits."
    return Table("Every case", tuple(columns), tuple(out), note)


def _orderings(claims: list[dict[str, Any]]) -> Table:
    out = []
    for c in claims:
        cells = [Cell(f"{c['smaller']} < {c['larger']}")]
        for k in NAMES:
            e = c[f"e_{k}"]
            cells.append(Cell(e["verdict"], tone=TONES[e["verdict"]]))
            cells.append(Cell(number(e["share"], 3), e["share"]))
            cells.append(Cell(number(e["median_ratio"], 3), e["median_ratio"]))
        out.append(tuple(cells))
    columns = ["claim"]
    for k in NAMES:
        columns += [f"e_{k}", "#share of draws", "#median ratio"]
    note = "Holds: in at least 95 % of draws; fails: in at most 5 %. Pairs share noise and pattern of errors."
    return Table("Orderings", tuple(columns), tuple(out), note)


def _improvements(found: list[dict[str, Any]]) -> Table:
    out = []
    for r in found:
        values = [*r["lower_percent"], *r["paper"]]
        cells = (Cell(f"D against {r['against']}"), Cell(r["controller"]))
        out.append((*cells, *(Cell(number(x, 3), float(x)) for x in values)))
    columns = ("pair", "controller", "#e_b lower by [%]", "#e_i [%]", "#paper, e_b [%]", "#paper, e_i [%]")
    return Table("Medians", columns, tuple(out))
