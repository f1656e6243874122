"""A filter is held against the most likely parameters of the samples it began with."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from smsid.tracking import track_recordings
from smsid.tracking._fit_watch import FitWatch
from smsid.tracking._warm_up import WarmStart
from tests.tracking.craft import INERTIA, craft, flight

M = 12
INDEX = np.arange(1, M + 1)


def held_against(
    values: np.ndarray, covariance: np.ndarray, wide: float = 1.0, rates: float = 0.0, of: int = -1
) -> float:
    """Disagreement of a filter that has these values from a maximum at zero, known ``wide`` times as well."""
    whole = np.eye(M + 2)
    whole[1:-1, 1:-1] = covariance
    size = np.sqrt(np.diag(whole))
    followed = [SimpleNamespace(of=of if i == M + 1 else -1, rate=rates * s) for i, s in enumerate(size)]
    found: Any = SimpleNamespace(
        values=np.concatenate([[7.0], values, [7.0]]), parameter_covariance=lambda: whole, followed=followed
    )
    return WarmStart(INDEX, np.zeros(M), wide**2 * covariance, 9.0, 9.0).disagreement(found)


@pytest.fixture
def covariance():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(M, M)) * 10.0 ** rng.uniform(-8.0, 8.0, M)[:, None]
    return root @ root.T


def test_chance_widens_nothing(covariance):
    """A filter that is as good as the maximum, or better, is hardly ever said to be apart from it."""
    root, rng = np.linalg.cholesky(covariance), np.random.default_rng(4)
    found = [
        held_against(root @ rng.normal(size=M), covariance, wide) for wide in (1.0, 1.5) for _ in range(500)
    ]
    assert np.sum(np.array(found) > 1.0) <= 2


def test_a_filter_that_is_pulled_gets_bands_that_hold(covariance):
    root, rng = np.linalg.cholesky(covariance), np.random.default_rng(5)
    draws = [6.0 * root @ rng.normal(size=M) for _ in range(200)]
    found = np.array([held_against(x, covariance) for x in draws])
    assert np.sqrt(np.mean(found**2)) == pytest.approx(6.5, rel=0.15)
    off = np.abs(draws) / np.sqrt(np.diag(covariance)) / found[:, None]
    assert off.max() < 1.96 + 1e-9


def test_what_may_have_wandered_or_has_a_trend_is_not_asked(covariance):
    pulled = 6.0 * np.linalg.cholesky(covariance) @ np.ones(M)
    assert held_against(pulled, covariance) > 3.0
    assert held_against(pulled, covariance, rates=10.0) == 1.0
    one = np.zeros(M)
    one[4] = 20.0 * np.sqrt(covariance[4, 4])
    assert held_against(one, covariance) > 1.0
    assert held_against(one, covariance, of=5) == 1.0


def test_one_parameter_that_is_pulled_is_within_its_band(covariance):
    one = np.zeros(M)
    one[4] = 20.0 * np.sqrt(covariance[4, 4])
    assert held_against(one, covariance) * 1.96 >= 20.0 * (1.0 - 1e-9)


def test_where_all_have_trends_nothing_is_asked():
    followed = [SimpleNamespace(of=-1, rate=0.0), SimpleNamespace(of=0, rate=0.0)]
    found: Any = SimpleNamespace(
        values=np.array([9.0, 0.0]), parameter_covariance=lambda: np.eye(2), followed=followed
    )
    assert WarmStart(np.array([0]), np.zeros(1), np.eye(1), 9.0, 9.0).disagreement(found) == 1.0


def test_bands_are_widened_by_both_and_a_sentence_says_why():
    watch = FitWatch(misfit=2.0, component="gyro[x]", apart=3.0, seconds=80.0)
    assert watch.widening == 6.0
    assert not watch.explained
    assert "gyro[x] is left at 2 times its noise" in watch.sentence
    assert "After 80 s the filter was 3 of its standard deviations from" in watch.sentence
    alone = FitWatch(apart=3.0, seconds=80.0)
    assert alone.explained and alone.widening == 3.0 and alone.sentence.startswith("After 80 s")
    assert FitWatch().sentence == ""


@pytest.mark.parametrize("pull", [0.0, 0.1], ids=["right", "pulled"])
def test_a_tracker_is_held_against_its_warm_up(pull, tmp_path, monkeypatch):
    """Once, where that ends; a maximum that is elsewhere stands for a filter that is."""
    held, asked = WarmStart.disagreement, []

    def elsewhere(self: WarmStart, f: Any) -> float:
        asked.append(f.time)
        return held(replace(self, values=self.values + pull * np.arange(1.0, 1.0 + len(self.values))), f)

    monkeypatch.setattr(WarmStart, "disagreement", elsewhere)
    described, recording = craft(tmp_path), flight(30.0)
    history, _ = track_recordings(described, [recording], follow=dict.fromkeys(INERTIA, 0.0), warm_up=20.0)
    assert asked == [pytest.approx(20.0, abs=0.2)]
    said = any("standard deviations from the most likely parameters" in n for n in history.notes)
    assert said == bool(pull)
    widening = history.conditions["widening"]
    assert (widening > 1.0) == bool(pull)
    size = np.sqrt(np.diag(history.covariance))
    assert np.allclose(history.sigmas[-1], size)  # all rows are as wide, those before it was seen as well
