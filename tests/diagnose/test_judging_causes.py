"""Causes judged beside each other at the end of a round: merged, exchanged, and what is asked again."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from smsid.diagnose import _forward_step as rounds
from smsid.diagnose._forward_step import SearchState
from smsid.diagnose.model_comparison import Cause

from .search_stubs import FOUND, OTHER, VAIN, candidate, score_of


@pytest.mark.parametrize(
    ("misfit", "unknown", "told"), [(False, "", True), (True, "", False), (False, "panel", False)]
)
def test_rivals_take_a_place_only_where_all_they_do_is_seen(world, monkeypatch, misfit, unknown, told):
    """A motor's gain is no better than its tachometer's scale because what it gives the bus is hidden."""
    state, _ = world
    state.forward_step(), state.forward_step()
    calls = []

    def exchange_step(causes, last, *_, exchange, **__):
        calls.append(exchange)
        return causes, last

    def merge_step(causes, last, *_):
        merged.append(last)
        return causes, last

    merged = []
    monkeypatch.setattr(rounds, "exchange_step", exchange_step)
    monkeypatch.setattr(rounds, "merge_step", merge_step)
    state._finer, state.fitted = True, replace(state.fitted, misfit=misfit, unknown=unknown)
    state.close()
    assert calls == [told] and bool(merged) is told
    assert not state._recheck, "none has given way"


def test_what_was_chosen_beside_a_cause_that_gives_way_is_rechecked(world, monkeypatch):
    state, _ = world
    state.forward_step(), state.forward_step()
    early, gone, late, rival = (
        Cause(
            SimpleNamespace(candidate=SimpleNamespace(key=k, location=k[1], start=None, effect=None)),
            (),
            50.0,
        )
        for k in ((f"kind{i}", "somewhere", "shape") for i in range(4))
    )
    state.causes, state._finer = [early, gone, late], True
    monkeypatch.setattr(SearchState, "_there_always", lambda self: None)
    monkeypatch.setattr(rounds, "with_further", lambda *_: None)
    for found, recheck in (
        ([early, gone, late], set()),
        ([early, rival, late], {late.score.candidate.key}),
        ([early, rival, late], {late.score.candidate.key}),  # also when all are judged once more
    ):
        monkeypatch.setattr(rounds, "exchange_step", lambda causes, last, *_, to=found, **__: (to, last))
        state.close()
        assert state._recheck == recheck
    asked = []

    def eliminate_backward(causes, last, *more):
        asked.append(set(more[-1]))
        return causes, last

    monkeypatch.setattr(rounds, "eliminate_backward", eliminate_backward)
    assert not state.prune() and not state.prune()
    assert asked == [{late.score.candidate.key}, set()], "it is missed, once that is known"


@pytest.mark.parametrize(("finer", "judged"), [(True, [True]), (False, [])])
def test_the_only_cause_is_judged_again_where_the_noise_is_finer(world, monkeypatch, finer, judged):
    state, asked = world
    asked.finer = finer
    calls = []

    def exchange_step(causes, last, nominal, candidates, levels, *, exchange, last_too, settled):
        calls.append(last_too and exchange)
        return list(causes), last

    monkeypatch.setattr(rounds, "exchange_step", exchange_step)
    state.close()
    assert calls == []  # no cause yet
    state.forward_step()
    state.forward_step()
    state.close()
    assert calls == judged


def test_after_an_exchange_scores_are_those_of_the_causes_that_are_left(world, monkeypatch):
    state, asked = world
    state.forward_step()
    state.forward_step()

    def exchange_step(causes, *_, **__):
        (other,) = (s for s in state.scores if s.candidate.key == OTHER)
        return [replace(causes[0], score=other)], asked.at("exchanged")

    monkeypatch.setattr(rounds, "exchange_step", exchange_step)
    state.close()
    assert {s.candidate.key for s in state.scores} == {FOUND, VAIN}
    assert asked.scored[-1][0] == "exchanged"


def test_a_cause_is_all_it_can_be_before_a_rival_is_told_from_it(world, monkeypatch):
    """Coulomb friction whose sign turns within 4 mrad/s was a Stribeck curve: its width was not asked."""
    state, asked = world
    state.causes = [Cause(score_of(candidate(key)), (), 30.0) for key in (FOUND, OTHER)]
    state.fitted, state._finer = replace(state.fitted, misfit=False), True
    steps = []

    def further(current, causes):
        steps.append(("further", current.name))
        return asked.at("with its width") if current.name != "with its width" else None

    def exchange(causes, current, *_, **__):
        steps.append(("exchange", current.name))
        return list(causes), current

    monkeypatch.setattr(rounds, "with_further", further)
    monkeypatch.setattr(rounds, "exchange_step", exchange)
    state.close()
    assert steps[-1] == ("exchange", "with its width") and steps[-2][0] == "further"
    assert state.current.name == "with its width"
