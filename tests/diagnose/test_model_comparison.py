"""A candidate refitted: what its effect frees beyond its strength is fitted where it pays, and paid for."""

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from smsid.diagnose._forward_step import RESTLESS
from smsid.diagnose._noise_covariance import InflatedFit
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.model_comparison import (
    accept,
    aliases_of,
    best_subset_odds,
    cost,
    fit_from_nominal,
    is_distinguishable,
    refit,
)
from smsid.diagnose.score_test import Candidate, Score, score_candidates, signatures
from smsid.diagnose.stepwise import search
from smsid.diagnose.thresholds import DetectionThresholds
from smsid.effects import JointFriction
from smsid.estimation.map_estimate import evaluate, fit
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise
from smsid.experiments import fly, named_experiment
from smsid.model import build_model

RATE = "joint_friction_joint2.stribeck_rate"
EXPONENT = "joint_friction_joint2.stribeck_exponent"

WHITE = SimpleNamespace(coloured=False)  # a problem whose levels count no misfit


def rubbed(description, known, friction, duration=6.0):
    """The nominal fit of some seconds with friction at joint 2, the score of a Stribeck friction there."""
    truth = description.with_effects(
        JointFriction(kind="joint_friction", name="rub", joint="joint2", **friction)
    )
    plan = named_experiment("exp2", build_model(description)).model_copy(update={"duration": duration})
    recording = fly(build_model(truth), plan, np.random.default_rng(3)).recording
    data = measurements_of(known.point.base, recording, known.point.description.effective_sensors()).thinned(
        25.0
    )
    problem = Problem(
        recording, data, np.array([], dtype=int), CommandTiming("linear", "right"), ProcessNoise()
    )
    current = fit(known.point, known.unknowns[:1], problem)
    candidates = propose(known.point, problem, known.unknowns[:1])
    one = next(c for c in candidates if c.key == ("joint_friction", "joint2", "stribeck"))
    (score,) = score_candidates(current, [one], list(signatures(current, [one]).values()))
    return current, score


@pytest.fixture(scope="module")
def rubbing(description, known):
    """Of a curve that falls at another rate."""
    return rubbed(description, known, {"coulomb": 0.1, "stribeck": 0.1, "stribeck_rate": 0.15})


def test_the_rate_of_a_stribeck_curve_is_fitted_where_it_is_another(rubbing):
    current, score = rubbing
    found = refit(current, score)
    names = [u.name for u in found.unknowns]
    assert RATE in names
    paid = (score.freedom + len({RATE, EXPONENT} & set(names))) * np.log(current.run.samples)
    assert cost(current, score, found) == pytest.approx(paid)
    start = next(p.value for p in score.candidate.effect.parameters() if p.name == RATE)
    value = found.point.value(found.unknowns[names.index(RATE)])
    assert abs(value - 0.15) < abs(start - 0.15)


def test_how_sharply_a_stribeck_curve_falls_is_fitted_where_it_is_no_gaussian(description, known):
    friction = {"coulomb": 0.1, "stribeck": 0.15, "stribeck_rate": 0.08, "stribeck_exponent": 1.0}
    current, score = rubbed(description, known, friction, duration=12.0)
    found = refit(current, score)
    value = next(found.point.value(u) for u in found.unknowns if u.name == EXPONENT)
    assert 2.0 - value > 3.0 * found.sigma(EXPONENT)


def test_what_explains_only_without_end_is_no_cause(rubbing, monkeypatch):
    current, score = rubbing
    assert accept(current, score, [score], DetectionThresholds(), 60)[0] is not None
    monkeypatch.setattr("smsid.diagnose._wald_test.wald", lambda *_, **__: 5.0)
    assert accept(current, score, [score], DetectionThresholds(), 60)[0] is None


@pytest.mark.parametrize(("factor", "believed"), [(0.02, False), (0.6, True)])
def test_an_optimum_that_cannot_be_is_no_cause(rubbing, factor, believed):
    """A gyro whose axis y follows the motion by a fiftieth: no scale error; six tenths of it are."""
    problem = rubbing[0].problem
    data, values = problem.data, problem.data.values.copy()
    row = data.names.index("imu.angular_rate[y]")
    values[:, row] *= factor
    current = evaluate(
        rubbing[0].point, rubbing[0].unknowns, replace(problem, data=replace(data, values=values))
    )
    key = ("sensor_scale", "imu.angular_rate", "scale")
    one = next(c for c in propose(current.point, problem, current.unknowns) if c.key == key)
    (score,) = score_candidates(current, [one], list(signatures(current, [one]).values()))
    found, in_vain = refit(current, score), set()
    assert (found is not None) is believed
    cause, reached = accept(current, score, [score], DetectionThresholds(), 60, in_vain=in_vain)
    if believed:
        name = f"{one.effect.name}.error.y"
        value = found.point.value(next(u for u in found.unknowns if u.name == name))
        assert value == pytest.approx(-0.4, abs=5e-3)
        assert cause is not None and not in_vain
    else:
        assert cause is None and reached is current and in_vain == {key}


@pytest.fixture(scope="module")
def restless(description, known):
    """A fit without friction that stopped far from its best, that best, and a score that gains nothing."""
    at_rest, score = rubbed(description, known, {"viscous": 1e-9})
    far = known.point.moved(at_rest.unknowns, 60.0 * np.ones(len(at_rest.unknowns)))
    stopped = evaluate(far, at_rest.unknowns, at_rest.problem)
    assert 2.0 * (stopped.objective - at_rest.objective) > 2.0 * DetectionThresholds().linear
    (score,) = score_candidates(
        stopped, [score.candidate], list(signatures(stopped, [score.candidate]).values())
    )
    return stopped, at_rest, score


def test_what_a_fit_that_had_not_come_to_rest_could_reach_is_kept_without_a_cause(restless):
    stopped, at_rest, score = restless
    cause, found = accept(stopped, score, [score], DetectionThresholds(), 60)
    assert cause is None
    assert found.objective == pytest.approx(at_rest.objective, abs=0.1)
    assert found.unknowns == stopped.unknowns


def test_a_fit_that_has_not_come_to_rest_begins_again_from_the_nominal_parameters(restless):
    """With an encoder's bias accepted last, tank and bodies were caught ten standard deviations off."""
    stopped, at_rest, _ = restless
    assert fit_from_nominal(stopped, ()).objective == pytest.approx(at_rest.objective, abs=0.1)
    assert fit_from_nominal(at_rest, ()) is at_rest
    begun = fit_from_nominal(replace(stopped, objective=at_rest.objective - 1.0), ())
    assert begun.objective == at_rest.objective - 1.0, "one that is worse is not taken"


def test_the_search_goes_on_from_there_with_all_its_candidates(restless, monkeypatch):
    """And what was reached without a cause is the fit of the nominal parameters."""
    stopped, at_rest, score = restless
    tried, seen = [], []

    def accepted(current, best, *_, **__):
        tried.append(best.candidate.key)
        seen.append(current.objective)
        return None, at_rest if len(tried) == 2 else current

    start = InflatedFit(stopped, np.ones(stopped.problem.data.rows))
    monkeypatch.setattr("smsid.diagnose._forward_step.accept", accepted)
    monkeypatch.setattr("smsid.diagnose.stepwise.first_fit", lambda *_: start)
    monkeypatch.setattr("smsid.diagnose.stepwise.with_levels", lambda found, *_: found)
    monkeypatch.setattr("smsid.diagnose.stepwise.coarse_cause", lambda *_: None)
    monkeypatch.setattr("smsid.diagnose.score_test.Score.p_value", 1e-9)
    other = replace(score.candidate, location="elsewhere", shape="another")  # else it is the same error
    found = search(at_rest.point, at_rest.problem, at_rest.unknowns, [score.candidate, other])
    assert len(tried) == 4
    assert {*tried[:2]} == {*tried[2:]} == {score.candidate.key, other.key}
    assert seen[:2] == [stopped.objective] * 2
    assert 2.0 * (seen[2] - at_rest.objective) < 1.0
    assert found.nominal is found.last and found.last.objective == seen[3]
    assert found.normalised_rmse[0] == found.normalised_rmse[1]


def test_the_search_ends_where_every_candidate_leads_to_another_fit(restless, monkeypatch):
    _, at_rest, score = restless
    tried = []

    def accepted(current, best, *_, **__):
        tried.append(best.candidate.key)
        return None, replace(current, objective=current.objective - 1e4)

    monkeypatch.setattr("smsid.diagnose._forward_step.accept", accepted)
    monkeypatch.setattr("smsid.diagnose._forward_step.refit_noise", lambda found, **_: found)
    monkeypatch.setattr("smsid.diagnose.score_test.Score.p_value", 1e-9)
    search(at_rest.point, at_rest.problem, at_rest.unknowns, [score.candidate])
    assert len(tried) == RESTLESS + 1


def test_a_cause_that_holds_another_takes_its_place(description, known, monkeypatch):
    """A Stribeck friction that was found as Coulomb's at first is one cause, not two."""
    friction = {"coulomb": 0.1, "stribeck": 0.15, "stribeck_rate": 0.08}
    current, stribeck = rubbed(description, known, friction, duration=12.0)
    proposed = propose(known.point, current.problem, current.unknowns)
    coulomb = next(c for c in proposed if c.key == ("joint_friction", "joint2", "coulomb"))
    assert stribeck.candidate.holds(coulomb) and not coulomb.holds(stribeck.candidate)
    assert not stribeck.candidate.holds(stribeck.candidate)
    ratios = []

    def in_turn(now, best, scores, *rest, **order):
        first = next((s for s in scores if s.candidate.key == coulomb.key), best)
        cause, found = accept(now, best if ratios else first, [best if ratios else first], *rest, **order)
        ratios.append(cause.ratio)
        return cause, found

    monkeypatch.setattr("smsid.diagnose._forward_step.accept", in_turn)
    # both were found while misfit was counted: what they weigh without it is tested by itself
    monkeypatch.setattr("smsid.diagnose._forward_step.recompute_evidence", lambda causes, *_: list(causes))
    found = search(known.point, current.problem, current.unknowns, [coulomb, stribeck.candidate])
    assert len(ratios) == 2
    (cause,) = found.causes
    assert cause.score.candidate.key == stribeck.candidate.key
    assert cause.ratio == pytest.approx(sum(ratios))


def score(ratio, freedom, location="joint1", sides=2):
    """A score without columns."""
    own = Candidate(
        "joint_friction", location, "friction", f"{freedom}", None, ("a",) * freedom, (1.0,) * freedom
    )
    nothing, zero = np.zeros((0, freedom)), np.zeros((freedom, freedom))
    return Score(own, ratio, freedom, zero[:, 0], zero, 1.0, nothing, nothing, sides)


@pytest.mark.parametrize(
    ("more", "extra", "rejected"), [(1, 3.5, True), (1, 4.5, False), (2, 5.5, True), (2, 6.5, False)]
)
def test_a_sibling_with_more_parameters_is_rejected_by_what_they_explain(more, extra, rejected):
    """Not by their price: two parameters cost 18 at 10000 samples."""
    winner, rival = score(100.0, 1), score(100.0 + extra, 1 + more)
    assert is_distinguishable(winner, rival, 10_000, DetectionThresholds()) is rejected


@pytest.mark.parametrize(
    ("beyond", "sigma", "rejected"), [(0.0, 1.0, True), (0.0, 3.0, False), (4.0, 1.0, False)]
)
def test_a_sibling_that_holds_the_winner_stays_while_what_it_adds_may_be_half_as_large(
    beyond, sigma, rejected
):
    """Stribeck's friction where Coulomb's has just been found: 10 +- 1, and on breaking loose 0 +- 3."""
    winner = replace(score(100.0, 1), estimate=np.array([10.0]))
    rival = score(100.0 + min((beyond / sigma) ** 2, 3.0), 2)
    rival = replace(
        rival, candidate=replace(rival.candidate, free=("a", "b")), estimate=np.array([10.0, beyond]),
        covariance=np.diag([1.0, sigma**2]),
    )  # fmt: skip
    assert is_distinguishable(winner, rival, 10_000, DetectionThresholds()) is rejected
    strong = replace(winner, ratio=1000.0)  # what it adds would show
    assert is_distinguishable(
        strong, replace(rival, ratio=rival.ratio + 900.0), 10_000, DetectionThresholds()
    )


def test_one_that_explains_far_less_is_rejected_however_few_its_parameters_are():
    """Six parameters that explain 300 cost 29; beside them, one that explains far less is no rival."""
    beyond = float(chi2.isf(0.001, 6))
    for lead, rejected in ((beyond + 0.1, True), (beyond - 0.1, False)):
        assert (
            is_distinguishable(
                score(300.0, 6), score(300.0 - lead, 1, "joint2"), 10_000, DetectionThresholds()
            )
            is rejected
        )
    assert not is_distinguishable(
        score(5000.0, 6), score(4970.0, 1, "joint2"), 10_000, DetectionThresholds()
    ), "not to be believed"


def test_what_was_searched_is_paid_for_when_rivals_are_rejected():
    winner = score(45.0, 1)
    searched = replace(winner, candidate=replace(winner.candidate, grid=205))
    for lead, rejected in ((float(chi2.isf(0.001 / 205, 1)) + 0.1, True), (12.0, False)):
        assert (
            is_distinguishable(searched, score(45.0 - lead, 1, "joint2"), 10_000, DetectionThresholds())
            is rejected
        )


def test_what_is_there_all_the_time_is_tried_beside_what_begins(monkeypatch):
    """Strong and curved, it explains more than its linear score, and more than the one that begins."""
    begun, still = score(5000.0, 1), score(2000.0, 1, "joint2")
    effect = JointFriction(name="late", joint="joint1", start=3.0)
    begun = replace(begun, candidate=replace(begun.candidate, effect=effect))
    run = SimpleNamespace(samples=10_000)
    fits = {
        x: SimpleNamespace(objective=o, run=run, unknowns=(), problem=WHITE)
        for x, o in (("joint1", 500.0), ("joint2", 0.0))
    }
    limits = []

    def refit(current, s, at_most):
        limits.append(at_most)
        return fits[s.candidate.location]

    monkeypatch.setattr("smsid.diagnose.model_comparison.refit", refit)
    monkeypatch.setattr("smsid.diagnose._wald_test.wald", lambda *_, **__: 1e3)
    current = SimpleNamespace(objective=3000.0, run=run, unknowns=())
    cause, found = accept(current, begun, [begun, still], DetectionThresholds(), 60)
    assert cause.score is still
    assert found is fits["joint2"]
    assert cause.ratio == pytest.approx(6000.0)
    assert limits[0] == np.inf and 525.0 < limits[1] < 600.0  # what ends far above the first is given up


@pytest.mark.parametrize(
    ("like", "also", "alias"),
    [(1.0, 0, True), (0.7, 0, False), (1.0, 3, False)],
    ids=["same", "like", "pays"],
)
def test_strong_ones_that_do_the_same_are_aliases_at_any_price(monkeypatch, like, also, alias):
    """A friction that goes with the cosine of a small angle, and Coulomb friction; but not one that takes
    further parameters to do the same.
    """
    columns, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((5000, 3)))
    winner = replace(score(2843.0, 1), columns=columns[:, :1])
    own = like * columns[:, :1] + np.sqrt(1.0 - like**2) * columns[:, 1:2]
    more = tuple(f"b{i}" for i in range(also))
    rival = score(2843.2, 2)
    rival = replace(
        rival,
        candidate=replace(rival.candidate, free=("b", "c"), also=more),
        columns=np.column_stack([own, columns[:, 2]]),
    )
    run = SimpleNamespace(samples=10_000)
    freed = {id(winner): (), id(rival): tuple(SimpleNamespace(name=n) for n in more)}
    fits = {
        id(s): SimpleNamespace(objective=-0.5 * s.ratio, run=run, unknowns=freed[id(s)], problem=WHITE)
        for s in (winner, rival)
    }
    monkeypatch.setattr("smsid.diagnose.model_comparison.refit", lambda current, s, at_most: fits[id(s)])
    monkeypatch.setattr("smsid.diagnose._wald_test.wald", lambda *_, **__: 1e3)
    current = SimpleNamespace(objective=0.0, run=run, unknowns=())
    cause, _ = accept(current, winner, [winner, rival], DetectionThresholds(), 60)
    assert cause.score is winner
    assert [s for s, _ in cause.aliases] == ([rival] if alias else [])


def test_one_as_large_elsewhere_is_rejected_by_its_odds():
    """What two parameters more explain by chance is 2; that they explain 6 more leaves one in three."""
    winner = score(100.0, 1)
    for ratio, rejected in ((95.0, False), (92.0, True)):
        assert (
            is_distinguishable(winner, score(ratio, 1, "joint2"), 10_000, DetectionThresholds()) is rejected
        )
    for ratio, rejected in ((101.0, True), (106.0, False)):
        assert (
            is_distinguishable(winner, score(ratio, 3, "joint2"), 10_000, DetectionThresholds()) is rejected
        )


@pytest.mark.parametrize("freedom", [1, 3, 6])
def test_what_is_just_found_is_beaten_by_chance_as_seldom_as_the_levels_say(freedom):
    """One parameter is there, at strength 1; of more, one does the same and the others explain noise."""
    rng = np.random.default_rng(6)
    wrong = 0
    for noise in rng.standard_normal((4000, freedom)):
        there = (5.4 + noise[0]) ** 2
        winner, rival = score(there + float(noise[1:] @ noise[1:]), freedom, "joint2"), score(there, 1)
        wrong += is_distinguishable(winner, rival, 10_000, DetectionThresholds())
    assert wrong <= 30, "half a percent, and chance"


def test_three_components_that_are_just_found_are_not_beaten_by_one_that_looks_like_them():
    """A force at strength 1, in part the scale of an encoder: the criterion prefers the latter by 9."""
    force, scale = score(30.0, 3, "bus"), score(18.5, 1)
    assert force.odds(10_000) > scale.odds(10_000)
    assert scale.information_gain(10_000) > force.information_gain(10_000) + 6.6
    assert not is_distinguishable(scale, force, 10_000, DetectionThresholds())


def fitted_to(residual, columns, location, ratio=None):
    """The score of columns on a residual; with a ratio of its own, as if that were left of it."""
    estimate, *_ = np.linalg.lstsq(columns, residual, rcond=None)
    explained = float(np.sum((columns @ estimate) ** 2))
    own = score(explained if ratio is None else ratio, columns.shape[1], location)
    return replace(own, columns=columns, estimate=estimate)


def test_what_can_do_the_same_elsewhere_is_not_rejected_by_its_price():
    """The inertia of a motor and that of the link it turns: one signature, one parameter against three."""
    columns = np.linalg.qr(np.random.default_rng(0).standard_normal((50, 4)))[0]
    residual = columns @ np.array([10.0, 0.7, 0.7, 0.1])
    winner = fitted_to(residual, columns[:, :1], "joint1")
    same = fitted_to(residual, columns[:, :3] @ np.diag([1.0, 2.0, 3.0]), "link2")
    assert not is_distinguishable(winner, same, 10_000, DetectionThresholds())
    assert is_distinguishable(
        winner, fitted_to(residual, columns[:, 1:], "link2"), 10_000, DetectionThresholds()
    )
    assert is_distinguishable(winner, replace(same, ratio=90.0), 10_000, DetectionThresholds())
    nearly = fitted_to(residual, same.columns + 0.3 * columns[:, 3:], "link2")
    assert not is_distinguishable(
        winner, replace(nearly, ratio=101.0), 10_000, DetectionThresholds()
    )  # it explains more
    assert is_distinguishable(winner, replace(nearly, ratio=99.0), 10_000, DetectionThresholds())


@pytest.mark.parametrize(("size", "rejected"), [(3.0, False), (100.0, True)])
def test_what_does_the_same_only_where_several_parameters_happen_to_match_is_less_likely(size, rejected):
    """A link's inertia about an axis that turns in it is that of a motor where two moments change alike."""
    columns = np.linalg.qr(np.random.default_rng(0).standard_normal((50, 3)))[0]
    residual = size * columns @ np.array([1.0, 0.0, 0.0])
    winner = fitted_to(residual, columns[:, :1], "joint1")
    turned = columns @ np.linalg.qr(np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 1.0]]))[0]
    assert (
        is_distinguishable(winner, fitted_to(residual, turned, "link2"), 10_000, DetectionThresholds())
        is rejected
    )
    alone = fitted_to(residual, columns, "link2")
    assert not is_distinguishable(winner, alone, 10_000, DetectionThresholds()), (
        "one of its parameters does it alone"
    )


def test_the_odds_of_a_score_are_those_of_the_few_parameters_that_do():
    """By least squares with every set of columns."""
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((200, 4)) @ rng.standard_normal((4, 4))
    residual = 3.0 * columns[:, 2] + rng.standard_normal(200)
    s = fitted_to(residual, columns, "link2")
    expected = s.odds(10_000)
    for few in (1, 2, 3):
        sets = list(combinations(range(4), few))
        for some in sets:
            part = fitted_to(residual, columns[:, list(some)], "link2")
            expected = max(expected, part.odds(10_000) - 2.0 * np.log(len(sets)))
    assert best_subset_odds(s, 10_000) == pytest.approx(expected)
    assert expected > s.odds(10_000)


def test_a_parameter_with_a_sign_is_tested_on_one_side():
    assert score(16.0, 1, sides=1).p_value == pytest.approx(0.5 * score(16.0, 1).p_value)


@pytest.mark.parametrize(
    ("like", "ratio", "rejected"),
    [(1.0, 99.0, False), (1.0, 92.0, True), (0.5, 96.0, True), (0.5, 115.0, False)],
    ids=["looks alike", "looks alike, explains less", "looks otherwise", "looks otherwise, explains more"],
)
def test_a_sibling_that_does_not_hold_the_winner_is_rejected_by_what_it_leaves(like, ratio, rejected):
    """A friction that goes with the cosine of an angle has two parameters and no Coulomb friction in it."""
    columns = np.random.default_rng(0).standard_normal((5000, 3))
    winner = replace(score(100.0, 1), columns=columns[:, :1])
    own = like * columns[:, :1] + np.sqrt(1.0 - like**2) * columns[:, 1:2]
    rival = score(ratio, 2)
    rival = replace(
        rival,
        candidate=replace(rival.candidate, free=("b", "c")),
        columns=np.column_stack([own, columns[:, 2]]),
    )
    assert is_distinguishable(winner, rival, 10_000, DetectionThresholds()) is rejected


def seen(ratio, freedom=1, seed=0):
    """A score with a signature much like those of other seeds."""
    own = score(ratio, freedom, f"joint{seed}")
    rng = np.random.default_rng(seed)
    columns = np.ones((50, 1)) + 0.3 * rng.standard_normal((50, freedom))
    return replace(own, columns=columns)


def test_of_many_aliases_the_unlikely_are_left_out_together():
    winner, likely, less = seen(100.0), seen(99.0, seed=1), seen(97.0, seed=2)

    def left(*near):
        return [s.candidate.location for s, _ in aliases_of(winner, near, 10_000)]

    unlikely = seen(94.0, seed=3)
    assert left(likely, less, unlikely) == ["joint1", "joint2"]
    assert left(likely, unlikely) == ["joint1", "joint3"]  # few are all named
    assert left(likely, less, seen(96.0, seed=3)) == ["joint1", "joint2", "joint3"]
    dear = seen(101.0, 2, seed=3)  # unlikely for what it costs, but it explains more
    assert left(likely, less, dear) == ["joint1", "joint2", "joint3"]
    same = replace(seen(99.0, 2, seed=3), columns=np.column_stack([winner.columns, dear.columns[:, 1]]))
    assert left(likely, less, same) == ["joint1", "joint2", "joint3"]  # it can do just what the winner does
    reached = {id(winner): 60.0, id(likely): 59.0, id(less): 58.0, id(unlikely): 59.5}
    tied = aliases_of(winner, [likely, less, unlikely], 10_000, reached)
    assert len(tied) == 3  # by the refit, whatever they were before it
