"""The study of Table 4: every case flown with both controllers, as one document."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

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
    Study,
    Variant,
    cases,
)
from smsid.paper.table4_summary import improvements, orderings, summarise

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


def _verdict(found: Mapping[str, Any]) -> str:
    share, ratio = 100.0 * found["share"], found["median_ratio"]
    return f"{found['verdict']} ({share:.0f} % of draws, median ratio {ratio:.2f})"
