"""Causes beyond those of the studies, each hidden in a MuJoCo world: named, with the values they have."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.description import load_description
from smsid.diagnose import diagnose
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.model_comparison import simplest_law
from smsid.diagnose.priors import nominal
from smsid.diagnose.score_test import score_candidates, signatures
from smsid.diagnose.thresholds import DetectionThresholds
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise
from tests.estimation.effect_cases import by_name, fly
from tests.hidden.description import write_description
from tests.hidden.experiment import commands
from tests.hidden.flight import recording
from tests.hidden.numbers import WORLDS

NAMED = {
    "joint_friction stiction wheel_z": ("wheel_z", "stiction"),
    "scale_by_rate": ("tachometer.wheel_rate[wheel_x]", "scale by rate"),
    "slosh_wall": ("tank", "wall"),
    "joint_cable": ("joint2", "cable"),
}


@pytest.mark.parametrize(
    "name", [n for n in NAMED if n != "slosh_wall"]
)  # which is as a cubic spring at first
def test_it_scores_best(name, tmp_path):
    """All else as described: the first score alone, without a refit, is that of what is hidden."""
    case, (location, shape) = by_name()[name], NAMED[name]
    world, rng = WORLDS[case.world], np.random.default_rng(0)
    made = recording(world, commands(case.world, 0, 20.0), rng, [case.change(1.0)], name=name)
    known = nominal(load_description(write_description(world, tmp_path)), None)
    point = known.point
    data = measurements_of(point.base, made, point.description.effective_sensors())
    problem = Problem(made, data, np.array([], dtype=int), CommandTiming("held", "left"), ProcessNoise())
    found = evaluate(point, known.unknowns, problem)
    every = propose(point, problem, known.unknowns)
    columns = signatures(found, every)
    scores = score_candidates(found, [every[i] for i in columns], list(columns.values()))
    samples = found.run.samples
    scores.sort(key=lambda s: -s.odds(samples))
    best = simplest_law(scores[0], scores, samples, DetectionThresholds()).candidate
    told = [(s.candidate.key, round(s.odds(samples), 1)) for s in scores[:4]]
    assert (best.kind, best.location, best.shape) == (case.kind, location, shape), told


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMED)
def test_it_is_named(name, tmp_path):
    case, (location, shape) = by_name()[name], NAMED[name]
    flight = fly(case, 0, tmp_path)
    kept = tuple(e for e in flight.description.effect if e.name != "cause")
    found = diagnose(flight.description.model_copy(update={"effect": kept}), [flight.recording]).diagnosis
    assert found.verdict == "explained", found.sentence
    (cause,) = found.causes
    assert (cause.effect, cause.location, cause.fitted) == (case.kind, location, shape), found.sentence
    first = cause.parameters[0]
    truth = case.truth[first.name.partition(".")[2]]
    assert abs(first.value - truth) < max(4.0 * first.sigma, 0.02 * truth), (first.value, first.sigma)
    assert np.isfinite(first.sigma) and first.sigma < 0.3 * truth
