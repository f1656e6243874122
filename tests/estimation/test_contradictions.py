"""Whether recordings contradict each other: size under the null, power, parameters told unlike well."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

from smsid.estimation import _confirmed
from smsid.estimation import _contradictions as module
from smsid.estimation._contradictions import (
    Contradiction,
    RecordingInformation,
    contradictions_of,
    contradictions_of_separate,
)
from smsid.likelihood.combinations import Combination

LARGE = np.logspace(0.0, 14.0, 15)  # information on parameters, in that of the prior


def grams(rng):
    """Two recordings' information (15, 15): from nothing to 1e14 times the prior's, in unlike directions."""
    out = []
    for _ in range(2):
        turn = np.linalg.qr(np.eye(15) + 0.3 * np.triu(rng.normal(size=(15, 15)), 1))[0]
        root = np.sqrt(LARGE)[:, None] * turn
        out.append(root.T @ root)
    return out


def parts(rng, apart=0.0):
    """The recordings at their joint optimum, where data scatter as their information says.

    The second was made with another value of what is told best, ``apart`` in standard deviations.
    """
    information = grams(rng)
    both = sum(np.linalg.inv(g + np.eye(15)) for g in information)
    best = int(np.argmin(np.diag(both)))
    lows = [np.linalg.cholesky(g) for g in information]
    slopes = [low @ rng.normal(size=15) for low in lows]
    slopes[1] = slopes[1] + information[1][:, best] * apart * np.sqrt(both[best, best])
    step = np.linalg.solve(sum(information) + np.eye(15), sum(slopes))
    return [
        RecordingInformation(name, g, s - g @ step)
        for name, g, s in zip("ab", information, slopes, strict=True)
    ]


def rows():
    return [Combination(f"p{i}", "1", 1.0, np.eye(15)[i], 1.0) for i in range(15)]


def p_value(found_parts, monkeypatch):
    monkeypatch.setattr(module, "SIGNIFICANCE", 2.1)  # tell every one
    return min(c.p_value for c in contradictions_of(found_parts, np.eye(15), rows()))


@pytest.mark.parametrize(("scaled", "factor"), [(1.0, 1.1), (0.3, None)])
def test_forces_that_are_scaled_are_one_factor_on_all_masses(scaled, factor):
    """The second recording's masses are 1.1 times as large; with ``scaled`` below 1, half of them less so."""
    rng = np.random.default_rng(8)
    values = rng.uniform(1.0, 9.0, 15) * rng.choice([-1.0, 1.0], 15)
    masses = [Combination(f"p{i}", "kg", values[i], np.eye(15)[i], values[i]) for i in range(15)]
    information = [np.diag(rng.uniform(1e4, 1e6, 15)) for _ in range(2)]
    share = np.where(np.arange(15) % 2, scaled, 1.0)
    true = [0.0 * values, 0.1 * share * values]
    slopes = [
        g @ t + np.linalg.cholesky(g) @ rng.normal(size=15) for g, t in zip(information, true, strict=True)
    ]
    step = np.linalg.solve(sum(information) + np.eye(15), sum(slopes))
    both = [
        RecordingInformation(n, g, s - g @ step) for n, g, s in zip("ab", information, slopes, strict=True)
    ]
    # values are those at the joint optimum
    masses = [replace(m, value=m.value + x) for m, x in zip(masses, step, strict=True)]
    found = {c.recording: c for c in contradictions_of(both, np.eye(15), masses)}
    if factor is None:
        assert found["b"].factor is None and "Were they flown" in found["b"].sentence
    else:
        assert found["b"].factor == pytest.approx(factor, abs=0.01)
        assert "command.force" in found["b"].sentence


def test_of_two_that_were_fitted_one_by_one_their_own_values_are_told():
    """Parameters are logarithms: a straight line takes 1.5 for 1 + ln 1.5."""
    size, factor = np.array([16.2, 2250.0]), 1.5
    steps = [np.zeros(2), np.full(2, np.log(factor))]
    own = [
        [
            Combination(n, "kg", v, np.diag(v_all)[i], v)
            for i, (n, v) in enumerate(zip("mM", v_all, strict=True))
        ]
        for v_all in (size * np.exp(step) for step in steps)
    ]
    information = [np.eye(2) * 1e5, np.eye(2) * 1e5]
    found = contradictions_of_separate("ab", information, steps, np.eye(2), own)
    by_name = {n: (a, b) for n, a, b, _ in found[0].parameters}
    assert found[0].recording == "a"
    assert by_name["m"] == (pytest.approx(16.2), pytest.approx(24.3))
    assert found[0].factor == pytest.approx(1.0 / factor, rel=1e-9)


def test_it_is_calibrated_where_parameters_are_told_unlike_well(monkeypatch):
    rng = np.random.default_rng(5)
    found = [p_value(parts(rng), monkeypatch) for _ in range(300)]
    assert kstest(found, "uniform").pvalue > 0.01


def test_a_difference_in_what_is_told_best_is_named():
    rng = np.random.default_rng(6)
    found = contradictions_of(parts(rng, apart=20.0), np.eye(15), rows())
    assert found and found[0].p_value < 1e-6
    assert not contradictions_of(parts(np.random.default_rng(7)), np.eye(15), rows())


def test_a_difference_of_mass_asks_for_the_scale_of_what_drives_as_well():
    apart = ("total.mass", 2257.0, 2458.0, 57.0)
    said = Contradiction("exp1", 1e-9, (apart,)).sentence
    assert "Were they flown with the same spacecraft?" in said
    assert "'command.force'" in said and "'wheel_rate'" in said and "0.918" in said
    other = Contradiction("exp1", 1e-9, (("link3.mx", 50.0, 60.0, 9.0),)).sentence
    assert "scaled" not in other


class Apart:
    """Two recordings that tell three parameters as well, of optima that are apart, and what is seen of it."""

    def __init__(self, apart: np.ndarray, bound: int = -1, seen: float = 1.0) -> None:
        self.gram, self.optima, self.seen = 1e4 * np.eye(3), {"a": apart, "b": -apart}, seen
        self.scales = np.ones(3)
        self.unknowns = [
            SimpleNamespace(sigma=1.0, lower=0.0 if i == bound else -np.inf, upper=np.inf) for i in range(3)
        ]
        self.point = SimpleNamespace(value=lambda u: 0.0)
        self.recordings = [
            SimpleNamespace(label=k, gram=self.gram, slope=self.gram @ x) for k, x in self.optima.items()
        ]
        self.rows = [Combination(f"p{i}", "1", 0.0, row, 0.0) for i, row in enumerate(np.eye(3))]

    def objective(self, moved: object, _: object, flights: list[SimpleNamespace]) -> float:
        x = np.zeros(3) if moved is self.point else np.asarray(moved)
        off = [x - self.optima[f.label] for f in flights]
        return self.seen * sum(0.5 * float(d @ self.gram @ d) for d in off)

    def confirmed(self, monkeypatch, widening: float = 1.0) -> list[str]:
        monkeypatch.setattr(_confirmed, "objective_of", self.objective)
        monkeypatch.setattr(_confirmed, "retract", lambda point, unknowns, step: step)
        flights: Any = [SimpleNamespace(label=k) for k in self.optima]
        found: Any = self
        claims = module.contradictions(found, self.rows)
        return [c.recording for c in _confirmed.confirmed(claims, found, flights, widening)]


def test_what_the_likelihood_sees_of_a_difference_is_a_contradiction(monkeypatch):
    assert set(Apart(np.array([0.05, 0.0, 0.0])).confirmed(monkeypatch)) == {"a", "b"}
    assert Apart(np.array([0.005, 0.0, 0.0])).confirmed(monkeypatch) == []  # half a standard deviation


def test_what_normal_equations_alone_promise_is_none(monkeypatch):
    assert Apart(np.array([0.05, 0.0, 0.0]), seen=0.01).confirmed(monkeypatch) == []
    assert Apart(np.array([0.05, 0.0, 0.0]), seen=-1.0).confirmed(monkeypatch) == []
    # a small share of much is more than chance
    much = Apart(np.array([5.0, 0.0, 0.0]), seen=0.01)
    assert set(much.confirmed(monkeypatch)) == {"a", "b"}
    assert much.confirmed(monkeypatch, widening=30.0) == []  # in noise as it is, it is chance


def test_where_all_is_at_a_bound_nothing_contradicts(monkeypatch):
    all_bound = Apart(np.array([0.05, 0.0, 0.0]), bound=0)
    all_bound.unknowns = [SimpleNamespace(sigma=1.0, lower=0.0, upper=np.inf)] * 3
    assert all_bound.confirmed(monkeypatch) == []


def test_beyond_a_bound_nothing_contradicts(monkeypatch):
    assert Apart(np.array([0.05, 0.0, 0.0]), bound=0).confirmed(monkeypatch) == []
    assert set(Apart(np.array([0.05, 0.05, 0.0]), bound=0).confirmed(monkeypatch)) == {"a", "b"}
