"""Tables that the command line prints."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from rich.table import Table
from rich.text import Text

from smsid.experiments.fly import LimitUse
from smsid.identify.estimate import Estimate, ParameterEstimate
from smsid.recording import Recording

GROUPS = {
    "arm": "torques of a welded arm: combinations of links, friction, motors",
    "exp1": "Exp. 1: mass, slosh, appendage",
    "modes": "SSI-COV: modes of the appendages",
    "exp2.step_a": "Exp. 2, Step A: system CM and first moments",
    "exp2.step_b": "Exp. 2, Step B with the slosh state: identifiable inertial parameters",
    "exp2.step_b_printed": "Exp. 2, Step B as printed: pi_m with products of first moments over m_s",
}


def estimate_table(estimate: Estimate, *, everything: bool = False) -> Iterable[Table]:
    """Yield one table per step of an estimate."""
    for group, title in GROUPS.items():
        parameters = estimate.group(group)
        if not parameters or (group == "exp2.step_b_printed" and not everything):
            continue
        yield parameter_table(title, parameters)


def parameter_table(title: str, parameters: Iterable[ParameterEstimate]) -> Table:
    """Return a table of parameters with interval, status and the description's value."""
    table = Table(title=title, title_justify="left", header_style="bold")
    table.add_column("parameter", overflow="fold", max_width=58)
    for name in ("value", "± 95 %", "unit", "described"):
        table.add_column(name, justify="right" if name != "unit" else "left")
    table.add_column("status", overflow="fold")
    for p in parameters:
        status = p.status.replace("_", " ")
        style = {"identifiable": "green", "not_identifiable": "yellow"}.get(p.status, "")
        described = "" if p.nominal is None else f"{p.nominal:.6g}"
        table.add_row(
            Text(p.name),
            f"{p.value:.6g}",
            f"{1.96 * p.sigma:.2g}",
            p.unit,
            described,
            Text(status, style=style),
        )
    return table


def comparison_table(refined: Estimate, linear: Estimate, *, everything: bool = False) -> Table:
    """Return the refined parameters beside those of the linear method."""
    table = Table(
        title="maximum likelihood beside the paper's method", title_justify="left", header_style="bold"
    )
    table.add_column("parameter", overflow="fold", max_width=58)
    for name in ("value", "± 95 %", "paper's method", "± 95 %", "unit", "described"):
        table.add_column(name, justify="right" if name != "unit" else "left")
    table.add_column("status", overflow="fold")
    known = {p.name: p for p in linear.parameters}
    for p in refined.parameters:
        if p.status == "by_product" and not everything:
            continue
        other = known.get(p.name)
        style = {"identifiable": "green", "not_identifiable": "yellow"}.get(p.status, "")
        table.add_row(
            Text(p.name),
            f"{p.value:.6g}",
            f"{1.96 * p.sigma:.2g}",
            "" if other is None else f"{other.value:.6g}",
            "" if other is None else f"{1.96 * other.sigma:.2g}",
            p.unit,
            "" if p.nominal is None else f"{p.nominal:.6g}",
            Text(p.status.replace("_", " "), style=style),
        )
    return table


def limits_table(limits: Iterable[LimitUse]) -> Table:
    """Return a table of how far limits were used."""
    table = Table(title="limits", title_justify="left", header_style="bold")
    for name in ("quantity", "largest", "limit", "unit"):
        table.add_column(name, justify="right" if name in ("largest", "limit") else "left")
    for use in limits:
        limit = "-" if use.limit is None else f"{use.limit:.4g}"
        style = "red" if use.exceeded else ""
        table.add_row(Text(use.quantity, style=style), f"{use.value:.4g}", limit, use.unit)
    return table


def recording_table(recording: Recording) -> Table:
    """Return a table of a recording's channels."""
    table = Table(
        title=f"recording '{recording.name}', role {recording.role}",
        title_justify="left",
        header_style="bold",
    )
    for name in ("channel", "shape", "unit", "rate", "from", "to", "smallest", "largest"):
        table.add_column(name, justify="left" if name in ("channel", "unit") else "right")
    for name in recording.channels:
        values, time = recording[name], recording.time(name)
        rate = 1.0 / np.median(np.diff(time)) if len(time) > 1 else float("nan")
        table.add_row(
            name,
            "x".join(map(str, values.shape)),
            recording.unit(name),
            f"{rate:.4g} Hz",
            f"{time[0]:.4g} s",
            f"{time[-1]:.4g} s",
            f"{np.nanmin(values):.4g}",
            f"{np.nanmax(values):.4g}",
        )
    return table
