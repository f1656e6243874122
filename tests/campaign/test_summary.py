"""The summary's statistics against numpy and scipy on synthetic data."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from scipy import stats

from smsid.campaign import Findings, Outcome, RunError, RunRecord, save_summary, summarise
from smsid.campaign.summary import coverage_band, ratio_band
from smsid.cli.campaign import summary_parts

RUNS = 400


def synthetic(seed: int = 1, shrink: float = 1.0) -> tuple[list[RunRecord], dict[str, np.ndarray]]:
    """Runs of two parameters and a figure without truth; ``shrink`` makes the predicted sigma too small."""
    rng = np.random.default_rng(seed)
    truth = 50.0 + rng.normal(size=RUNS)
    value = truth + 0.1 + rng.normal(size=RUNS)
    other = 3.0 + 0.2 * rng.normal(size=RUNS)
    time = rng.normal(size=RUNS)
    records = []
    for k in range(RUNS):
        outcomes = (
            Outcome(name="a", value=value[k], unit="kg", truth=truth[k], sigma=shrink, status="identifiable"),
            Outcome(
                name="b", value=other[k], truth=3.0, sigma=0.2, interval=(other[k] - 0.1, other[k] + 0.1)
            ),
            Outcome(name="settling", value=time[k], unit="s"),
        )
        records.append(RunRecord(run=k, status="ok", outcomes=outcomes, seconds=0.5))
    return records, {"truth": truth, "value": value, "other": other, "time": time}


def test_statistics_are_numpys() -> None:
    records, x = synthetic()
    summary = summarise(records)
    a, error = summary["a"], x["value"] - x["truth"]
    assert a.truth == pytest.approx(x["truth"].mean(), rel=1e-14)
    assert a.truth_spread == pytest.approx(x["truth"].std(ddof=1), rel=1e-12)
    assert a.mean_error == pytest.approx(error.mean(), rel=1e-12)
    assert a.spread == pytest.approx(error.std(ddof=1), rel=1e-12)
    assert a.bias == pytest.approx(error.mean() / error.std(ddof=1), rel=1e-12)
    assert a.mean_sigma == 1.0
    assert a.ratio == a.spread
    assert a.covered == int((np.abs(error) <= 1.959964).sum())
    assert a.identifiable == RUNS
    assert summary.seconds == 0.5 * RUNS
    b = summary["b"]
    assert b.covered == int((np.abs(x["other"] - 3.0) <= 0.1).sum()), "a method's own interval counts"
    assert b.coverage_holds is False
    free = summary["settling"]
    assert free.spread == pytest.approx(x["time"].std(ddof=1), rel=1e-12)
    assert (free.truth, free.mean_error, free.coverage, free.ratio, free.coverage_holds) == (None,) * 5
    assert [p.name for p in summary.parameters] == ["a", "b", "settling"]


def test_bands_are_shared_out_among_the_parameters() -> None:
    records, _ = synthetic()
    a = summarise(records, level=0.02)["a"]
    low, high = stats.binom.ppf([0.005, 0.995], RUNS, 0.95) / RUNS
    assert a.coverage_band == (low, high)
    scale = np.sqrt(stats.chi2.ppf([0.005, 0.995], RUNS - 1) / (RUNS - 1))
    assert a.ratio_band == pytest.approx(tuple(scale), rel=1e-12)


@pytest.mark.parametrize("runs", [20, 400])
@pytest.mark.parametrize("level", [0.01, 0.1])
def test_bands_hold_as_often_as_they_say(runs: int, level: float) -> None:
    low, high = coverage_band(runs, level)
    k = np.arange(runs + 1)
    inside = (k / runs >= low) & (k / runs <= high)
    assert stats.binom.pmf(k[inside], runs, 0.95).sum() >= 1 - level
    rng = np.random.default_rng(5)
    low, high = ratio_band(runs, level)
    spread = rng.normal(size=(4000, runs)).std(axis=1, ddof=1)
    left = np.mean((spread < low) | (spread > high))
    assert left == pytest.approx(level, abs=4 * math.sqrt(level / 4000))


def test_wrong_sigmas_are_seen() -> None:
    a = summarise(synthetic(shrink=0.7)[0])["a"]
    assert a.coverage_holds is False
    assert a.ratio_holds is False
    a = summarise(synthetic()[0])["a"]
    assert a.ratio_holds is True


def test_order_of_the_runs_does_not_show() -> None:
    records, _ = synthetic()
    shuffled = [records[i] for i in np.random.default_rng(0).permutation(RUNS)]
    assert summarise(records).to_json() == summarise(shuffled).to_json()


def test_missing_not_finite_and_failed_are_counted_apart(tmp_path: Path) -> None:
    def record(run: int, *outcomes: Outcome) -> RunRecord:
        return RunRecord(run=run, status="ok", outcomes=outcomes)

    inf, nan = math.inf, math.nan
    records = [
        record(0, Outcome(name="a", value=1.0, truth=1.0, sigma=0.1)),
        record(1, Outcome(name="a", value=1.1, truth=1.0, sigma=inf)),
        record(2, Outcome(name="a", value=nan, truth=1.0, sigma=0.1)),
        record(3),
        RunRecord(run=4, status="failed", error=RunError(type="E", message="later")),
        RunRecord(run=5, status="failed", error=RunError(type="E", message="first")),
    ]
    summary = summarise(reversed(records))
    a = summary["a"]
    assert (a.runs, a.not_finite, a.missing, a.covered) == (1, 2, 1, 1)
    assert (a.spread, a.ratio) == (None, None)
    assert (summary.runs, summary.failed) == (6, 2)
    assert (summary.failures[0].run, summary.failures[0].message) == (4, "later")
    save_summary(summary, tmp_path / "s.json")
    document = json.loads((tmp_path / "s.json").read_text())
    assert document["parameters"][0]["coverage_holds"] is True
    assert document["failures"][0]["count"] == 2


def test_one_name_in_two_steps_is_two_parameters() -> None:
    outcomes = tuple(
        Outcome(name="m", value=v, truth=0.0, sigma=1.0, group=g) for v, g in ((1.0, "a"), (2.0, "b"))
    )
    found = Findings(outcomes=outcomes)
    summary = summarise([RunRecord(run=0, status="ok", outcomes=found.outcomes)])
    assert [(p.group, p.mean) for p in summary.parameters] == [("a", 1.0), ("b", 2.0)]


def test_table_fits_a_terminal_of_80_columns_and_says_what_is_outside() -> None:
    records, _ = synthetic(shrink=0.7)
    records.append(RunRecord(run=RUNS, status="failed", error=RunError(type="E", message="[bold]no[/bold]")))
    console = Console(width=80, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    for part in summary_parts(summarise(records), everything=True):
        console.print(part)
    text = console.export_text()
    assert "[bold]no[/bold]" in text
    assert "…" not in text
    assert re.search(r"coverage +runs\s", text)
    assert re.search(r"a +kg .* 400\s", text)
    assert re.search(r"settling +s ", text)
    assert summarise([]).parameters == ()
