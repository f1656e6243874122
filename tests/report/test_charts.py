"""Charts put data where it belongs, whatever the axis; numbers read as people write them."""

from __future__ import annotations

import base64
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smsid.report._traces import Traces, spark
from smsid.report.axes import Axis, ticks_of
from smsid.report.heat import step_of
from smsid.report.numbers import half, number, share, tick_label, unit
from smsid.report.plot import Band, Curve, Plot, Rule, path
from smsid.report.rows import ChartRow, Mark, RowChart

from .conftest import trace


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 4, "0"),
        (2256.83, 6, "2256.83"),
        (-0.5, 3, "−0.5"),
        (240.0, 2, "240"),
        (1.25e-5, 3, "1.25·10⁻⁵"),
        (0.000161, 3, "1.61·10⁻⁴"),
        (3.2e9, 2, "3.2·10⁹"),
        (math.nan, 3, "–"),
        (None, 3, "–"),
        (-math.inf, 3, "−∞"),
    ],
)
def test_numbers(value, digits, text):
    assert number(value, digits) == text


def test_units_shares_and_intervals():
    gap = "\N{NO-BREAK SPACE}"  # a narrow tile breaks no unit over two lines
    assert unit("kg m^2") == f"kg{gap}m²" and unit("kg^-1 m^2") == f"kg⁻¹{gap}m²" and unit("1") == ""
    assert share(0.0123) == "1.2 %"
    assert share(float("inf")) == share(float("nan")) == "–"
    assert half(1.0, 0.9, 1.1) == "± 0.1"
    assert half(1.0, 0.9, 1.4) == "0.9 … 1.4"
    assert half(1.0, 0.5, math.inf) == "0.5 … ∞"
    assert tick_label(0.30000000000000004) == "0.3"


@settings(max_examples=200, deadline=None)
@given(st.floats(-1e9, 1e9), st.floats(1e-6, 1e9), st.integers(3, 8))
def test_ticks_are_round_even_and_inside(low, span, count):
    high = low + span
    if not high > low or span < 1e-6 * abs(low):
        return
    values = [v for v, _ in ticks_of(low, high, count=count)]
    assert 3 <= len(values) <= 4 * count
    slack = 1e-6 * span
    assert min(values) >= low - slack and max(values) <= high + slack
    steps = np.diff(values)
    assert steps == pytest.approx(steps[0], rel=1e-6)
    mantissa = steps[0] / 10.0 ** math.floor(math.log10(steps[0]) + 1e-9)
    assert min(abs(mantissa - m) for m in (1.0, 2.0, 2.5, 5.0, 10.0)) < 1e-6


@pytest.mark.parametrize(("low", "high"), [(1e-9, 1e5), (0.2, 7.0), (3.0, 40.0), (1e-3, 2e-3)])
def test_logarithmic_ticks(low, high):
    values = [v for v, _ in ticks_of(low, high, log=True)]
    assert values and all(low <= v * (1 + 1e-9) and v <= high * (1 + 1e-9) for v in values)


def test_axes_leave_out_what_is_not_finite():
    axis = Axis.over("x", [np.array([1.0, np.nan, np.inf, 3.0]), [2.0]], room=0.0)
    assert (axis.low, axis.high) == (1.0, 3.0)
    axis = Axis.over("x", [[-1.0, 0.0, 0.01, 100.0]], log=True, room=0.0)
    assert (axis.low, axis.high) == (pytest.approx(0.01), pytest.approx(100.0))
    assert float(axis.at(1.0)) == pytest.approx(0.5)
    assert Axis.over("x", []).high > Axis.over("x", []).low


def test_curves_stand_where_the_data_are():
    x, y = np.array([0.0, 5.0, 10.0]), np.array([0.0, np.nan, 100.0])
    plot = Plot(Axis("x", 0.0, 10.0), Axis("y", 0.0, 100.0), (Curve("c", x, y),), "alt")
    assert plot.shapes() == [("line", 0, "M0.0 1000.0M1000.0 0.0")]
    points = Plot(plot.x, plot.y, (Curve("c", x, np.array([0.0, 50.0, 500.0]), 1, "points"),), "alt")
    assert points.shapes() == [("points", 1, "M0.0 1000.0h0M500.0 500.0h0")]
    rules = Plot(plot.x, plot.y, (Rule("a", 2.5), Rule("b", 75.0, False), Rule("off", 11.0)), "alt")
    assert [d for _, _, d in rules.shapes()] == ["M250.0 0V1000", "M0 250.0H1000"]
    assert rules.labels() == [("a", 25.0, True), ("b", 75.0, False)]
    band = Plot(plot.x, plot.y, (Band("b", x[::2], y[::2], y[::2] + 10.0),), "alt")
    assert band.shapes() == [("band", 0, "M0.0 1000.0L1000.0 0.0L1000.0 0.0L0.0 900.0Z")]


def test_paths_break_where_nothing_is():
    x = np.arange(5.0)
    assert path(x, np.array([1.0, 2.0, np.nan, 3.0, 4.0]), 0) == "M0 1L1 2M3 3L4 4"
    assert path(x[:0], x[:0]) == ""


def test_rows_keep_what_is_off_the_axis_at_its_end():
    chart = RowChart(Axis("x", 1e-2, 1.0, True), (ChartRow("a", (Mark(10.0),)),), "alt")
    assert [chart.place(v) for v in (1e-2, 0.1, 1.0, 10.0, 0.0)] == [0.0, 50.0, 100.0, 100.0, 0.0]
    assert [chart.beyond(v) for v in (1e-3, 0.1, 10.0)] == ["low", "", "high"]
    assert chart.span(1.0, 0.1) == (50.0, 50.0)


def test_steps_of_colour():
    edges = (0.1, 0.5, 0.9)
    assert [step_of(x, edges) for x in (0.0, 0.1, 0.6, 2.0)] == [0, 1, 2, 3]


def decoded(entry: dict, key: str) -> np.ndarray:
    steps = np.frombuffer(base64.b64decode(entry[key]), dtype="<i2").astype(float)
    out = entry["low"] + (steps + 32766) / 65532 * entry["span"]
    return np.where(steps == -32768, np.nan, out)


@pytest.mark.parametrize("budget", [10_000_000, 4000])
def test_traces_keep_the_extremes_of_every_stretch(budget):
    own = trace()
    data = json.loads(Traces((own,), "alt", budget=budget).data())
    series = data["series"][0]
    times = np.frombuffer(base64.b64decode(data["clocks"][0]), dtype="<f4")
    for key, values in (("m", own.measured), ("s", own.simulated), ("p", own.residual), ("b", own.before)):
        low = decoded(series[key], "a")
        high = decoded(series[key], "b") if "b" in series[key] else low
        fine = 1e-4 * np.ptp(values)
        assert (low.min(), high.max()) == (
            pytest.approx(values.min(), abs=fine),
            pytest.approx(values.max(), abs=fine),
        )
        starts = np.searchsorted(own.time, times - 1e-5)
        for k in (0, len(starts) // 3, len(starts) - 1):
            part = values[starts[k] : starts[k + 1] if k + 1 < len(starts) else None]
            assert (low[k], high[k]) == (
                pytest.approx(part.min(), abs=fine),
                pytest.approx(part.max(), abs=fine),
            )
    kept = len(decoded(series["p"], "a"))
    assert kept == (len(own.time) if budget > 1e6 else budget // 4)


def test_samples_that_are_missing_stay_missing():
    own = trace(samples=300)
    own.residual[100:120] = np.nan
    data = json.loads(Traces((own,), "alt").data())
    assert np.isnan(decoded(data["series"][0]["p"], "a")).sum() == 20


def test_sparks_are_small_and_stay_in_their_box():
    drawn = spark(np.random.default_rng(0).standard_normal(100_000))
    numbers = np.array([float(x) for x in drawn.replace("M", " ").replace("L", " ").split()]).reshape(-1, 2)
    assert len(drawn) < 2000
    assert (numbers[:, 0].min() >= 0.0) and (numbers[:, 0].max() <= 100.0)
    assert (numbers[:, 1].min() >= 0.0) and (numbers[:, 1].max() <= 24.0)
    assert spark(np.array([np.nan, 1.0])) == ""
