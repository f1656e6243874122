"""A report is one file: it parses, needs nothing else, escapes what it shows, and works in a browser."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from smsid.errors import SmsidError
from smsid.report import render, write_report

from .conftest import HOSTILE, trace
from .pages import check_page, needs_chromium, run_page


def test_the_page_is_whole_and_needs_nothing_else(report):
    page = check_page(
        render(report), {"verdict", "one", "two", "plot", "rows", "heat", "traces", "provenance"}
    )
    assert "It works." in page.texts["p"]
    assert "smsid identify a.toml" in page.texts["code"]
    assert "ab" * 32 in page.texts["td"]


def test_text_cannot_break_out(report):
    text = render(report)
    assert HOSTILE not in text
    assert '<script>alert("x")' not in text
    page = check_page(text, set())
    assert HOSTILE in page.texts["h1"] and HOSTILE in page.texts["p"]


def test_it_is_written_whole_or_not_at_all(report, tmp_path):
    with pytest.raises(SmsidError, match="does not exist"):
        write_report(report, tmp_path / "none" / "report.html")
    path = write_report(report, tmp_path / "report.html")
    assert path.read_text(encoding="utf-8") == render(report)


@needs_chromium
def test_a_browser_zooms_picks_folds_and_copies_without_errors(report, tmp_path):
    path = write_report(report, tmp_path / "report.html")
    found = run_page(
        path,
        """
        const q = (s) => document.querySelector(s), out = {};
        location.hash = "#two";
        await new Promise((r) => setTimeout(r, 50));
        out.unfolded = q("#two > details").open;
        const plot = q(".traces .plot"), span = () => plot.dataset.span.split(" ").map(Number);
        const lower = document.querySelectorAll(".traces .plot")[1];
        const low = () => lower.querySelector(".line, .thin").getAttribute("d");
        out.full = span(); out.before = low();
        q('[data-do="in"]').click(); out.zoomed = span(); out.after = low();
        plot.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" })); out.moved = span();
        plot.dispatchEvent(new KeyboardEvent("keydown", { key: "0" })); out.all = span();
        const area = plot.querySelector(".area"), box = area.getBoundingClientRect();
        const at = (kind, x) => area.dispatchEvent(new PointerEvent(kind, { clientX: box.left + x * box.width,
          button: 0, pointerId: 1 }));
        area.setPointerCapture = () => {};
        at("pointerdown", 0.25); at("pointermove", 0.4); out.brush = !!q(".brush");
        at("pointermove", 0.5); at("pointerup", 0.5);
        out.dragged = span(); out.gone = !q(".brush");
        q('[data-pick="1"]').click(); out.picked = q(".traces select").value;
        out.row = q("tr.on th").textContent.trim();
        navigator.clipboard.writeText = async (t) => { out.csv = t; };
        q("button.csv").click();
        await new Promise((r) => setTimeout(r, 50));
        out.status = q(".tablepart [role=status]").textContent;
        q(".fold").click();
        out.folded = [...document.querySelectorAll("section > details")].some((d) => d.open);
        out.wide = document.documentElement.scrollWidth <= innerWidth;
        return out;
        """,
        tmp_path,
    )
    assert found["unfolded"]
    assert found["full"] == pytest.approx([0.0, 50.0])
    assert found["zoomed"] == pytest.approx([12.5, 37.5])
    assert found["before"] != found["after"]
    assert found["moved"] == pytest.approx([18.75, 43.75])
    assert found["all"] == pytest.approx([0.0, 50.0])
    assert found["brush"] and found["gone"]
    assert found["dragged"] == pytest.approx([12.5, 25.0], abs=0.1)
    assert (found["picked"], found["row"]) == ("1", "imu y")
    rows = list(csv.reader(io.StringIO(found["csv"])))
    assert rows == [
        ["name", "value"],
        [("long " * 20).strip(), "1.23456789"],
        ['with "quotes", comma', "–"],
    ]
    assert found["status"] == "copied"
    assert not found["folded"]
    assert found["wide"]


@needs_chromium
def test_a_browser_draws_the_samples_at_their_place(report, tmp_path):
    """The residual's spike, which thinning must keep, stands where and as high as it is in the data."""
    path = write_report(report, tmp_path / "report.html")
    found = run_page(
        path,
        """
        document.querySelector("#two > details").open = true;
        dispatchEvent(new Event("resize"));
        const plot = document.querySelectorAll(".traces .plot")[1];
        const paths = [...plot.querySelectorAll("path.thin")].map((p) => p.getAttribute("d"));
        const ticks = [...plot.querySelectorAll(".yticks span")];
        return { paths, ticks: ticks.map((s) => [parseFloat(s.style.bottom), s.textContent]) };
        """,
        tmp_path,
        size="420,800",
    )
    values = {float(label.replace("−", "-")): at / 100.0 for at, label in found["ticks"]}
    slope, start = np.polyfit(list(values), list(values.values()), 1)
    points = np.array(
        [[float(x) for x in p.split()] for p in found["paths"][1][1:].replace("M", "L").split("L")]
    )
    highest = points[np.argmin(points[:, 1])]
    own = trace()
    spike = int(np.argmax(own.residual))
    assert highest[0] / 1000.0 == pytest.approx(own.time[spike] / own.time[-1], abs=5e-3)
    assert (1.0 - highest[1] / 1000.0 - start) / slope == pytest.approx(own.residual[spike], rel=5e-3)
