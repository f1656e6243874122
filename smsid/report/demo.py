"""The report of ``smsid demo``: both experiments identified, beside the paper's tables and the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from smsid.description.schema import Description
from smsid.identify.estimate import Estimate
from smsid.identify.pipeline import Identification
from smsid.recording import Recording
from smsid.report.identify import explained, identify_sections, worst_ratio
from smsid.report.model import Cell, Provenance, Report, Section, Table, Tone
from smsid.report.numbers import number, share, unit
from smsid.report.parameters import Known, reported
from smsid.report.residuals import Residuals

BUDGET = 180_000
QUANTILE = 1.959964


@dataclass(frozen=True)
class Shown:
    """One identification of the demonstration: where its recordings are from, and what came out."""

    key: str
    title: str
    recordings: Sequence[Recording]
    identification: Identification


class PaperRow(Protocol):
    """A row of the paper's Table 2: parameter, true value, the paper's estimate and error [%] as printed."""

    @property
    def label(self) -> str:
        """What the paper calls it, with its unit."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """The estimate's parameters that are averaged."""
        ...

    @property
    def truth(self) -> float:
        """True value."""
        ...

    @property
    def paper(self) -> str:
        """The paper's estimate."""
        ...

    @property
    def paper_error(self) -> str:
        """Its error [%], or what is printed in place of one."""
        ...


def demo_report(
    description: Description, shown: Sequence[Shown], paper: Sequence[PaperRow], origin: Provenance
) -> Report:
    """Return the report of a demonstration.

    Args:
        description: the paper's spacecraft, whose values are the truth.
        shown: the identifications, the most telling last; it comes first in the report.
        paper: rows of the paper's Table 2.
        origin: versions, command, files.
    """
    printed = {n: float(r.paper_error) / 100.0 for r in paper if r.paper_error[0].isdigit() for n in r.names}
    order = tuple(reversed(shown))
    tables = tuple(table_2(s, paper) for s in order)
    sections = [
        Section("tables", "Table 2 of the paper", tables, "beside the truth and the paper's estimates")
    ]
    glance: list[tuple[str, str]] = []
    for k, s in enumerate(order):
        estimate = s.identification.estimate
        truth = {p.name: p.nominal for p in estimate.parameters if p.nominal is not None}
        left, problem = explained(description, s.recordings, s.identification, None)
        own = identify_sections(
            description,
            s.recordings,
            s.identification,
            None,
            Known(truth, printed),
            left,
            problem,
            prefix=f"{s.key}-",
            budget=BUDGET,
        )
        sections += [replace(x, title=f"{x.title} ({s.title})", open=x.open and k == 0) for x in own]
        glance += _glance(s, left)
    sentence, tone = verdict(order[0], printed)
    return Report("Demonstration", description.name, sentence, tone, tuple(sections), origin, tuple(glance))


def table_2(s: Shown, paper: Sequence[PaperRow]) -> Table:
    """Return the paper's Table 2 beside an estimate; values given per axis are averaged."""
    rows = []
    for row in paper:
        found = [s.identification.estimate[n] for n in row.names if n in s.identification.estimate]
        cells = [Cell(row.label), Cell(number(row.truth, 6), row.truth), Cell(unit(row.paper))]
        cells.append(Cell(f"{row.paper_error} %" if row.paper_error[0].isdigit() else row.paper_error))
        if not found:
            rows.append((*cells, Cell("not found"), Cell(""), Cell(""), Cell("")))
            continue
        value = float(np.mean([p.value for p in found]))
        width = QUANTILE * float(np.sqrt(np.sum([p.sigma**2 for p in found]))) / len(found)
        error = abs(value / row.truth - 1.0)
        inside = abs(value - row.truth) <= width
        rows.append(
            (
                *cells,
                Cell(number(value, 6), value),
                Cell(f"± {number(width, 2)}", width),
                Cell(share(error), error, "good" if inside else "warn"),
                Cell("yes" if inside else "no", tone="good" if inside else "warn"),
            )
        )
    columns = (
        "parameter",
        "#truth",
        "#paper",
        "#its error",
        "#here",
        "#95 % interval",
        "#error",
        "truth inside",
    )
    return Table(f"Exp. 1, recordings of {s.title}", columns, tuple(rows))


def verdict(s: Shown, printed: dict[str, float]) -> tuple[str, Tone]:
    """Return one sentence on an identification whose truth is known, and what it is worth."""
    estimate = s.identification.estimate
    own = [p for p in reported(estimate) if p.nominal is not None]
    good = [p for p in own if p.status == "identifiable"]
    inside = sum(p.interval[0] <= (p.nominal or 0.0) <= p.interval[1] for p in good)
    counted = [n for n in printed if n in estimate]
    better = [n for n in counted if _error(estimate, n) <= printed[n]]
    sentence = (
        f"From recordings of {s.title}, {len(good)} of {len(own)} parameters are identified to better than "
        f"10 %, {inside} of them with the truth inside the 95 % interval; {len(better)} of the "
        f"{len(counted)} parameters of the paper's Table 2 come out nearer to the truth than in the paper."
    )
    return sentence, "good" if good and inside >= 0.9 * len(good) else "warn"


def _glance(s: Shown, left: Sequence[Residuals]) -> list[tuple[str, str]]:
    estimate = s.identification.estimate
    out = [
        (f"{label}: error, {s.title}", share(_error(estimate, name), 2))
        for name, label in (("total.mass", "total mass"), ("tank.mass", "slosh mass"))
        if name in estimate
    ]
    worst = worst_ratio(left)
    return out + ([(f"residual / noise, {s.title}", number(worst[1], 3))] if worst is not None else [])


def _error(estimate: Estimate, name: str) -> float:
    p = estimate[name]
    return p.relative_error(p.nominal) if p.nominal else float("nan")
