from __future__ import annotations

import numpy as np
import pytest

from smsid.report._traces import Trace, Traces
from smsid.report.axes import Axis
from smsid.report.heat import HeatCell, HeatMap
from smsid.report.model import Cell, Figure, Grid, Provenance, Report, Section, Table, Text
from smsid.report.plot import Band, Curve, Plot, Rule
from smsid.report.rows import Bar, ChartRow, Mark, RowChart

HOSTILE = '</script><script>alert("x")</script> & "quoted" \'single\''


@pytest.fixture
def origin() -> Provenance:
    return Provenance(
        "2026-01-01", "smsid identify a.toml", {"smsid": "1"}, "Linux", {"a.toml": "ab" * 32}, "7"
    )


def trace(name: str = "imu x", samples: int = 5000, seed: int = 0) -> Trace:
    """A slow motion with noise, and a spike that thinning must not lose."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 50.0, samples)
    simulated = np.sin(time)
    noise = 0.01 * rng.standard_normal(samples)
    noise[samples // 3] = 0.5
    return Trace(name, "m/s^2", time, simulated + noise, simulated, noise, 0.01, noise + 0.02)


@pytest.fixture
def report(origin: Provenance) -> Report:
    """A report with one of everything, and text that would break a page that does not escape it."""
    x = np.linspace(0.0, 10.0, 50)
    marks = (Band("band", x, x - 1, x + 1, 2), Curve("line", x, x), Curve("rings", x, x, 1, "rings"))
    plot = Plot(Axis.over("x", [x]), Axis.over("y", [x]), (*marks, Rule("at", 5.0)), "a plot")
    rows = (
        ChartRow("mass", (Bar(0.1), Mark(0.02, 0.01, 0.03)), "± 10 %", (0.01, 0.1)),
        ChartRow("far", (Mark(1e9),)),
    )
    chart = RowChart(Axis("share", 1e-3, 1.0, True, ((0.01, "0.01"),)), rows, "rows", (("bar", 0, "bar"),))
    heat = HeatMap(
        ("a", "b"), ("c",), ((HeatCell(7, "99", HOSTILE, True),), (HeatCell(),)), "map", ((0, "calm"),)
    )
    table = Table(
        HOSTILE,
        ("name", "#value"),
        ((Cell("long " * 20), Cell("1.23", 1.23456789)), (Cell('with "quotes", comma'), Cell("–"))),
    )
    picks = Table("channels", ("channel",), ((Cell("imu x"),), (Cell("imu y"),)), target="traces")
    traces = Figure("traces", "Traces", Traces((trace(), trace("imu y", seed=1)), "traces"))
    sections = (
        Section(
            "one", "One", (Text((HOSTILE,)), table, Figure("plot", "Plot", plot), Figure("rows", "R", chart))
        ),
        Section("two", "Two", (Grid("grid", (Figure("heat", "Map", heat),)), traces, picks), open=False),
    )
    return Report("Title", HOSTILE, "It works.", "good", sections, origin, (("n", "3"),))
