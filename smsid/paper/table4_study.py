"""The study of Table 4: every case flown with both controllers; medians, orderings and ratios beside ours."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from smsid.control.identified_model import identified_model
from smsid.description.schema import Description
from smsid.errors import ControlError
from smsid.identify.estimate import Estimate
from smsid.model import build_model
from smsid.paper.table4 import (
    CONTROLLERS,
    CROSSOVER,
    INTEGRATED_GYRO,
    PRINTED_UNIT,
    PRINTED_UNITS,
    Run,
    Study,
    Table4Row,
    Variant,
    cases,
)
from smsid.report.axes import Axis
from smsid.report.model import Figure, Provenance, Report, Section, Table, Text, Tone, cells
from smsid.report.numbers import number
from smsid.report.rows import ChartRow, Mark, RowChart

NAMES = {"base": "base attitude e_b", "joints": "joints e_i"}
TOGETHER = 20
"""Flights between two looks at the clock."""
COLUMNS = ("case", "controller", "e_b [rad]", "95 %", "paper", "e_i [rad]", "95 %", "paper")


def fly_study(
    description: Description,
    estimate: Estimate | None,
    draws: int,
    *,
    rate: float = Variant().rate,
    crossover: float = CROSSOVER,
    integrated_gyro: bool = False,
    tell: Callable[[str], object] = lambda text: None,
) -> dict[str, Any]:
    """Fly every case ``draws`` times on the described spacecraft; return the document of the study.

    With an estimate case D has its model. Controllers are called at ``rate`` [Hz], H-infinity terms designed
    for a ``crossover`` [rad/s]. ``integrated_gyro``: the attitude is an integrated gyro's, as in the paper
    (`INTEGRATED_GYRO`), instead of the described sensors'. ``tell`` hears what is being flown.

    Raises `ControlError` for less than one draw, and as `Study` and `identified_model` do.
    """
    if draws < 1:
        raise ControlError(f"{draws} draws are no study.", advice="Give at least one.")
    models = () if estimate is None else (identified_model(description, estimate).dynamics(),)
    chosen = cases()
    variant = replace(INTEGRATED_GYRO if integrated_gyro else Variant(), rate=rate)
    study = Study(build_model(description), variant, crossover=crossover, identified=models)
    runs = []
    for case in chosen:
        for controller in CONTROLLERS:
            tell(f"case {case.name}, {controller}, {draws} draws")
            for begin in range(0, draws, TOGETHER):
                runs += study.fly_many(case, controller, range(begin, min(begin + TOGETHER, draws)))
    return {
        "schema": 1,
        "kind": "control_study",
        "paper_unit": PRINTED_UNIT,
        "rate": rate,
        "sensors": variant.name if integrated_gyro else "as described",
        "crossover": crossover,
        "case_D": "a drawn error" if estimate is None else "the estimate's model",
        "rows": summarise(runs, chosen),
        "orderings": orderings(runs),
        "improvements": improvements(runs),
    }


def study_lines(d: Mapping[str, Any]) -> list[str]:
    """Return in words which error is smaller than which, and by how much."""
    out = [
        f"{claim['smaller']} < {claim['larger']}: e_b {_verdict(claim['e_base'])}, "
        f"e_i {_verdict(claim['e_joints'])}"
        for claim in d["orderings"]
    ]
    for r in d["improvements"]:
        ours, paper = r["lower_percent"], r["paper"]
        out.append(
            f"(D) against ({r['against']}), {r['controller']}: e_b {ours[0]:.1f} %, e_i {ours[1]:.1f} % "
            f"lower; paper {paper[0]} and {paper[1]} %"
        )
    return out


def study_cells(d: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return a row of text per case and controller, by `COLUMNS`."""
    rows = []
    for row in d["rows"]:
        cells = [str(row["case"]), str(row["controller"])]
        for name in ("base", "joints"):
            found, printed = row[f"e_{name}"], row.get(f"e_{name}_paper")
            low, high = found["interval"]
            cells += [
                f"{found['median']:.2e}",
                f"{low:.1e} .. {high:.1e}",
                f"{printed:.2e}" if printed else "-",
            ]
        rows.append(tuple(cells))
    return rows


def study_report(study: Mapping[str, Any], subject: str, origin: Provenance) -> Report:
    """Return the report of a study, from the document that the command writes."""
    verdicts = [c[f"e_{k}"]["verdict"] for c in study["orderings"] for k in NAMES]
    held, failed = verdicts.count("holds"), verdicts.count("fails")
    draws = study["rows"][0]["draws"] if study["rows"] else 0
    sentence = (
        f"Of the paper's {len(verdicts)} orderings of tracking errors, {held} hold, {failed} fail and "
        f"{len(verdicts) - held - failed} are undecided with {draws} draws of each case; case D has "
        f"{study['case_D']}."
    )
    if not held and not failed:
        sentence += " More draws decide (--draws)."
    note = "The paper's numbers have no unit in print: they are read in degrees, which fits."
    limited = sum(row["runs_at_a_limit"] for row in study["rows"])
    note += f" {limited} flights met a limit of wheels or joints." if limited else ""
    columns = (*COLUMNS[:2], *(f"#{c}" for c in COLUMNS[2:]))
    table = Table("Every case", columns, [cells(*row) for row in study_cells(study)], note)
    claims = Text(study_lines(study), bullets=True)
    sections = (
        Section("errors", "Largest tracking errors", (*(_chart(study["rows"], k) for k in NAMES), table)),
        Section("orderings", "The paper's orderings, and how much lower case D is", (claims,)),
    )
    tone: Tone = "neutral" if not held and not failed else "warn" if held else "bad"
    tone = "good" if held == len(verdicts) > 0 else tone
    glance = (("hold", str(held)), ("fail", str(failed)), ("draws per case", str(draws)))
    return Report("Study of Table 4", subject, sentence, tone, sections, origin, glance)


def _chart(rows: Sequence[Mapping[str, Any]], which: str) -> Figure:
    out, values = [], []
    for row in rows:
        found, printed = row[f"e_{which}"], row.get(f"e_{which}_paper")
        low, high = found["interval"]
        series = 0 if row["controller"] == "pd" else 3
        marks = [Mark(found["median"], low, high, series)]
        marks += [Mark(printed, series=4, shape="square")] if printed else []
        values += [low, high, *([printed] if printed else [])]
        name = f"{row['case']} ({row['note']}), {'PD' if series == 0 else 'H-infinity'}"
        out.append(ChartRow(name, marks, number(found["median"], 3)))
    axis = Axis.over("largest error [rad]", values, log=True)
    legend = (
        ("PD, median and 95 %", 0, "dot"),
        ("with H-infinity term", 3, "dot"),
        ("the paper", 4, "square"),
    )
    chart = RowChart(axis, out, f"largest errors of the {NAMES[which]} by case", legend)
    return Figure(f"errors-{which}", NAMES[which].capitalize(), chart)


def _verdict(found: Mapping[str, Any]) -> str:
    share, ratio = 100.0 * found["share"], found["median_ratio"]
    return f"{found['verdict']} ({share:.0f} % of draws, median ratio {ratio:.2f})"


FEWEST = 5
"""Draws below which no ordering is decided."""


def summarise(runs: Sequence[Run], wanted: Sequence[Table4Row]) -> list[dict[str, object]]:
    """Return a row per case and controller: medians and 95 % intervals of e_b, e_i, the paper's beside.

    All in [rad]; the paper's are taken for `PRINTED_UNIT`.
    """
    rows: list[dict[str, object]] = []
    for case in wanted:
        for controller in CONTROLLERS:
            found = [r for r in runs if (r.case, r.controller) == (case.name, controller)]
            if not found:
                continue
            row: dict[str, object] = {
                "case": case.name,
                "note": case.note,
                "K_P": case.proportional,
                "K_D": case.derivative,
                "controller": controller,
                "draws": len(found),
                "runs_at_a_limit": sum(bool(r.saturated) for r in found),
            }
            for name in ("base", "joints"):
                values = np.array([getattr(r, name) for r in found])
                low, middle, high = np.percentile(values, [2.5, 50.0, 97.5])
                row[f"e_{name}"] = {"median": float(middle), "interval": [float(low), float(high)]}
            rows.append(row | printed_errors(case, controller))
    return rows


def printed_errors(case: Table4Row, controller: str) -> dict[str, float]:
    """Return the paper's e_b and e_i of a row [rad], read in `PRINTED_UNIT`; nothing where it has none."""
    found = case.paper.get(controller)
    scale = PRINTED_UNITS[PRINTED_UNIT]
    return {} if found is None else {"e_base_paper": scale * found[0], "e_joints_paper": scale * found[1]}


def orderings(runs: Sequence[Run]) -> list[dict[str, object]]:
    """Return the paper's orderings, each with the share of draws in which it holds and the median ratio.

    Pairs share the draw, so noise and pattern of errors are the same on both sides. ``holds`` where the share
    is at least 0.95, ``fails`` at most 0.05, else ``undecided``; so are fewer than `FEWEST` draws (sign test:
    five out of five by chance is 3 %).
    """
    table = {(r.case, r.controller, r.draw): r for r in runs}
    claims = [
        ((a, c), (b, c))
        for c in CONTROLLERS
        for a, b in (("D", "C"), ("C", "B"), ("B", "A1.6"), ("B", "A1.0"))
    ]
    claims += [((case, "hinf"), (case, "pd")) for case in ("D", "C", "B", "A1.6", "A1.0")]
    out: list[dict[str, object]] = []
    for better, worse in claims:
        draws = [d for (c, k, d) in table if (c, k) == better and (*worse, d) in table]
        if not draws:
            continue
        entry: dict[str, object] = {
            "smaller": " ".join(better),
            "larger": " ".join(worse),
            "draws": len(draws),
        }
        for name in ("base", "joints"):
            ratio = np.array(
                [getattr(table[*better, d], name) / getattr(table[*worse, d], name) for d in draws]
            )
            share = float((ratio < 1.0).mean())
            verdict = "holds" if share >= 0.95 else "fails" if share <= 0.05 else "undecided"
            verdict = verdict if len(draws) >= FEWEST else "undecided"
            entry[f"e_{name}"] = {"share": share, "median_ratio": float(np.median(ratio)), "verdict": verdict}
        out.append(entry)
    return out


def improvements(runs: Sequence[Run]) -> list[dict[str, object]]:
    """Return how much lower the medians of (D) are than of (B) and (A) [%], the paper's ratios beside."""
    paper = {
        ("pd", "B"): (12.4, 21.1),
        ("hinf", "B"): (5.2, 15.2),
        ("pd", "A1.6"): (87.9, 86.7),
        ("pd", "A1.0"): (87.9, 86.7),
        ("hinf", "A1.6"): (14.0, 22.2),
        ("hinf", "A1.0"): (14.0, 22.2),
    }
    out: list[dict[str, object]] = []
    for (controller, case), printed in paper.items():
        pair = [[r for r in runs if (r.case, r.controller) == (c, controller)] for c in ("D", case)]
        if not all(pair):
            continue
        lower = []
        for name in ("base", "joints"):
            ours, other = (np.median([getattr(r, name) for r in own]) for own in pair)
            lower.append(float(100.0 * (1.0 - ours / other)))
        out.append({"controller": controller, "against": case, "lower_percent": lower, "paper": printed})
    return out
