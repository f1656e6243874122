"""The rounds of a search: what is done anew when the noise turns out to be finer than it was taken for."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose import _cause_in_motion as cause_in_motion
from smsid.diagnose import _forward_step as rounds
from smsid.diagnose import stepwise
from smsid.diagnose._forward_step import SearchState
from smsid.diagnose._noise_covariance import InflatedFit
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.specification_tests import SpecificationTest
from smsid.diagnose.thresholds import THRESHOLDS, DetectionThresholds
from smsid.errors import SmsidError
from smsid.estimation.innovations import squared_distance

from .search_stubs import FOUND, OTHER, VAIN, Whole, candidate, score_of


def test_where_misfit_is_counted_what_takes_most_of_the_errors_away_comes_first(world):
    """Noise raised to a gyro's misfit bounds the odds of its bias; those of a panel's mode are larger."""
    state, asked = world
    asked.takes = {OTHER: 1e9}
    state._score_anew()
    state.forward_step()
    assert asked.accepted == [OTHER]
    state, asked.accepted = (
        SearchState(replace(state.fitted, misfit=False), state.candidates, state.levels),
        [],
    )
    state.forward_step()
    assert asked.accepted == [VAIN]  # the one of largest odds


@pytest.mark.parametrize(
    ("share", "misfit", "asked_for"), [(0.6, True, [OTHER]), (0.4, True, []), (0.6, False, [])]
)
def test_what_counts_for_nothing_in_raised_noise_but_takes_most_of_the_errors_is_tried(
    world, share, misfit, asked_for
):
    """A gyro's bias of 1.5 mrad/s, alone off in noise as large as itself: nothing was asked at all."""
    state, asked = world
    asked.chances = dict.fromkeys((FOUND, OTHER, VAIN), 1.0)
    asked.takes = {OTHER: share * 400.0 * 50.0}  # 50 errors of twice their level, which is 10 times the noise
    state.fitted.fit.run.innovations = state.fitted.fit.residual = np.full((50, 1), 2.0)
    state.fitted = replace(state.fitted, misfit=misfit, factors=np.array([10.0]))
    state._score_anew()
    state.forward_step()
    assert asked.accepted == asked_for


def test_with_finer_noise_a_cause_is_weighed_and_all_is_scored_and_tried_anew(world):
    state, asked = world
    assert state.forward_step() and not state.causes  # in vain
    assert {s.candidate.key for s in state.scores} == {FOUND, OTHER}
    assert state.forward_step()
    assert [c.score.candidate.key for c in state.causes] == [FOUND]
    assert asked.recompute_evidence == ["with found"] and state.causes[0].ratio == 1e6
    assert asked.stepped == ["with found"]  # weak as it seemed, it is strong
    assert asked.scored[-1] == ("with found", {OTHER: "with found", VAIN: "with found"})


def test_while_misfit_is_counted_nothing_is_weighed_and_what_was_in_vain_stays_out(world):
    state, asked = world
    asked.finer = False
    assert state.forward_step() and state.forward_step()
    assert asked.recompute_evidence == [] and asked.stepped == [] and state.causes[0].ratio == 30.0
    assert asked.scored[-1] == ("with found", {OTHER: "with found"})


@pytest.mark.parametrize(("misfit", "looked_at"), [(True, True), (False, False)])
def test_a_ratio_of_other_noise_hides_nothing_while_misfit_is_counted(world, misfit, looked_at):
    """A gyro's bias gained 1e7 with the panel unknown; beside the misfit its softening gains 300."""
    state, asked = world
    state.fitted = replace(state.fitted, misfit=misfit)
    state.causes = [Cause(score_of(candidate(("sensor_bias", "imu", "bias"))), (), 1e7)]
    state.forward_step()
    assert bool(asked.accepted) is looked_at
    assert state._asked.beside == (0.0 if misfit else THRESHOLDS.beside)


@pytest.mark.parametrize(
    ("chance", "excited", "again"), [(0.4, 0.5, False), (1e-3, 0.5, True), (0.4, 1e-5, True)]
)
def test_beside_a_cause_what_explains_nothing_keeps_its_signature(world, chance, excited, again):
    """It is taken again where that of the motion before explains something, or where what is left of it
    beside the nominal parameters is no more than what the motion changed (a payload beside a link's mass).
    """
    _, asked = world
    state = SearchState(
        InflatedFit(asked.at("nominal"), np.ones(1)),
        [candidate(k) for k in (FOUND, OTHER)],
        DetectionThresholds(),
    )
    asked.chances, asked.excited, asked.moved = {OTHER: chance}, excited, 1e-6
    assert state.forward_step() and len(state.causes) == 1
    assert {s.candidate.key for s in state.scores} == {OTHER}
    assert asked.scored[-1] == ("with found", {OTHER: "with found"} if again else {})


@pytest.mark.parametrize("finer", [True, False])
def test_a_better_fit_may_show_the_noise_as_well(world, finer):
    """Not only a cause does."""
    state, asked = world
    asked.finer = False
    state.forward_step()  # in vain
    state.forward_step()
    asked.finer, asked.instead = finer, asked.at("better", objective=-1e4)
    state.causes[0] = replace(state.causes[0], ratio=1.0)
    state._out.clear()
    state._score_anew()
    assert state.forward_step() and state.current.name == "better"
    assert asked.recompute_evidence == (["better"] if finer else [])
    assert asked.scored[-1] == ("better", {OTHER: "better", VAIN: "better"})


def test_beside_an_unknown_structure_causes_elsewhere_are_sought_and_stay(world, monkeypatch):
    """Where it is back, misfit is counted again, and they are neither exchanged nor left out."""
    state, asked = world
    assert state.forward_step() and state.forward_step()
    here = replace(state.fitted, unknown="other")
    here.fit.unknowns, here.fit.problem = (), Whole(SimpleNamespace(rows=1), "loud")
    state.nominal.unknowns, state.fitted = (), here
    push = candidate(("effect", "bus", "shape"), "external")
    state.candidates = (*state.candidates, push)
    state._score_anew()
    assert set(asked.scored[-1][1]) == {VAIN}  # nothing at the structure, or like it on the bus

    asked.misfit = True

    def fitted_again(fitted, problem, known, own):
        found, asked.own = asked.at(problem.noise), own
        found.problem = problem
        return InflatedFit(found, np.ones(1), misfit=asked.misfit, local=False)

    for name, stub in {
        "with_structure_again": fitted_again,
        "evaluate": lambda *_: asked.at("nominal again"),
    }.items():
        monkeypatch.setattr(rounds, name, stub)
    state.candidates = state.candidates[:-1]
    whole = Whole(SimpleNamespace(rows=1), "as stated")
    state.current.problem = whole
    assert state.restore(whole)
    assert asked.own == {"found.size"}
    assert (state.current.name, state.nominal.name) == ("as stated", "nominal again")
    assert state.fitted.misfit and not state.fitted.local and not state.fitted.unknown
    assert set(asked.scored[-1][1]) == {OTHER, VAIN}
    assert "as stated" not in asked.recompute_evidence  # misfit is counted, which other ratios are of
    kept = []

    def judged(causes, *_, settled=(), **__):
        kept.append(set(settled))
        return list(causes), state.current

    def left_out(causes, last, nominal, levels, tried, proven, recheck):
        kept.append(set(proven))
        return list(causes), last

    monkeypatch.setattr(rounds, "exchange_step", judged)
    monkeypatch.setattr(rounds, "eliminate_backward", left_out)
    state._finer = True
    state.close()
    assert not state.prune()
    assert kept == [{FOUND}, {FOUND}]
    # where all is followed with it back, nothing hides them: a gyro's bias of 0.7 +- 0.3 urad/s stayed; and
    # what is left beside a friction's 18 million, not its 30 thousand, may be its law's
    asked.misfit, state.nominal.unknowns = False, ()
    assert state.restore(whole)
    assert asked.recompute_evidence[-1] == "as stated" and state.causes[0].ratio == 1e6
    state.close()
    assert not state.prune()
    assert kept[2:] == [set(), set()]


def test_a_step_that_fails_is_undone_and_its_signatures_are_not_used_again(world):
    """They are those of the fit that the step went to."""
    state, _ = world
    fitted, scores = state.fitted, state.scores

    def step():
        state.causes.append("another")
        state.fitted = state.scores = None
        raise SmsidError("The step is lost.")

    assert state._scoring.columns and not state.guarded("a step", step)
    assert state.fitted is fitted and state.scores is scores and state.causes == []
    assert not state._scoring.columns
    assert state.failed == ["a step failed numerically and was left out: The step is lost."]


def test_causes_that_share_an_effect_begin_together(known, plain):
    """One that is found as a part of another's effect has its start, wherever that goes."""
    state = SearchState.__new__(SearchState)
    state.nominal = plain
    tried = propose(plain.point, plain.problem, known.unknowns)
    by_shape = {c.shape: c for c in tried if c.location == "joint2"}
    first, second = by_shape["coulomb"], by_shape["stribeck"]
    begun = replace(first, effect=first.effect.model_copy(update={"start": 3.0}))
    causes = [Cause(score_of(c), (), 30.0) for c in (begun, second)]
    for start in (3.0, 2.5, None):
        found = replace(
            plain, point=plain.point.with_effect(first.effect.model_copy(update={"start": start}))
        )
        one, two = (c.score.candidate for c in state._with_fitted_onsets(causes, found))
        assert one.effect.start == two.effect.start == start
        assert two.holds(one)
    state.nominal = found = replace(
        plain, point=plain.point.with_effect(first.effect.model_copy(update={"start": 20.0}))
    )
    assert state._with_fitted_onsets(causes[1:], found)[0].score.candidate.effect.start is None


def test_how_far_two_motions_are_apart():
    """By the coordinate that moved most for its size; others of a model with more coordinates are all new."""
    one = np.array([[1.0, 10.0, 0.0], [-1.0, -10.0, 0.0]])
    run, moved, larger = (
        SimpleNamespace(states=SimpleNamespace(a=a)) for a in (one, one * [1.1, 1.01, 1.0], np.zeros((2, 4)))
    )
    assert squared_distance(run, moved) == pytest.approx(0.01)
    assert squared_distance(run, run) == 0.0 and squared_distance(run, larger) == 1.0


@pytest.mark.parametrize(
    ("location", "open_", "errs"), [("joint2", True, True), ("joint1", True, False), ("joint2", False, False)]
)
def test_a_law_errs_where_tests_say_that_it_is_not_all(world, monkeypatch, location, open_, errs):
    state, _ = world
    rubs = candidate(("joint_friction", "joint2", "stribeck"))
    state.causes = [Cause(score_of(rubs), (), 1e7)]
    monkeypatch.setattr(rounds, "may_be_open", lambda own, problem: open_)
    plainer = Cause(score_of(candidate(("joint_friction", "joint2", "coulomb"))), (), 1e6)
    erring = SimpleNamespace(name="joint2")
    monkeypatch.setattr(rounds, "with_errors_of_shape", lambda found, own, candidates: (erring, (plainer,)))
    left = [SimpleNamespace(location=location)]
    assert state.let_law_err(left) is errs
    assert (state.current is erring) is errs and (state.causes == [plainer]) is errs


def test_what_may_be_the_shape_of_a_listed_law_is_no_cause_there(world):
    state, _ = world
    first = state._leading_scores()[0].candidate
    state.nominal.unknowns = ()
    state.least_listed = {(first.location, first.family): 1e6}
    leading = state._leading_scores()
    assert leading and leading[0].candidate is not first
    asked = [(first.location, "rate"), (first.location, "acceleration"), ("elsewhere", "rate")]
    left = [SpecificationTest(f"torque of {p}", on, 900.0, 4, location=p) for p, on in asked]
    told = stepwise._significant(left, (), state.levels, frozenset(), state.least_listed)
    assert [(t.location, t.dependence) for t in told] == asked[1:], "a sign's shape is of rate and load"
    state.least_listed = {(first.location, "actuator"): 1e6}
    assert state._leading_scores()[0].candidate is first


@pytest.mark.parametrize(
    ("location", "objective", "further", "moves"),
    [
        ("joint2", -20.0, 1, True),
        ("joint1", -20.0, 1, False),  # nothing is left there
        ("joint2", -2.0, 1, False),  # ln(100) is asked of a parameter
        ("joint2", -2.0, 0, True),
        ("joint2", None, 0, False),  # it has no motion of its own
    ],
)
def test_a_cause_moves_where_tests_say_that_it_does_not_follow(
    world, monkeypatch, location, objective, further, moves
):
    state, _ = world
    gives = candidate(("gear_compliance", "joint2", "compliance"))
    gives.effect = SimpleNamespace(name="gear")
    state.causes = [Cause(score_of(gives), (), 1e7)]
    last = state.current
    last.unknowns = ("mass", "compliance")
    swings = SimpleNamespace(
        name="swings", objective=objective, unknowns=(*last.unknowns, *["damping"] * further), problem="short"
    )
    monkeypatch.setattr(
        cause_in_motion, "with_dynamics", lambda found, own: found if objective is None else swings
    )
    monkeypatch.setattr(rounds, "refine_steps", lambda found: found)
    monkeypatch.setattr(rounds, "evaluate", lambda point, unknowns, problem: ("nominal", problem))
    state.nominal = SimpleNamespace(point=None, unknowns=())
    assert state.set_in_motion([SimpleNamespace(location=location)]) is moves
    assert (state.current is swings) is moves
    assert (state.nominal == ("nominal", "short")) is moves, "ratios are of one step"


def test_several_causes_of_one_structure_hide_none_elsewhere(world):
    """A panel that is a chain took the three that were looked for, and a payload of 2 kg stayed unnamed; but
    a ripple at a joint that no law has is no reason to look for five.
    """
    state, asked = world

    def at(*places):
        families = {"panel": "appendage", "tank": "slosh"}
        made = [
            candidate(("effect", place, str(number)), families.get(place, "friction"))
            for number, place in enumerate(places)
        ]
        return made[0] if len(made) == 1 else [Cause(score_of(c), (), 9.0) for c in made]

    state.levels = replace(state.levels, causes=3)
    state.causes = at("panel", "panel", "panel")
    assert state._has_room(at("tool")) and state._has_room(at("tank")) and not state._has_room(at("panel"))
    state.causes = at("panel", "panel", "tool", "joint")
    assert (
        state._has_room(at("panel")) and not state._has_room(at("tank")) and not state._has_room(at("joint"))
    )
    state.causes = at("joint", "joint", "joint")
    assert not state._has_room(at("joint")) and not state._has_room(at("panel"))
    state.causes = []
    assert state.forward_step() and asked.has_room == state._has_room  # nor may a rival be one too many


@pytest.mark.parametrize(
    ("causes", "misfit", "open_", "one", "asked_for"),
    [
        (2, False, {}, True, True),
        (2, False, {}, False, True),
        (1, False, {}, True, False),  # that may be what the torque is unknown of
        (2, True, {}, True, False),
        (2, False, {"joint1": 0.1}, True, False),
    ],
)
def test_where_one_unknown_torque_explains_more_no_further_cause_is_looked_for(
    world, monkeypatch, causes, misfit, open_, one, asked_for
):
    """A random torque took five causes, one beside the other, and 16 minutes."""
    state, asked = world
    state.causes = [Cause(score_of(candidate(k)), (), 30.0) for k in (VAIN, OTHER)][:causes]
    state.fitted = replace(state.fitted, misfit=misfit)
    state._score_anew()
    calls = []
    unknown = SimpleNamespace(test=SimpleNamespace(where="torque of joint2"))

    def ask(nominal, found, levels):
        calls.append(found.name)
        return unknown if one else None

    monkeypatch.setattr(rounds, "one_unknown_input", ask)
    monkeypatch.setattr(rounds, "open_joints", lambda found: open_)
    going = state.forward_step()
    assert bool(calls) is asked_for
    assert going is not (one and asked_for)
    assert (state.one_unknown is unknown) is (one and asked_for)
    assert bool(asked.accepted) is not (one and asked_for)
    if asked_for:
        state.causes = state.causes[:causes]
        state._is_one_unknown()
        assert len(calls) == 1  # once beside as many


@pytest.mark.parametrize("still", [True, False])
def test_one_unknown_torque_is_held_against_the_causes_as_they_are_judged(world, still):
    """The first of a pair may be the wrong one until the second is known: exchanged, they explain more."""
    state, _ = world
    assert not state.go_on()  # there is none
    asked = []
    state.one_unknown = SimpleNamespace(
        test=SimpleNamespace(where="torque of joint2"),
        explains_more=lambda found, levels: asked.append(found) or still,
    )
    assert state.go_on() is not still
    assert asked == [state.current]
    assert (state.one_unknown is not None) is still
    assert any("torque of joint2" in said for said in state.failed) is still
