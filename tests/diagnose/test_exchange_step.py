"""Causes judged again beside the others: a wrong one found first gives way, a right one stays."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.diagnose._exchange_step import eliminate_backward, exchange_step, recompute_evidence
from smsid.diagnose._merge_step import _is_left, merge_step
from smsid.diagnose._without_cause import rivals_beside, without_cause
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.model_comparison import Cause, refit
from smsid.diagnose.score_test import score_candidates, signatures
from smsid.diagnose.thresholds import DetectionThresholds
from smsid.effects import JointFriction, MassLoss, MotorInertia, Payload, TorqueGain
from smsid.estimation.map_estimate import evaluate, fit
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise
from smsid.experiments import fly, named_experiment
from smsid.model import build_model

FRICTION, GAIN = ("joint_friction", "joint2"), ("torque_gain", "joint1", "torque constant")
PLACE = (0.8, -0.5, 0.3)  # [m]
KINDS = ("joint_friction", "torque_gain")
STRONG = TorqueGain(kind="torque_gain", name="strong", joint="joint1", error=0.02)


@pytest.fixture(scope="module")
def pair(description, known):
    """Six seconds with Coulomb friction and a motor that is too strong: the nominal fit, candidates."""
    return paired(known, description.with_effects(friction(0.01), STRONG), KINDS)


def friction(coulomb):
    return JointFriction(kind="joint_friction", name="rub", joint="joint2", coulomb=coulomb)


def paired(known, truth, kinds):
    plan = named_experiment("exp2", known.point.model()).model_copy(update={"duration": 6.0})
    recording = fly(build_model(truth), plan, np.random.default_rng(3)).recording
    data = measurements_of(known.point.base, recording, known.point.description.effective_sensors()).thinned(
        25.0
    )
    problem = Problem(
        recording, data, np.array([], dtype=int), CommandTiming("linear", "right"), ProcessNoise()
    )
    candidates = [c for c in propose(known.point, problem, known.unknowns) if c.kind in kinds]
    return fit(known.point, known.unknowns, problem), candidates


def with_causes(nominal, candidates, keys):
    """The causes of these keys and the fit with them, one after the other."""
    current, causes = nominal, []
    for key in keys:
        one = next(c for c in candidates if c.key == key)
        (score,) = score_candidates(current, [one], list(signatures(current, [one]).values()))
        current = refit(current, score)
        causes.append(Cause(score, (), score.ratio))
    return causes, current


@pytest.mark.parametrize("first", ["viscous", "coulomb"])
def test_the_right_shape_takes_the_place_of_the_wrong_one(pair, first):
    nominal, candidates = pair
    causes, current = with_causes(nominal, candidates, [(*FRICTION, first), GAIN])
    found, last = exchange_step(causes, current, nominal, candidates, DetectionThresholds())
    assert [c.score.candidate.key for c in found] == [(*FRICTION, "coulomb"), GAIN]
    assert last.objective <= current.objective
    assert (last is current) == (first == "coulomb")
    assert last.point.description.get_effect("joint_friction_joint2").viscous == 0.0
    assert not {"viscous", "coulomb"} & {s.candidate.shape for s, _ in found[0].aliases}


def test_one_cause_takes_the_place_of_two_whose_work_it_does(pair, monkeypatch):
    """A motor's gain at one joint was those of two others, of the other sign; not where one of them is still
    seen beside it.
    """
    nominal, candidates = pair
    causes, current = with_causes(nominal, candidates, [(*FRICTION, "viscous"), GAIN])
    args = nominal, candidates, DetectionThresholds()
    found, last = merge_step(causes, current, *args)
    assert [c.score.candidate.key for c in found] == [(*FRICTION, "coulomb")]
    assert {u.name for u in last.unknowns} - {u.name for u in nominal.unknowns} == {
        "joint_friction_joint2.coulomb"
    }
    assert last.objective < current.objective
    kept, same = merge_step(causes, current, *args, settled=[GAIN])
    assert kept == causes and same is current
    right, last = with_causes(nominal, candidates, [(*FRICTION, "coulomb"), GAIN])
    kept, same = merge_step(right, last, *args)
    assert kept == right and same is last
    monkeypatch.setattr("smsid.diagnose._merge_step._is_left", lambda *_: True)
    assert merge_step(causes, current, *args)[0] == causes


def test_what_is_left_of_a_cause_is_seen_in_a_fit_without_it(pair):
    nominal, candidates = pair
    (rubs,), with_it = with_causes(nominal, candidates, [(*FRICTION, "coulomb")])
    drag, _ = with_causes(nominal, candidates, [(*FRICTION, "viscous")])
    assert _is_left(nominal, [rubs], DetectionThresholds(), len(candidates))
    assert _is_left(nominal, [*drag, rubs], DetectionThresholds(), len(candidates))
    assert not _is_left(with_it, drag, DetectionThresholds(), len(candidates))


def test_no_rival_shares_a_parameter_with_what_it_would_stand_beside(pair):
    """Coulomb friction beside a Stribeck curve, which has it, explained nothing, took the place of what was
    not needed, for no price, and could not be taken out again.
    """
    nominal, candidates = pair
    causes, current = with_causes(nominal, candidates, [(*FRICTION, "stribeck"), GAIN])
    beside = {c.key for c in rivals_beside(candidates, causes[:1])}
    assert not {(*FRICTION, "coulomb"), (*FRICTION, "stribeck")} & beside
    assert {(*FRICTION, "viscous"), GAIN} <= beside
    args = nominal, candidates, DetectionThresholds()
    found, _ = exchange_step(causes, current, *args, last_too=True)
    parameters = [n for c in found for n in c.score.candidate.parameters]
    assert len(parameters) == len(set(parameters))
    assert all(c.score.freedom for c in found)


def test_a_strong_cause_is_judged_by_what_its_siblings_do_now(description, known):
    """What they did along the motion without any cause is off by as much as tells them apart."""
    nominal, candidates = paired(known, description.with_effects(friction(0.2), STRONG), KINDS)
    causes, current = with_causes(nominal, candidates, [(*FRICTION, "stribeck"), GAIN])
    (found, _), _ = exchange_step(causes, current, nominal, candidates, DetectionThresholds())
    held = {found.score.candidate.shape, *(s.candidate.shape for s, _ in found.aliases)}
    assert "coulomb" in held and "viscous" not in held


def test_a_strong_cause_is_judged_by_what_rivals_elsewhere_do_now(description, known):
    """The tool holds the payload, a link was named instead; nominal parameters that stood in for it moved."""
    truth = description.with_effects(
        Payload(kind="payload", name="grasped", frame="tool", mass=3.0, com=(0.05, 0.08, -0.06)),
        MotorInertia(kind="motor_inertia", name="heavy", joint="joint1", inertia=0.4),
    )
    kinds = ("payload", "body_error", "motor_inertia")
    nominal, candidates = paired(known, truth, kinds)
    keys = [("body_error", "link3", "mass"), ("motor_inertia", "joint1", "motor inertia")]
    causes, current = with_causes(nominal, candidates, keys)
    (found, _), _ = exchange_step(causes, current, nominal, candidates, DetectionThresholds())
    assert found.score.candidate.kind == "payload"


def test_a_tank_that_stood_in_for_something_else_gives_way(description, known):
    """It has motion of its own: what the fit is without it takes a fit, not a step."""
    heavy = MotorInertia(kind="motor_inertia", name="heavy", joint="joint3", inertia=2.0)
    nominal, candidates = paired(
        known, description.with_effects(heavy, STRONG), ("slosh", "motor_inertia", "torque_gain")
    )
    causes, current = with_causes(nominal, candidates, [("slosh", "bus", "another slosh mass"), GAIN])
    assert current.changes.model.nv > nominal.changes.model.nv
    found, last = exchange_step(causes, current, nominal, candidates, DetectionThresholds())
    assert [c.score.candidate.key[:2] for c in found] == [("motor_inertia", "joint3"), GAIN[:2]]
    assert last.objective < current.objective
    assert last.changes.model.nv == nominal.changes.model.nv


def test_a_mode_that_others_made_unnecessary_is_left_out(description, known):
    """Where it is none it has no derivative: never taken out, it stood beside whatever was right."""
    nominal, candidates = paired(known, description.with_effects(friction(0.01)), (*KINDS, "extra_mode"))
    mode = next(c.key for c in candidates if c.kind == "extra_mode")
    rub = (*FRICTION, "coulomb")
    causes, current = with_causes(nominal, candidates, [mode, rub])
    assert current.changes.model.nv > nominal.changes.model.nv
    less = without_cause(current, causes[0].score.candidate, nominal)
    assert less.changes.model.nv == nominal.changes.model.nv
    assert less.unknowns == tuple(u for u in current.unknowns if not u.name.startswith("panel_more."))
    kept, last = eliminate_backward(causes, current, nominal, DetectionThresholds(), len(candidates))
    assert [c.score.candidate.key for c in kept] == [rub]
    assert last.changes.model.nv == nominal.changes.model.nv


def test_a_cause_is_taken_out_as_the_filter_runs_without_it(pair):
    nominal, candidates = pair
    causes, current = with_causes(nominal, candidates, [(*FRICTION, "coulomb"), GAIN])
    less = without_cause(current, causes[0].score.candidate, nominal)
    again = evaluate(less.point, less.unknowns, less.problem)
    assert less.unknowns == again.unknowns
    moved = again.run.innovations - current.run.innovations
    off = np.linalg.norm(less.run.innovations - again.run.innovations)
    assert off < 0.05 * np.linalg.norm(moved)
    assert less.objective == pytest.approx(again.objective, rel=0.01)


@pytest.fixture(scope="module")
def leaking(description, known):
    """Six seconds with a leak far from the bus's origin and Coulomb friction: the nominal fit, candidates."""
    truth = description.with_effects(
        MassLoss(kind="mass_loss", name="leak", frame="bus", position=PLACE, rate=2.0),
        JointFriction(kind="joint_friction", name="rub", joint="joint2", coulomb=0.01),
    )
    plan = named_experiment("exp2", build_model(description)).model_copy(update={"duration": 6.0})
    recording = fly(build_model(truth), plan, np.random.default_rng(3)).recording
    data = measurements_of(known.point.base, recording, known.point.description.effective_sensors()).thinned(
        25.0
    )
    problem = Problem(
        recording, data, np.array([], dtype=int), CommandTiming("linear", "right"), ProcessNoise()
    )
    keys = [("mass_loss", "bus", "mass loss"), (*FRICTION, "coulomb")]
    candidates = [c for c in propose(known.point, problem, known.unknowns) if c.key in keys]
    return fit(known.point, known.unknowns[:3], problem), candidates


def test_a_place_found_wrongly_is_found_again(leaking):
    nominal, candidates = leaking
    keys = [c.key for c in sorted(candidates, key=lambda c: c.kind != "mass_loss")]
    causes, right = with_causes(nominal, candidates, keys)
    leak = causes[0].score.candidate
    names = dict(zip(leak.free, (1.0, 0.0, 3.0, 0.0), strict=True))
    mine = leak.instance(right.point)
    wrong = evaluate(right.point.with_effect(mine.with_values(names)), right.unknowns, right.problem)
    assert wrong.objective > right.objective + 100.0
    found, last = exchange_step(causes, wrong, nominal, candidates, DetectionThresholds())
    assert [c.score.candidate.key for c in found] == keys
    assert last.objective == pytest.approx(right.objective, abs=2.0)
    assert found[0].ratio > causes[0].ratio / 2.0
    assert last.point.description.get_effect(mine.name).position == pytest.approx(PLACE, abs=0.2)
    same, kept = exchange_step(causes, right, nominal, candidates, DetectionThresholds())
    assert kept is right and [c.score for c in same] == [c.score for c in causes]


def test_without_exchange_the_cause_stays_and_its_aliases_are_judged(pair):
    """Where misfit is counted, what a rival gains may be of that."""
    nominal, candidates = pair
    causes, current = with_causes(nominal, candidates, [(*FRICTION, "viscous"), GAIN])
    found, last = exchange_step(causes, current, nominal, candidates, DetectionThresholds(), exchange=False)
    assert [c.score for c in found] == [c.score for c in causes] and last is current
    assert "coulomb" in {s.candidate.shape for s, _ in found[0].aliases}


def test_the_last_cause_is_judged_again_too_where_asked(pair):
    """With the noise finer than it was when that was chosen, what rivals it had are none."""
    nominal, candidates = pair
    causes, current = with_causes(nominal, candidates, [(*FRICTION, "coulomb")])
    rivals = [c for c in candidates if c.key == (*FRICTION, "viscous")]
    (rival,) = score_candidates(nominal, rivals, list(signatures(nominal, rivals).values()))
    causes[0] = replace(causes[0], aliases=((rival, 0.9),))
    (kept,), _ = exchange_step(causes, current, nominal, candidates, DetectionThresholds())
    (again,), last = exchange_step(causes, current, nominal, candidates, DetectionThresholds(), last_too=True)
    assert kept.aliases == causes[0].aliases
    assert again.score is causes[0].score and last is current
    assert "viscous" not in {s.candidate.shape for s, _ in again.aliases}


def test_causes_weigh_more_where_the_noise_is_finer(pair):
    """As much as a fit without each of them loses."""
    nominal, candidates = pair
    problem = nominal.problem
    coarse = replace(problem, data=problem.data.scaled(np.full(problem.data.rows, 5.0)))
    normalised_rmse = fit(nominal.point, nominal.unknowns, coarse)
    causes, current = with_causes(normalised_rmse, candidates, [(*FRICTION, "coulomb"), GAIN])
    last = fit(current.point, current.unknowns, problem)
    for before, after in zip(causes, recompute_evidence(causes, last, nominal), strict=True):
        less = without_cause(last, before.score.candidate, nominal)
        refitted = fit(less.point, less.unknowns, less.problem)
        assert after.ratio > 3.0 * before.ratio
        assert after.ratio == pytest.approx(2.0 * (refitted.objective - last.objective), rel=0.1)
