"""What is in one of several recordings alone is named with the recording; what is in all of them is not."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.diagnose import diagnose
from smsid.effects import Payload, SensorBias
from smsid.estimation.joint_problem import at_point, joint_problem, on_one_clock, samples_in
from smsid.estimation.kalman import KalmanFilter, run_filter
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.measurements import measurements_of
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise, recordings_of
from smsid.experiments import fly, named_experiment
from smsid.model import build_model

HELD = Payload(name="held", frame="tool", mass=2.0)
BIASED = SensorBias(name="off", sensor="encoder", quantity="joint_velocity", component="joint2", bias=4e-3)


@pytest.fixture(scope="module")
def flown(description):
    def fly_it(seed, *effects):
        model = build_model(description.with_effects(*effects))
        plan = named_experiment("exp2", build_model(description)).model_copy(update={"duration": 4.0})
        return fly(model, plan, np.random.default_rng(seed)).recording.with_name(f"flight{seed}")

    return fly_it


@pytest.fixture(scope="module")
def joined(flown, description):
    """Two flights of four seconds, a body held in the second, as one problem."""
    point, labels = Point.of(description), ("a", "b")
    sensors = description.effective_sensors()
    placed = on_one_clock([flown(1), flown(2, HELD)], labels)
    none = np.array([], dtype=int)
    alone = [
        Problem(
            p.recording,
            measurements_of(point.base, p.recording, sensors),
            none,
            CommandTiming("linear"),
            ProcessNoise(),
        )
        for p in placed
    ]
    return point, joint_problem(alone, placed)


def test_the_likelihood_is_that_of_each_recording_with_its_own_model(joined):
    point, problem = joined
    there = point.with_effect(HELD, "b")
    found = run_filter(there.model(), at_point(there, problem)).log_likelihood
    models = point.model(), point.with_effect(HELD).model()
    each = [
        KalmanFilter(m, p).advance(len(p.data.times)).log_likelihood
        for m, p in zip(models, recordings_of(problem), strict=True)
    ]
    assert found == pytest.approx(sum(each), rel=1e-12)


def test_a_derivative_is_that_of_the_likelihood_and_of_one_recording(joined):
    point, problem = joined
    there = point.with_effect(HELD, "b")
    mass = Unknown("held.mass", "effect", "kg", HELD.mass, np.inf, 0.01, lower=0.0)
    found = evaluate(there, [mass], problem)
    outside = ~samples_in(problem, "b")
    assert not found.whitened[outside].any() and found.whitened.any()
    near = [evaluate(there.moved([mass], np.array([d])), [mass], problem).objective for d in (-0.01, 0.01)]
    assert -0.5 * (near[1] - near[0]) == pytest.approx(found.slope[0], rel=0.05)


def test_an_effect_put_back_acts_in_all(joined):
    point, _ = joined
    there = point.with_effect(HELD, "b")
    assert there.with_effect(HELD.model_copy(update={"mass": 1.0})).within == {"held": "b"}
    assert [e.name for e in there.seen_in("a").description.effect] == [
        e.name for e in point.description.effect
    ]
    less = there.seen_in("a")
    assert not less.with_effect(HELD).within


@pytest.mark.parametrize(
    "hidden", [HELD, pytest.param(BIASED, marks=pytest.mark.slow)], ids=["grasped", "bias"]
)
def test_what_is_in_the_second_alone_is_named_with_it(description, flown, hidden):
    found = diagnose(description, [flown(1), flown(2, hidden)], rate=12.5).diagnosis
    assert found.verdict == "explained", found.sentence
    (cause,) = found.causes
    assert cause.effect == hidden.kind and cause.recording == "flight2" and cause.onset is None
    assert "in 'flight2' alone" in found.sentence
    value = cause.parameters[0]
    truth = next(p.value for p in hidden.parameters())
    assert abs(value.value - truth) < 3.0 * value.sigma


def test_what_is_in_both_is_in_no_recording_alone(description, flown):
    found = diagnose(description, [flown(1, BIASED), flown(2, BIASED)], rate=12.5).diagnosis
    (cause,) = found.causes
    assert (cause.effect, cause.recording) == ("sensor_bias", ""), found.sentence
