"""The paper's Tables 2 and 3 beside an estimate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from smsid._statistics import NORMAL95
from smsid.identify.estimate import Estimate
from smsid.identify.estimate_text import asked_for
from smsid.report.model import Cell, Section, Table, Text, cells
from smsid.report.numbers import half, number, share, unit

INERTIAL = ("kg m", "kg m^2")


@dataclass(frozen=True)
class PaperRow:
    """A row of the paper's Table 2: parameter, true value, the paper's estimate and error [%]."""

    label: str
    names: tuple[str, ...]
    truth: float
    paper: str
    paper_error: str


TABLE_2 = (
    PaperRow("M [kg]", ("total.mass",), 2256.8, "2255.9 (printed 2155.9)", "0.04"),
    PaperRow("m_s [kg]", ("tank.mass",), 49.6, "49.9", "0.6"),
    PaperRow(
        "k_s [N/m]", ("tank.stiffness.x", "tank.stiffness.y", "tank.stiffness.z"), 0.41, "0.407", "0.78"
    ),
    PaperRow("b_s [N s/m]", ("tank.damping.x", "tank.damping.y", "tank.damping.z"), 0.02, "-", ">>"),
    PaperRow("rho [kg/m] (linear)", ("panel.linear_density",), 16.2, "16.567 (2761.17 kg/m^3)", "2.266"),
    PaperRow("clamped f1 [Hz]", ("panel.mode1.frequency",), 0.045696, "0.0459", "0.114"),
    PaperRow("clamped f2 [Hz]", ("panel.mode2.frequency",), 0.286370, "0.287", "0.354"),
    PaperRow("clamped f3 [Hz]", ("panel.mode3.frequency",), 0.801844, "0.800", "0.245"),
)


@dataclass(frozen=True)
class IdentifiedExperiments:
    """The paper's experiments, identified from a guess that is off: estimate, true values by name, notes."""

    estimate: Estimate
    truth: Mapping[str, float]
    notes: Sequence[str] = ()


def paper_section(paper: IdentifiedExperiments) -> Section:
    """Return the paper's Tables 2 and 3 beside what is found from a guess that is off by several per cent."""
    text = (
        "The experiments of Rekleitis and Papadopoulos, flown in smsid's own simulation with sensor noise: "
        "this shows what the sensors tell, and proves nothing of the model, which identification shares. It "
        "starts from masses, inertias, slosh and panel that are 4 to 20 % off, and uses the default method, "
        "maximum likelihood. The paper's errors are from its own simulation."
    )
    more = tuple(paper.notes)
    parts = (
        Text((text,)),
        table_2(paper.estimate),
        _table_3(paper),
        *((Text(more, bullets=True),) if more else ()),
    )
    return Section("tables", "The paper's Tables 2 and 3", parts, "found from a wrong guess")


def table_2(estimate: Estimate) -> Table:
    """Return the paper's Table 2 beside an estimate, axes averaged."""
    out = []
    for row in TABLE_2:
        paper_error = f"{row.paper_error} %" if row.paper_error[0].isdigit() else row.paper_error
        printed = row.label, (row.truth, 6), unit(row.paper), paper_error
        found = [estimate[n] for n in row.names if n in estimate]
        if not found:
            out.append(cells(*printed, "–", "not found", None, None, None))
            continue
        value = float(np.mean([p.value for p in found]))
        width = NORMAL95 * float(np.sqrt(np.sum([p.sigma**2 for p in found]))) / len(found)
        guesses = [p.nominal for p in found if p.nominal is not None]
        guess = number(float(np.mean(guesses)) if guesses else None, 4)
        error = abs(value / row.truth - 1.0)
        # the truth is printed with so many digits, and no more can be asked of an interval
        digits = len(f"{row.truth:.8f}".rstrip("0").partition(".")[2])
        inside = _whether(abs(value - row.truth) <= width + 0.5 * 10.0**-digits)
        around, off = Cell(f"± {number(width, 2)}", width), Cell(share(error), error)
        out.append(cells(*printed, guess, (value, 6), around, off, inside))
    columns = (
        "parameter", "#truth", "#paper", "#its error", "#guess", "#here", "#95 % interval", "#error",
        "truth inside",
    )  # fmt: skip
    return Table(
        "Table 2: mass, slosh and panel",
        columns,
        tuple(out),
        "- and >> are as the paper prints them: it gives no value of b_s.",
    )


def _whether(inside: bool) -> Cell:
    return Cell("yes" if inside else "no", tone="good" if inside else "warn")


def _table_3(paper: IdentifiedExperiments) -> Table:
    """Return the best and the worst identifiable inertial combinations, as the paper's Table 3 gives them."""
    usable = [
        (p, t)
        for p in asked_for(paper.estimate)
        if p.status == "identifiable"
        and not p.small
        and p.unit in INERTIAL
        and (t := paper.truth.get(p.name))
    ]
    ranked = sorted(usable, key=lambda x: abs(x[0].value / x[1] - 1.0))
    few = ranked if len(ranked) <= 6 else [*ranked[:3], *ranked[-3:]]
    rows = [
        cells("paper's best, pi_m(2)", "336028.408", "335988.01", None, "0.01 %", None),
        cells("paper's worst, pi_m(12)", "−1.06", "−1.11", None, "4.80 %", None),
    ]
    for p, truth in few:
        low, high = p.interval
        error = abs(p.value / truth - 1.0)
        around, off = Cell(half(p.value, low, high), 0.5 * (high - low)), Cell(share(error), error)
        rows.append(cells(p.name, (truth, 6), (p.value, 6), around, off, _whether(low <= truth <= high)))
    columns = ("combination", "#truth", "#estimate", "#95 % interval", "#error", "truth inside")
    note = (
        f"Of {len(usable)} identifiable combinations of the arm's inertial parameters that are not zero; the "
        "paper's pi_m are sums of its own. Those with the bus hold the panel, too, and are left out here."
    )
    return Table("Table 3: the best and the worst inertial combinations", columns, tuple(rows), note)
