"""Intervals of poorly known strengths: where the likelihood has fallen, all else fitted again."""

from dataclasses import replace

import numpy as np
import pytest

from smsid._statistics import NORMAL95
from smsid.diagnose import _profile_intervals as profile_module
from smsid.diagnose._profile_intervals import profile_intervals
from smsid.diagnose.model_comparison import unfitted_parameters
from smsid.diagnose.result import Value
from smsid.effects import Payload
from smsid.estimation.likelihood_profile import BetterMaximum
from smsid.estimation.map_estimate import fit
from tests.diagnose.test_exchange_step import paired, with_causes

NAME = "payload_tool.mass"


@pytest.fixture(scope="module")
def loaded(description, known):
    """A small payload far from the tool's frame, its place free: its mass times a distance is told."""
    truth = Payload(kind="payload", name="load", frame="tool", mass=0.6, com=(0.1, 0.3, -0.2))
    nominal, candidates = paired(known, description.with_effects(truth), ("payload",))
    causes, current = with_causes(nominal, candidates, [("payload", "tool", "payload")])
    return causes, current


def test_what_is_gaussian_stays_as_it_is(loaded):
    causes, current = loaded
    found, ends = profile_intervals(current, causes)
    assert found is current and ends == {}


def test_the_likelihood_has_fallen_at_the_ends(loaded):
    """Its place free, too: each end is where the best of all else is less likely by 1.92."""
    causes, current = loaded
    more = unfitted_parameters(current, causes[0].score.candidate)
    free = fit(current.point, [*current.unknowns, *more], current.problem)
    found, ends = profile_intervals(free, causes)
    others = [u for u in found.unknowns if u.name != NAME]
    low, high = ends[NAME]
    value = found.point.value(next(u for u in found.unknowns if u.name == NAME))
    assert low < 0.1 * value and high > 2.0 * value  # a Gaussian would go below zero
    for end in (low, high):
        effect = found.point.description.get_effect("payload_tool")
        start = found.point.with_effect(effect.model_copy(update={"mass": end}))
        best = fit(start, others, found.problem, iterations=30, enough=0.002)
        assert best.objective - found.objective == pytest.approx(0.5 * NORMAL95**2, rel=0.1)


def test_of_a_top_that_is_not_reached_no_end_is_claimed(loaded, monkeypatch):
    causes, current = loaded

    def never(found, *_, **__):
        raise BetterMaximum(found.point)

    monkeypatch.setattr(profile_module, "bent_intervals", never)
    _, ends = profile_intervals(current, causes)
    assert ends[NAME][1] == np.inf and ends[NAME][0] <= 0.0


def test_an_interval_of_a_profile_is_told_as_it_is():
    value = Value("load.mass", 0.5, 0.36, "kg", profile=(0.02, 1.31))
    assert value.interval == (0.02, 1.31) and value.spread == "(0.02 to 1.31)"
    assert replace(value, profile=None).spread == "+- 0.71"
