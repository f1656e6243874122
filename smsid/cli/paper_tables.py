"""The paper's Tables 2 and 3 beside an estimate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from rich.table import Table
from rich.text import Text

from smsid.identify.estimate import AS_PRINTED, Estimate, ParameterEstimate


@dataclass(frozen=True)
class Row:
    """A row of the paper's Table 2: parameter, true value, the paper's estimate and error [%]."""

    label: str
    names: tuple[str, ...]
    truth: float
    paper: str
    paper_error: str


TABLE_2 = (
    Row("M [kg]", ("total.mass",), 2256.8, "2255.9 (printed 2155.9)", "0.04"),
    Row("m_s [kg]", ("tank.mass",), 49.6, "49.9", "0.6"),
    Row("k_s [N/m]", ("tank.stiffness.x", "tank.stiffness.y", "tank.stiffness.z"), 0.41, "0.407", "0.78"),
    Row("b_s [N s/m]", ("tank.damping.x", "tank.damping.y", "tank.damping.z"), 0.02, "-", ">>"),
    Row("rho [kg/m] (linear)", ("panel.linear_density",), 16.2, "16.567 (2761.17 kg/m^3)", "2.266"),
    Row("clamped f1 [Hz]", ("panel.mode1.frequency",), 0.045696, "0.0459", "0.114"),
    Row("clamped f2 [Hz]", ("panel.mode2.frequency",), 0.286370, "0.287", "0.354"),
    Row("clamped f3 [Hz]", ("panel.mode3.frequency",), 0.801844, "0.800", "0.245"),
)


def table_2(estimate: Estimate) -> Table:
    """Return the paper's Table 2 beside the estimate; values given per axis are averaged."""
    table = Table(title="Table 2: Exp. 1", title_justify="left", header_style="bold")
    for name in ("parameter", "true", "paper", "error %", "here", "± 95 %", "error %", "status"):
        table.add_column(name, justify="left" if name in ("parameter", "status") else "right")
    for row in TABLE_2:
        found = [estimate[n] for n in row.names if n in estimate]
        if not found:
            table.add_row(
                Text(row.label), f"{row.truth:g}", row.paper, row.paper_error, "not found", "", "", ""
            )
            continue
        value = float(np.mean([p.value for p in found]))
        half = 1.96 * float(np.sqrt(np.sum([p.sigma**2 for p in found]))) / len(found)
        error = 100 * abs(value / row.truth - 1)
        status = {p.status for p in found}
        table.add_row(
            Text(row.label),
            f"{row.truth:g}",
            row.paper,
            row.paper_error,
            f"{value:.6g}",
            f"{half:.1g}",
            f"{error:.3g}",
            " / ".join(sorted(status)).replace("_", " "),
        )
    return table


def table_3(estimate: Estimate) -> Table:
    """Return best and worst parameters of Step B, as the paper's Table 3 gives them."""
    table = Table(title="Table 3: Exp. 2, best and worst identifiable parameters", title_justify="left")
    for name in ("", "parameter", "true", "here", "± 95 %", "error %"):
        table.add_column(name, justify="left" if name in ("", "parameter") else "right", overflow="fold")
    table.add_row("paper, best", "pi_m(2)", "336028.408", "335988.01", "", "0.01")
    table.add_row("paper, worst", "pi_m(12)", "-1.06", "-1.11", "", "4.80")
    for label, group in (("with slosh state", "exp2.step_b"), ("as printed", "exp2.step_b_printed")):
        usable = [
            p for p in estimate.group(group) if p.status == "identifiable" and not p.small and p.nominal
        ]
        ranked = sorted(usable, key=_error)
        shown = [("best", p) for p in ranked[:2]] + [("worst", p) for p in ranked[-2:]]
        for rank, p in shown:
            table.add_row(
                f"{label}, {rank}",
                Text(_short(p.name.removeprefix(AS_PRINTED))),
                f"{p.nominal:.6g}",
                f"{p.value:.6g}",
                f"{1.96 * p.sigma:.2g}",
                f"{100 * _error(p):.3g}",
            )
    return table


def _short(name: str, width: int = 52) -> str:
    return name if len(name) <= width else name[: width - 4] + " ..."


def _error(p: ParameterEstimate) -> float:
    return p.relative_error(p.nominal) if p.nominal else float("inf")
