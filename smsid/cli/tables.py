"""Tables that the command line prints."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from smsid._time_text import time_text
from smsid.cli.output import WIDTH, clip_line
from smsid.identify.estimate import Estimate, ParameterEstimate
from smsid.identify.estimate_text import asked_for, headline, short_name
from smsid.recording import Recording

if TYPE_CHECKING:
    from rich.console import RenderableType

    from smsid.experiments.fly import LimitUse
    from smsid.report.model import Table as ReportTable

TITLES = {
    "arm": "torques of a welded arm: combinations of links, friction, motors",
    "exp1": "Exp. 1: mass, slosh, appendage",
    "modes": "SSI-COV: modes of the appendages",
    "exp2.step_a": "Exp. 2, Step A: system CM and first moments",
    "exp2.step_b": "Exp. 2, Step B with the slosh state: identifiable inertial parameters",
    "exp2.step_b_printed": "Exp. 2, Step B as printed: pi_m with products of first moments over m_s",
    "exp2.pose_point": "Exp. 2: the tracked point",
    "maximum_likelihood": "maximum likelihood",
    "nuisance": "nuisance parameters: biases, clocks, where a recording begins",
}
"""Titles of groups of parameters; any other group is titled by its name."""

ROWS = 28  # of a table, unless everything is asked for
CELL = 38  # characters of a name in a table
LEAST = 20  # characters that a name has in any case
GAP = 2  # between columns
TONE_STYLE = {"good": "green", "warn": "yellow", "bad": "red", "neutral": ""}
PLAIN = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−–\N{NO-BREAK SPACE}", "-0123456789-- ")
DOUBTS = 5  # lines of what cannot be told


def plain_table(
    *columns: str, title: str | None = None, left: Iterable[str] = (), fold: bool = False
) -> Table:
    """Return a table without frame: numbers to the right, the columns in ``left`` to the left.

    ``fold``: names in the first column are written in full, over several lines, instead of cut off.
    """
    look = {"box": box.SIMPLE_HEAD, "pad_edge": False, "padding": (0, GAP - 1, 0, 0)}
    table = Table(title=title, title_justify="left", header_style="bold", **look)  # type: ignore[arg-type]
    chosen = set(left)
    for name in columns:
        side = "left" if name in chosen else "right"
        table.add_column(escape(name), justify=side, no_wrap=True, overflow="ellipsis")
    if fold:
        table.columns[0].no_wrap, table.columns[0].overflow = False, "fold"
    return table


def report_table(table: ReportTable, *, columns: Sequence[str] = (), everything: bool = True) -> Table:
    """Return a table of a report for the terminal, in plain characters: some of its ``columns``, or all.

    ``everything``: the first column in full, over several lines; else a name is as short as it may be.
    """
    names = [c.removeprefix("#") for c in table.columns]
    kept = [k for k, name in enumerate(names) if not columns or name in columns]
    left = [names[k] for k in kept if not table.columns[k].startswith("#")]
    made = plain_table(*(names[k] for k in kept), title=table.title or None, left=left, fold=everything)
    rows = [[plain_text(row[k].text) for k in kept] for row in table.rows]
    widths = [max(map(len, own)) for own in zip([names[k] for k in kept], *rows, strict=True)][1:]
    room = WIDTH - sum(widths) - GAP * (len(kept) + 1)
    least = min(LEAST, max((len(row[0]) for row in rows), default=LEAST))
    if room < least and rows:  # the widest of the others goes over several lines, between words
        k = 1 + max(range(len(widths)), key=widths.__getitem__)
        words = [len(w) for text in (names[kept[k]], *(row[k] for row in rows)) for w in text.split()]
        folded = max(widths[k - 1] - (least - room), *words, 1)
        made.columns[k].no_wrap, made.columns[k].max_width = False, folded
        room += widths[k - 1] - folded
    made.columns[0].min_width = least = max(1, min(least, room))
    made.columns[0].max_width = room = min(max(least, room), 58 if everything else CELL)
    for row, texts in zip(table.rows, rows, strict=True):
        first = texts[0] if everything else short_name(texts[0], room)
        styles = [TONE_STYLE[row[k].tone] for k in kept]
        made.add_row(*(Text(text, style) for text, style in zip((first, *texts[1:]), styles, strict=True)))
    return made


def plain_text(text: str) -> str:
    """Return a number or unit of a report as a terminal shows it and a program reads it: ``m/s^2``."""
    raised = re.sub(r"(·10)?([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", lambda m: ("e" if m[1] else "^") + m[2], text)
    plain = raised.translate(PLAIN)
    return re.sub(r"(?<![\w.])-?\d[\d.]*e-?\d+(?![\w.])", lambda m: f"{float(m[0]):.6g}", plain)


def estimate_parts(estimate: Estimate, *, everything: bool = False) -> Iterator[RenderableType]:
    """Yield what to print of an estimate: what is known, the parameters asked for, what cannot be told.

    ``everything``: every parameter of every group with its full name.
    """
    yield Text(headline(estimate), style="bold")
    if everything:
        for group in estimate.groups:
            yield parameter_table(TITLES.get(group, group), estimate.group(group), full=True)
        return
    asked = asked_for(estimate)
    # an estimate of by-products alone is shown all the same
    shown = asked or estimate.parameters
    yield parameter_table("", shown[:ROWS])
    more, beside = len(shown) - min(len(shown), ROWS), len(estimate) - len(shown)
    told = [f"{more} more parameters"] if more else []
    told += [f"{beside} nuisance parameters and other views"] if beside else []
    if told:
        yield Text(f"{' and '.join(told)} with --all", style="dim")
    yield from (Text(clip_line(line), style="yellow") for line in doubts(asked))


def doubts(parameters: Iterable[ParameterEstimate]) -> list[str]:
    """Return in at most `DOUBTS` lines which parameters are not identifiable, by reason."""
    reasons: dict[str, list[str]] = {}
    for p in parameters:
        if p.status == "not_identifiable":
            reasons.setdefault(_reason(p), []).append(short_name(p.name, 30))
    lines = []
    for reason, names in reasons.items():
        listed = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
        lines.append(f"not identifiable: {listed}" + (f" ({reason})" if reason else ""))
    if len(lines) > DOUBTS:
        rest = sum(len(names) for names in list(reasons.values())[DOUBTS - 1 :])
        lines = [*lines[: DOUBTS - 1], f"not identifiable: {rest} more, see --all"]
    return lines


def _reason(p: ParameterEstimate) -> str:
    """Return a parameter's note without the number in it, so that those of one kind are told together."""
    if p.note.startswith("predicted standard deviation"):
        return "interval above 10 % of its size: fly a richer or longer experiment"
    if "of its variance is the prior's" in p.note:
        return "the data do not see it: mostly the prior's"
    return p.note.split("; ")[0]


def parameter_table(title: str, parameters: Iterable[ParameterEstimate], *, full: bool = False) -> Table:
    """Return a table of parameters with interval, status and the description's value; ``full``: all names."""
    from smsid.report.parameters import parameter_table as of_report

    columns = ("parameter", "value", "95 % interval", "unit", "described", "status")
    return report_table(of_report(title, parameters), columns=columns, everything=full)


def limits_table(limits: Iterable[LimitUse]) -> Table:
    """Return a table of how far limits were used."""
    table = plain_table("quantity", "largest", "limit", "unit", title="limits", left=("quantity", "unit"))
    for use in limits:
        limit = "-" if use.limit is None else f"{use.limit:.4g}"
        style = "red" if use.exceeded else ""
        table.add_row(Text(use.quantity, style=style), f"{use.value:.4g}", limit, use.unit)
    return table


def _shown_unit(recording: Recording, name: str) -> str:
    """Return the unit of a channel; of joints that slide their own, as in 'rad, rail m'."""
    from smsid.model.column_order import joints_imported
    from smsid.recording.channels import SLIDING

    unit = recording.unit(name)
    sliding = joints_imported(recording, "sliding")
    if not sliding or unit not in SLIDING or ".joint_" not in name:
        return unit
    if set(sliding) >= set(recording.labels.get("joint", ())):
        return SLIDING[unit]
    return ", ".join([unit, *(f"{label} {SLIDING[unit]}" for label in sliding)])


def recording_table(recording: Recording) -> Table:
    """Return a table of a recording's channels."""
    table = plain_table(
        *("channel", "shape", "unit", "rate", "from", "to", "smallest", "largest"),
        title=f"recording '{recording.name}', role {recording.role}",
        left=("channel", "unit"),
    )
    for c in channel_rows(recording):
        span = f"{c['rate'] or float('nan'):.4g} Hz", time_text(c["from"]), time_text(c["to"])
        ends = f"{c['smallest']:.4g}", f"{c['largest']:.4g}"
        table.add_row(c["name"], "x".join(map(str, c["shape"])), c["unit"], *span, *ends)
    return table


def channel_rows(recording: Recording) -> list[dict[str, Any]]:
    """Return of every channel name, unit, shape, rate [Hz], first and last time [s], and its range."""
    rows = []
    for name in recording.channels:
        values, time = recording[name], recording.time(name)
        own = {"name": name, "unit": _shown_unit(recording, name), "shape": list(values.shape)}
        step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        own |= {"rate": 1.0 / step if step > 0.0 else None, "from": float(time[0]), "to": float(time[-1])}
        rows.append(own | {"smallest": float(np.nanmin(values)), "largest": float(np.nanmax(values))})
    return rows


ROOM = 40  # rows of all tables together, unless everything is asked for


def cut_tables(tables: Iterable[Table], everything: bool, room: int = ROOM) -> Iterator[RenderableType]:
    """Yield tables that share ``room`` rows, and after each how many rows it has more.

    Small tables are shown in full: what they do not need is left for the large ones.
    """
    given = list(tables)
    for k, table in enumerate(given):
        if everything:
            yield table
            continue
        others = sum(min(t.row_count, room // (len(given) - k)) for t in given[k + 1 :])
        most = max(room - others, 3)
        left = table.row_count - most
        if left > 0:
            del table.rows[most:]
            for column in table.columns:
                del column._cells[most:]
        room -= table.row_count
        yield table
        if left > 0:
            yield Text(f"{left} more rows with --all", style="dim")
