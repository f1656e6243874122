"""The report of ``smsid control``: the design, its loop with slosh and panel inside, and how robust it is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from smsid.control.controller_file import controller_document
from smsid.control.design import ControllerDesign
from smsid.control.robustness import Robustness
from smsid.control.tuning import CLEARANCE, TuningResult
from smsid.report.axes import Axis
from smsid.report.model import Cell, Figure, Provenance, Report, Section, Table, Text, Tone, cells
from smsid.report.numbers import number, share
from smsid.report.plot import Curve, Plot
from smsid.report.rows import Bar, ChartRow, Mark, RowChart

LIGHT = 0.001  # damping ratio below which the axis ends
SHOWN = 14


def control_report(made: ControllerDesign, origin: Provenance) -> Report:
    """Return the report of a design."""
    sentence, tone = verdict(made)
    d = controller_document(made)
    designed = blocks_table(d), Text(model_lines(d), bullets=True)
    sections = [Section("blocks", "What is designed", designed, f"{len(made.term.blocks)} groups")]
    if made.tuning is not None:
        parts = _modes(made.tuning), modes_table(d)
        sections.append(Section("modes", "Natural frequencies and gains", parts, "where gains keep out of"))
    gist = "slosh and panel inside the plant"
    sections.append(Section("poles", "Poles of the loop", (_poles(made), poles_table(d)), gist))
    if made.robustness is not None:
        gist = f"mu between {number(made.robustness.mu_lower, 3)} and {number(made.robustness.mu_upper, 3)}"
        sections.append(Section("robust", "Robust stability", _robust(made.robustness), gist))
    else:
        text = Text(("Not evaluated: no estimate with intervals was given.",))
        sections.append(Section("robust", "Robust stability", (text,), "not evaluated"))
    glance = [("gamma", number(made.term.gamma, 3)), ("uncertainty designed for", share(made.level, 3))]
    if made.robustness is not None:
        glance.append(("mu, upper bound", number(made.robustness.mu_upper, 3)))
    least = min((p.damping for p in made.poles), default=math.nan)
    glance.append(("least damping ratio", number(least, 2)))
    return Report("Controller", made.description, sentence, tone, sections, origin, glance)


def verdict(made: ControllerDesign) -> tuple[str, Tone]:
    """Return one sentence on a design, and what it is worth."""
    flagged = sorted({p.name for p in made.poles if p.flag})
    driven = f" It takes damping from {', '.join(flagged)}." if flagged else ""
    gamma = f"The weighted loop has gamma {number(made.term.gamma, 3)}"
    r = made.robustness
    if r is None:
        return f"{gamma}; robust stability was not evaluated, for want of an estimate.{driven}", "neutral"
    if r.unstable or r.damping <= 0.0:
        return f"{gamma}, and plants within the identified intervals are unstable.{driven}", "bad"
    if not r.stable:
        text = "that every plant within the identified intervals is stable is not shown"
        return f"{gamma}; {text}.{driven}", "warn"
    sentence = (
        f"{gamma}, and the loop stays stable over the identified intervals: mu is at most "
        f"{number(r.mu_upper, 2)}, and none of {r.samples} plants drawn from the estimate is unstable."
    )
    return sentence + driven, "warn" if flagged else "good"


def blocks_table(document: Mapping[str, Any]) -> Table:
    """Return the groups of coordinates of a controller's document with their bounds and margins."""
    rows = []
    for b in document["blocks"]:
        low, high = (math.inf if x is None else x for x in b["gain_margin"])
        loop = (b["crossover"]["value"], 3), (b["sensitivity_peak"], 3), (b["complementary_peak"], 3)
        margins = f"{number(low, 2)} … {number(high, 3)}", (b["phase_margin"]["value"], 3)
        known = (b["gamma"], 4), (max(b["error_bound"]["value"]), 3)
        rows.append(cells(", ".join(b["coordinates"]), *known, *loop, *margins))
    columns = ("coordinates", "#gamma", "#e [rad]", "#crossover [rad/s]", "#S, peak", "#T, peak",
               "#gain margin", "#phase margin [deg]")  # fmt: skip
    note = (
        "e: bound on the error. Margins hold for all channels of a group at once. S and T are taken at the "
        "plant's input."
    )
    return Table("H-infinity term and margins", columns, rows, note)


def modes_table(document: Mapping[str, Any]) -> Table:
    """Return the natural frequencies of a controller's document and the bands that gains keep out of."""
    rows = []
    for m in document.get("natural_frequencies", ()):
        ends = m["low"], m["high"], m["low"] / CLEARANCE, m["high"] * CLEARANCE
        state = "held" if m["held"] else "free"
        rows.append(cells(m["name"], state, *((x, 5) for x in (m["frequency"], *ends))))
    columns = ("mode", "base and joints", "#rad/s", "#95 % from", "#to", "#band from", "#to")
    return Table("Natural frequencies", columns, rows)


def poles_table(document: Mapping[str, Any]) -> Table:
    """Return the poles of a controller's document, those that are flagged first."""
    rows = []
    for p in sorted(document["poles"], key=lambda p: not p["flag"]):
        damped: Tone = "bad" if p["damping"] <= 0.0 else "neutral"
        flag = Cell(p["flag"], tone="warn" if p["flag"] else "neutral")
        rows.append(cells(p["mode"], (math.hypot(*p["value"]), 4), (p["damping"], 4, damped), flag))
    return Table("Poles of the loop, slosh and panel inside", ("mode", "#rad/s", "#damping ratio", ""), rows)


def model_lines(document: Mapping[str, Any]) -> list[str]:
    """Return where the controller's model and weights are from."""
    lines, model = list(document["weights"]["origin"]), document.get("model", {})
    if model.get("identified"):
        left = model["as_described"]
        told = f"; as described: {', '.join(left)}" if left else ""
        lines.insert(0, f"controller's model: {len(model['identified'])} parameters of the estimate{told}")
    return lines


def _modes(tuning: TuningResult) -> Figure:
    rows, values = [], []
    for m in tuning.modes:
        low, high = m.band
        state = "held" if m.held else "free"
        tip = f"{number(m.frequency, 5)} rad/s, 95 %: {number(m.low, 5)} to {number(m.high, 5)}"
        mark = Mark(m.frequency, m.low, m.high, 0, "dot" if m.held else "ring", tip)
        rows.append(ChartRow(f"{m.name}, base and joints {state}", (mark,), number(m.frequency, 4), m.band))
        values += [low, high]
    gains = [(tuning.attitude, "attitude gains")]
    gains += [] if math.isnan(tuning.joints) else [(tuning.joints, "joint gains")]
    axis = Axis.over("frequency [rad/s]", [values, [g for g, _ in gains]], log=True)
    legend = (("base and joints held", 0, "dot"), ("free", 0, "ring"))
    chart = RowChart(axis, rows, "natural frequencies with the bands that gains keep out of", legend, gains)
    caption = "Shaded: where no gain's frequency may lie, the 95 % interval widened by a factor of 1.25."
    return Figure("bands", "Natural frequencies and where the gains lie", chart, caption)


def _poles(made: ControllerDesign) -> Figure:
    x = np.array([abs(p.value) for p in made.poles])
    damping = np.array([p.damping for p in made.poles])
    shown = np.clip(damping, LIGHT, None)
    hidden = ("tank", "slosh", "panel", "mode")
    soft = np.array([any(k in p.name for k in hidden) for p in made.poles])
    flagged = np.array([bool(p.flag) for p in made.poles])
    marks = [
        Curve("attitude, joints, controller", x[~soft], shown[~soft], 2, "points"),
        Curve("slosh and panel", x[soft & ~flagged], shown[soft & ~flagged], 0, "points"),
        Curve("flagged", x[flagged], shown[flagged], 1, "rings"),
    ]
    marks = [m for m in marks if len(m.x)]
    y = Axis.over("damping ratio", [shown, [1.0]], log=True, room=0.08)
    axis = Axis.over("frequency [rad/s]", [x], log=True)
    plot = Plot(axis, y, marks, "poles of the closed loop", 250)
    return Figure("pole-plot", "Frequency and damping of every pole", plot)


def _robust(r: Robustness) -> tuple[Text | Table | Figure, ...]:
    facts = (
        ("mu, upper bound (below one: all stable)", r.mu_upper),
        ("at [rad/s]", r.frequency),
        ("mu, lower bound", r.mu_lower),
        ("least damping ratio at the worst parameters", r.damping),
        ("plants drawn from the estimate", float(r.samples)),
        ("unstable among them", float(r.unstable)),
        ("least damping ratio among them", r.sampled_damping),
    )
    note = (
        "Over the identified intervals. With mu below one every plant within them is stable; the lower "
        "bound is from an unstable plant found at 1/mu of the intervals."
    )
    table = Table("Robust stability", ("quantity", "#value"), [cells(k, (v, 4)) for k, v in facts], note)
    worst = sorted(r.worst.items(), key=lambda x: -abs(x[1]))[:SHOWN]
    bars = [
        ChartRow(name, (Bar(value, 0 if value > 0 else 1, 0.0),), f"{value:+.2f}".replace("-", "−"))
        for name, value in worst
    ]
    axis = Axis("share of the 95 % interval", -1.1, 1.1, ticks=((-1.0, "−1"), (0.0, "0"), (1.0, "1")))
    chart = RowChart(axis, bars, "the worst parameters found", rules=((0.0, ""),))
    caption = "Where within the identified intervals the loop is damped least, as far as a search found."
    return table, Figure("worst", "Worst parameters", chart, caption)
