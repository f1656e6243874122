"""The map of equation by dependence: where a simulation fails, and on what the failure depends."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

from scipy.stats import chi2

from smsid.diagnose.result import SignificantTest
from smsid.report.heat import HeatCell, HeatMap, step_of
from smsid.report.model import Figure
from smsid.report.numbers import number

COLUMNS = (
    "angle",
    "ripple over the angle",
    "rate",
    "load",
    "wheel speed",
    "acceleration",
    "time",
    "amplitude",
    "its own value",
    "its own rate",
    "its own past",
)
EDGES = (1e-9, 1.3, 3.0, 6.0, 12.0, 25.0, 50.0)
"""Steps of colour by minus the decimal logarithm of the corrected p-value; colour begins at 0.001."""
HEADINGS = {"its own past": "its own past (frequency)", "amplitude": "amplitude (slosh, bending)"}
LEVEL = 0.001  # below which a test is significant, over all of a map together
BEYOND = 300.0
"""Evidence from which on a p-value is too small for a floating-point number."""


@dataclass(frozen=True)
class MapCell:
    """An equation or channel, what it may depend on, and the share [0, 1] of the misfit that it explains."""

    where: str
    dependence: str
    share: float
    freedom: int


At = TypeVar("At", SignificantTest, MapCell)


def evidence(test: SignificantTest, tests: int) -> float:
    """Return minus the decimal logarithm of a test's p-value, corrected for ``tests``; zero at least."""
    if not test.freedom:
        return 0.0
    return max(0.0, -(float(chi2.logsf(test.ratio, test.freedom)) + math.log(max(tests, 1))) / math.log(10.0))


def diagnosis_map(
    name: str, title: str, tests: Iterable[SignificantTest], *, caption: str = ""
) -> Figure | None:
    """Return the map of all generic tests, or ``None`` when there are none.

    Rows are equations (joint and wheel torques, the bus's wrench, slosh, modes) and sensor channels, a row
    for all components of a channel; a cell has the strongest test.
    """
    found = list(tests)
    if not found:
        return None
    rows, columns, best = strongest_by_place(found, lambda t: evidence(t, 1))
    limit = -math.log10(LEVEL)
    cells = [[_cell(best.get((r, c)), len(found), limit) for c in columns] for r in rows]
    significant = sum(c.marked for row in cells for c in row)
    scale = (
        (0, "no evidence"),
        (2, "0.05"),
        (3, f"{LEVEL:g}"),
        (4, "10⁻⁶"),
        (5, "10⁻¹²"),
        (6, "10⁻²⁵"),
        (7, "10⁻⁵⁰ and below"),
        (-1, f"significant: below {LEVEL:g} over all {len(found)} tests"),
    )
    headings = [HEADINGS.get(c, c) for c in columns]
    alt = f"{title}: {significant} of {len(found)} tests are significant"
    return Figure(name, title, HeatMap(rows, headings, cells, alt, scale, "−log₁₀ p, corrected"), caption)


def strongest_by_place(
    found: Iterable[At], strength: Callable[[At], float]
) -> tuple[list[str], list[str], dict[tuple[str, str], At]]:
    """Return a map's rows and columns in order, and what is strongest at each place of it."""
    best: dict[tuple[str, str], At] = {}
    for x in found:
        key = row_of(x.where), column_of(x.dependence)
        if key not in best or strength(x) > strength(best[key]):
            best[key] = x
    known = [c for c in COLUMNS if any(d == c for _, d in best)]
    columns = [*known, *dict.fromkeys(d for _, d in best if d not in COLUMNS)]
    return order_rows(dict.fromkeys(k for k, _ in best)), columns, best


def row_of(where: str) -> str:
    """Return the row of the map that an equation or a channel's component belongs to."""
    return re.sub(r"\[.*\]$", "", where)


def column_of(dependence: str) -> str:
    """Return the column of the map that a dependence belongs to: those on other joints share one."""
    return re.sub(r"^(rate|acceleration) of .*$", r"\1 of another joint", dependence)


def order_rows(rows: Iterable[str]) -> list[str]:
    """Return rows with equations first, then sensor channels."""
    kinds = ("torque of", "force on", "torque on", "slosh", "mode")
    known = list(rows)
    equations = [r for r in known if r.startswith(kinds)]
    rank = {r: next(i for i, k in enumerate(kinds) if r.startswith(k)) for r in equations}
    first = sorted(equations, key=lambda r: (rank[r], _natural(r)))
    return [*first, *sorted(r for r in known if r not in rank)]


def _natural(text: str) -> list[object]:
    return [int(x) if x.isdigit() else x for x in re.split(r"(\d+)", text)]


def _cell(test: SignificantTest | None, tests: int, limit: float) -> HeatCell:
    if test is None:
        return HeatCell()
    strength = evidence(test, tests)
    shown = "0" if strength < 0.05 else f"{strength:.1f}" if strength < 9.95 else f"{strength:.0f}"
    shown = shown if strength < BEYOND else f"> {BEYOND:.0f}"
    p = 10.0**-strength if strength < BEYOND else 0.0
    tip = (
        f"{test.where} against {test.dependence}: chi-squared {number(test.ratio, 4)} on {test.freedom}, "
        f"corrected p {number(p, 2)}"
    )
    return HeatCell(step_of(strength, EDGES), shown, tip, strength > limit)
