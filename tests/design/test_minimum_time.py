"""The shortest duration, where standard deviations follow a known law."""

from __future__ import annotations

import pytest

from smsid.design._minimum_time import Watch, minimum_time_design
from smsid.errors import ExperimentError


def law(power: float, at_100: float):
    calls: list[float] = []

    def search(duration: float) -> tuple[float, float]:
        calls.append(duration)
        return at_100 * (duration / 100.0) ** -power, duration

    return search, calls


@pytest.mark.parametrize("power", [0.5, 1.5, 3.0])
@pytest.mark.parametrize("at_100", [0.02, 0.1, 0.7])
def test_it_is_found_to_one_per_cent(power: float, at_100: float):
    search, calls = law(power, at_100)
    found = minimum_time_design(search, 0.1, 120.0, 1e5, lambda t: round(t, 2), Watch())
    exact = 100.0 * (at_100 / 0.1) ** (1.0 / power)
    assert exact <= found * (1 + 1e-6)
    # half a per cent of the precision is kept in hand
    assert found <= 1.012 * exact * (1 / 0.995) ** (1.0 / power)
    assert len(calls) <= 10


def test_out_of_reach_is_told():
    search, _ = law(1.5, 1.0)
    with pytest.raises(ExperimentError, match="10 % is out of reach within 200 s: the best found gives 35"):
        minimum_time_design(search, 0.1, 120.0, 200.0, lambda t: round(t, 2), Watch())


def test_an_interrupt_ends_it_with_what_there_is():
    search, calls = law(1.5, 1.0)
    watch: Watch[float] = Watch()
    watch.interrupted = True
    assert minimum_time_design(search, 0.1, 120.0, 1e5, lambda t: t, watch) == 120.0
    assert calls == [120.0]
