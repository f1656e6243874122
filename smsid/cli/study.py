"""``smsid control --study table4``: the paper's cases flown, its numbers beside."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console, RenderableType

from smsid._files import atomic_write
from smsid.cli.output import working
from smsid.control.identified_model import identified_model
from smsid.control.table4 import CONTROLLERS, PRINTED_UNIT, Study, Variant, cases
from smsid.control.table4_summary import improvements, orderings, summarise
from smsid.description.schema import Description
from smsid.errors import ControlError
from smsid.identify.estimate import Estimate
from smsid.model import build_model

TOGETHER = 20
"""Flights side by side."""


def fly_study(
    description: Description, estimate: Estimate | None, draws: int, output: Path, console: Console
) -> dict[str, Any]:
    """Fly every case ``draws`` times on the described spacecraft; with an estimate case D has its model.

    Returns the document that is written.

    Raises `ControlError` for less than one draw, and as `Study` and `identified_model` do.
    """
    if draws < 1:
        raise ControlError(f"{draws} draws are no study.", advice="Give at least one.")
    models = () if estimate is None else (identified_model(description, estimate).dynamics(),)
    chosen = cases()
    study = Study(build_model(description), Variant(), identified=models)
    runs = []
    with working("flying") as tell:
        for case in chosen:
            for controller in CONTROLLERS:
                tell(f"case {case.name}, {controller}, {draws} draws")
                for begin in range(0, draws, TOGETHER):
                    runs += study.fly_many(case, controller, range(begin, min(begin + TOGETHER, draws)))
    rows = summarise(runs, chosen)
    result = {
        "schema": 1,
        "kind": "control_study",
        "paper_unit": PRINTED_UNIT,
        "case_D": "a drawn error" if estimate is None else "the estimate's model",
        "rows": rows,
        "orderings": orderings(runs),
        "improvements": improvements(runs),
    }
    atomic_write(output, json.dumps(result, indent=1, allow_nan=False) + "\n")
    for part in document_parts(result):
        console.print(part, highlight=False)
    console.print(f"wrote {output}")
    return result


def document_parts(d: Mapping[str, Any]) -> Iterator[RenderableType]:
    """Yield what to print of a study as it stands in its file: which is smaller, by how much, every case."""
    from smsid.cli.tables import plain_table

    for claim in d["orderings"]:
        yield (
            f"{claim['smaller']} < {claim['larger']}: e_b {_verdict(claim['e_base'])}, "
            f"e_i {_verdict(claim['e_joints'])}"
        )
    for r in d["improvements"]:
        ours, paper = r["lower_percent"], r["paper"]
        yield (
            f"(D) against ({r['against']}), {r['controller']}: e_b {ours[0]:.1f} %, e_i {ours[1]:.1f} % "
            f"lower; paper {paper[0]} and {paper[1]} %"
        )
    table = plain_table(
        *("case", "controller", "e_b [rad]", "95 %", "paper", "e_i [rad]", "95 %", "paper"),
        left=("case", "controller"),
    )
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
        table.add_row(*cells)
    yield table
    yield "The paper's numbers have no unit in print: they are read in degrees, which fits (docs: Control)."


def _verdict(found: Mapping[str, Any]) -> str:
    share, ratio = 100.0 * found["share"], found["median_ratio"]
    return f"{found['verdict']} ({share:.0f} % of draws, median ratio {ratio:.2f})"
