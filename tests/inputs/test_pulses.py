"""Shares of a sample that valves are open for, as times at which they open and close."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.inputs.pulses import switched

TIMES = np.array([0.0, 0.1, 0.2, 0.3])
SHARES = np.array([[0.0, 1.0], [0.4, 1.0], [1.0, 0.5], [0.25, 0.0]])
OPEN = {
    "begin": [(0.1, 0.14), (0.2, 0.325)],
    "middle": [(0.13, 0.17), (0.2, 0.3), (0.3375, 0.3625)],
    "end": [(0.16, 0.3), (0.375, 0.4)],
}
"""When the first valve is open, as the table above says by hand."""


@pytest.mark.parametrize("pulse", ["begin", "middle", "end"])
def test_a_valve_is_open_where_its_pulses_are(pulse):
    times, states = switched(TIMES, SHARES, [pulse, "spread"])
    at = np.linspace(0.0003, 0.3993, 400)
    held = states[np.searchsorted(times, at, side="right") - 1]
    there = np.any([(low < at) & (at < high) for low, high in OPEN[pulse]], axis=0)
    np.testing.assert_array_equal(held[:, 0], there)
    np.testing.assert_array_equal(held[:, 1], SHARES[np.searchsorted(TIMES, at, side="right") - 1, 1])
    assert np.diff(times).min() > 1e-3 and not states[-1, 0]


@pytest.mark.parametrize("pulse", ["begin", "middle", "end"])
def test_impulses_are_those_of_the_shares_on_any_clock(pulse):
    rng = np.random.default_rng(5)
    times = 1.7e9 + np.cumsum(rng.uniform(0.09, 0.11, 500))
    shares = rng.uniform(0.0, 1.0, (500, 3)) * (rng.uniform(size=(500, 3)) < 0.5)
    shares[100:120] = 1.0
    rows, states = switched(times, shares, [pulse] * 3)
    lengths = np.append(np.diff(times), np.median(np.diff(times)))
    np.testing.assert_allclose(np.diff(rows) @ states[:-1], lengths @ shares, atol=1e-4)
    assert states[(rows >= times[100]) & (rows < times[120])].all(), "what stays open does not shut between"
