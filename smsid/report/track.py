"""The report of ``smsid track``: every parameter over time with its band, and whether the model holds."""

from __future__ import annotations

import numpy as np

from smsid._statistics import NORMAL95
from smsid._time_text import time_text
from smsid.report.axes import Axis
from smsid.report.model import Figure, Grid, Provenance, Report, Section, Table, Text, Tone, cells
from smsid.report.numbers import number, unit
from smsid.report.plot import Band, Curve, Plot, Rule
from smsid.tracking.history import TrackHistory

WIDE = 2.0  # standard deviations of a band
WIDEST = 4.0  # times the later spread that a band at the start is shown
MOST = 40  # parameters that are drawn
RIGHT = (0.8, 1.25)  # root mean square of innovations between which a model counts as right


def track_report(history: TrackHistory, origin: Provenance) -> Report:
    """Return the report of a history."""
    sentence, tone = verdict(history)
    starts = [float(history.time[history.recording == k][0]) for k in range(1, len(history.recordings))]
    drawn = tuple(_parameter(history, i, starts) for i in range(min(MOST, len(history.names))))
    sections = [
        Section("parameters", "Parameters over time", (Grid("bands of two standard deviations", drawn),)),
        Section("fit", "Innovations", (_fit(history, starts),), "one while the model is right"),
        Section("values", "At the end", (values_table(history),), f"{len(history.names)} followed"),
    ]
    lines = [f"{time_text(e.time, history.time[0])}: {e.kind} {e.channel}: {e.text}" for e in history.events]
    if lines or history.notes:
        text = Text((*lines, *history.notes), bullets=True)
        sections.append(Section("events", "Events and notes", (text,), f"{len(lines)} events"))
    glance = (
        ("followed", str(len(history.names))),
        ("recordings", str(len(history.recordings))),
        ("time", f"{number(float(history.time[-1] - history.time[0]), 4)} s"),
    )
    return Report("Track", history.description, sentence, tone, sections, origin, glance)


def verdict(history: TrackHistory) -> tuple[str, Tone]:
    """Return one sentence on whether the model holds all along, and what it is worth."""
    late = history.fit[len(history.fit) // 4 :]
    rms = np.sqrt(np.nanmean(late**2, axis=0))
    low, high = RIGHT
    loud, quiet = (
        [f"{c} ({x:.2g})" for c, x in zip(history.channels, rms, strict=True) if beyond(x)]
        for beyond in (lambda x: x >= high, lambda x: x <= low)
    )
    if loud:
        return f"Innovations are larger than expected: {', '.join(loud)}; one is right.", "warn"
    if quiet:
        held = (
            "Innovations are no larger than expected: the model holds with parameters as followed. Small in "
        )
        wide = "one is right: noise, or what torques nobody measured may be, is stated wide."
        return f"{held}{', '.join(quiet)}; {wide}", "good"
    return "Innovations are those of the stated noise: the model holds with parameters as followed.", "good"


def _parameter(history: TrackHistory, i: int, starts: list[float]) -> Figure:
    t, x, s = history.time, history.values[:, i], history.sigmas[:, i]
    name, unit = history.names[i], history.units[i]
    low, high = x - WIDE * s, x + WIDE * s
    later = slice(len(t) // 4, None)
    middle, spread = float(np.median(x[later])), float(np.ptp(np.concatenate([low[later], high[later]])))
    within = (middle - WIDEST * spread, middle + WIDEST * spread) if spread > 0.0 else None
    smoothed = ()
    if history.smoothed is not None:
        y, r = (k[:, i] for k in (history.smoothed.values, history.smoothed.sigmas))
        smoothed = (
            Band("smoothed", t, y - WIDE * r, y + WIDE * r, colour=1),
            Curve("smoothed", t, y, colour=1),
        )
    marks = (
        Band("two standard deviations", t, low, high),
        Curve(name, t, x),
        *smoothed,
        Rule("as described", float(history.described[i]), upright=False, colour=2),
        *(Rule("", start) for start in starts),
    )
    axis = Axis.over(f"[{unit}]", [low, high, history.described[i : i + 1]], within=within)
    alt = f"{name} over time, from {x[0]:.4g} to {x[-1]:.4g} {unit}"
    return Figure(f"parameter-{i}", name, Plot(Axis.over("time [s]", [t]), axis, marks, alt, 200))


def _fit(history: TrackHistory, starts: list[float]) -> Figure:
    curves = [
        Curve(c, history.time, x, colour=k, style="thin")
        for k, (c, x) in enumerate(zip(history.channels, history.fit.T, strict=True))
    ]
    marks = (*curves, Rule("right", 1.0, upright=False), *(Rule("", s) for s in starts))
    axis = Axis.over("root mean square", [history.fit], within=(0.0, 10.0))
    alt = "root mean square of the normalised innovations by channel over time"
    title = "Innovations in their own standard deviations"
    return Figure("fit", title, Plot(Axis.over("time [s]", [history.time]), axis, marks, alt))


def values_table(history: TrackHistory) -> Table:
    """Return every parameter as described, at the beginning and at the end."""
    rows = []
    for i, name in enumerate(history.names):
        known = (history.described[i], 5), (history.values[0, i], 5), (history.values[-1, i], 5)
        rows.append(cells(name, *known, (NORMAL95 * history.sigmas[-1, i], 2), unit(history.units[i])))
    return Table("Parameters", ("parameter", "#described", "#first", "#last", "#± 95 %", "unit"), rows)
