"""Play in a gear as a candidate: which torque crosses the gap is found with its size."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose._threshold_hypothesis import ThresholdHypothesis
from smsid.diagnose.hypotheses import CROSSED, propose
from smsid.diagnose.score_test import score_candidates, signatures
from smsid.diagnose.verdict import values
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.sensitivities import propagate

GAP = 2e-5


@pytest.fixture(scope="module")
def found(known, problem):
    return evaluate(known.point, known.unknowns, problem)


@pytest.fixture(scope="module")
def play(known, problem):
    every = propose(known.point, problem, known.unknowns)
    return next(
        c
        for c in every
        if isinstance(c, ThresholdHypothesis) and c.kind == "backlash" and c.location == "joint2"
    )


@pytest.mark.parametrize("share", [0, 2])
def test_the_crossing_is_found(found, play, share):
    torque = CROSSED[share] * np.sqrt(np.mean(found.run.states.tau[:, play.first] ** 2))
    plain = play.effect.model_copy(update={"turn_torque": float(torque)})
    there = plain.with_values({play.free[0]: GAP})
    done = propagate(found.run, [found.changes.effect(plain, there, 1.0)])[:, :, 0]
    run = replace(found.run, innovations=done)
    (own,) = signatures(found, [play]).values()
    (score,) = score_candidates(replace(found, run=run), [play], [own])
    assert score.candidate.effect.turn_torque == pytest.approx(torque)
    assert score.candidate.grid == len(CROSSED)
    assert score.sides == 1
    assert score.estimate[0] * play.steps[0] == pytest.approx(GAP, rel=1e-3)


def test_a_gap_is_not_negative(found, play):
    (own,) = signatures(found, [play]).values()
    run = replace(found.run, innovations=-own[:, 0].reshape(found.run.innovations.shape))
    (score,) = score_candidates(replace(found, run=run), [play], [own])
    assert score.ratio == 0.0 or score.candidate.effect.turn_torque != pytest.approx(
        CROSSED[0] * np.sqrt(np.mean(found.run.states.tau[:, play.first] ** 2))
    )


def test_a_joint_that_is_not_driven_has_one_too(found, play):
    still = replace(found.run.states, tau=np.zeros_like(found.run.states.tau))
    changes = copy(found.changes)
    changes.run = replace(found.run, states=still)
    assert len(play.columns(changes, ())) == len(CROSSED)


@pytest.mark.parametrize(("times", "low", "high"), [(100.0, 0.9, 1.1), (0.06, 0.0, 0.2)])
def test_a_crossing_that_does_not_show_counts_in_the_gaps_uncertainty(known, problem, play, times, low, high):
    """Far below the crossing only the slope, gap over crossing, is told; beyond it the gap itself."""
    states = evaluate(known.point, known.unknowns, problem).run.states
    torque = times * float(np.sqrt(np.mean(states.tau[:, play.first] ** 2)))
    gap = 10.0 * GAP * max(times, 1.0)
    own = replace(play, effect=play.effect.model_copy(update={"turn_torque": torque, "gap": gap}))
    crossing = own.free[0].replace(".gap", ".turn_torque")
    own = replace(own, effect=own.effect.model_copy(update={"prior": {"turn_torque": torque}}))
    assert crossing in own.also
    last = evaluate(known.point.with_effect(own.effect), (*known.unknowns, *own.unknowns(())), problem)
    (value,) = values(SimpleNamespace(last=last, bent={}), own)
    assert value.value == gap
    assert low * gap < value.sigma <= high * gap
    assert value.sigma >= last.sigma(own.free[0])
    (alone,) = values(SimpleNamespace(last=last, bent={}), replace(own, also=()))
    assert alone.sigma == pytest.approx(last.sigma(own.free[0]))
    assert alone.sigma < 0.1 * gap


def test_a_fit_with_a_parameter_more_is_the_same_elsewhere(known, problem):
    last = evaluate(known.point, known.unknowns[:-1], problem)
    full = evaluate(known.point, known.unknowns, problem)
    wider = last.with_unfitted(known.unknowns[-1:])
    np.testing.assert_allclose(wider.covariance(), full.covariance(), rtol=1e-9)
