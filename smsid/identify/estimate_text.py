"""An estimate as text, as a table in a notebook, and as a table of pandas."""

from __future__ import annotations

import re
from html import escape
from typing import TYPE_CHECKING

from smsid.errors import require
from smsid.identify.estimate import BY_PRODUCT_GROUPS, Estimate, ParameterEstimate
from smsid.identify.parameter_estimate import SECOND_VIEW

if TYPE_CHECKING:
    import pandas as pd

LINES = 30  # of the text, at most
NAME = 44  # characters of a name in the text


def short_name(name: str, width: int = NAME) -> str:
    """Return a name of at most ``width`` characters: a combination with as many terms as fit.

    ``bus.Ixx + 2 link1.m + ... (7 terms)``: the first term of a combination is in no other of its estimate.
    """
    if len(name) <= width:
        return name
    parts = re.split(r" (?=[+-] )", name)
    tail = f" + ... ({len(parts)} terms)"
    kept = parts[0]
    if len(parts) == 1 or len(kept) + len(tail) > width:
        return name[: width - 4] + " ..."
    for part in parts[1:]:
        if len(kept) + 1 + len(part) + len(tail) > width:
            break
        kept += f" {part}"
    return kept + tail


def headline(estimate: Estimate) -> str:
    """Return one line: what was identified, how, from what, and how much of it is known."""
    asked = asked_for(estimate)
    good = sum(p.status == "identifiable" for p in asked)
    source = f" from {', '.join(n or 'unnamed' for n in estimate.recordings)}" if estimate.recordings else ""
    what = "parameter" if len(asked) == 1 else "parameters"
    return (
        f"estimate of '{estimate.description}' by {estimate.method.replace('_', ' ')}{source}: "
        f"{good} of {len(asked)} {what} identifiable"
    )


def asked_for(estimate: Estimate) -> tuple[ParameterEstimate, ...]:
    """Return the parameters of what was identified: no nuisances, no second view of the same."""
    own = (p for p in estimate.parameters if p.status != "by_product" and p.group not in BY_PRODUCT_GROUPS)
    return tuple(p for p in own if not p.note.startswith(SECOND_VIEW))


def text(estimate: Estimate) -> str:
    """Return the text that stands for an estimate, at most `LINES` lines."""
    asked = asked_for(estimate)
    shown = asked[: LINES - 2]
    width = max((len(short_name(p.name)) for p in shown), default=0)
    lines = [headline(estimate)]
    for p in shown:
        mark = "" if p.status != "not_identifiable" else "  not identifiable"
        lines.append(f"  {short_name(p.name):{width}}  {p.value:.6g} ± {1.96 * p.sigma:.2g} {p.unit}{mark}")
    left = len(estimate) - len(shown)
    if left:
        lines.append(f"  {left} more: estimate.names, estimate[name], estimate.to_dataframe()")
    return "\n".join(lines)


def html(estimate: Estimate) -> str:
    """Return the table that a notebook shows, all parameters of what was identified in it."""
    rows = []
    for p in asked_for(estimate):
        low, high = p.interval
        cells = (f"{p.value:.6g}", f"{low:.6g} … {high:.6g}", p.unit, p.status.replace("_", " "))
        name = f'<td style="text-align:left" title="{escape(p.name)}">{escape(short_name(p.name))}</td>'
        rows.append(f"<tr>{name}{''.join(f'<td>{escape(c)}</td>' for c in cells)}</tr>")
    head = "".join(f"<th>{h}</th>" for h in ("parameter", "value", "95 % interval", "unit", "status"))
    return (
        f"<p>{escape(headline(estimate))}</p><table><thead><tr>{head}</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


def dataframe(estimate: Estimate) -> pd.DataFrame:
    """Return all parameters by name; raises `MissingDependencyError` without pandas."""
    frame = require("pandas", "pandas").DataFrame
    low, high = estimate.intervals.T
    own = estimate.parameters
    columns = {
        "value": estimate.values,
        "sigma": estimate.sigmas,
        "low": low,
        "high": high,
        "unit": list(estimate.units),
        "status": [p.status for p in own],
        "described": [float("nan") if p.nominal is None else p.nominal for p in own],
        "group": [p.group for p in own],
        "note": [p.note for p in own],
    }
    return frame(columns, index=list(estimate.names))
