"""All recordings are searched together: what each is too weak to tell, and what only one of them has."""

import numpy as np
import pytest

from smsid.diagnose.hypotheses import propose
from smsid.diagnose.priors import nominal
from smsid.diagnose.stepwise import search
from smsid.diagnose.verdict import causes
from smsid.effects import JointFriction
from smsid.estimation.joint_problem import joint_problem, on_one_clock, thin_problem
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise, recordings_of
from smsid.experiments import fly, named_experiment
from smsid.model import build_model

WEAK = 0.19  # [N m s/rad]: three standard deviations of one recording
LAWS = ("viscous", "coulomb")


@pytest.fixture(scope="module")
def flown(description):
    def fly_it(viscous, seed):
        seal = JointFriction(name="seal", joint="joint2", viscous=viscous)
        model = build_model(description.with_effects(seal))
        plan = named_experiment("exp2", build_model(description)).model_copy(update={"duration": 4.0})
        return fly(model, plan, np.random.default_rng(seed)).recording

    return fly_it


@pytest.fixture(scope="module")
def searched(description):
    def search_them(*recordings):
        labels = "abc"[: len(recordings)]
        known = nominal(description, None, labels[1:])
        sensors, base = known.point.description.effective_sensors(), known.point.base
        placed = on_one_clock(recordings, labels)
        none = np.array([], dtype=int)
        alone = [
            Problem(
                p.recording, measurements_of(base, p.recording, sensors), none, CommandTiming("linear"),
                ProcessNoise(), known.joint,
            )
            for p in placed
        ]  # fmt: skip
        problem = thin_problem(joint_problem(alone, placed), 25.0)
        every = propose(known.point, problem, known.unknowns)
        laws = [c for c in every if c.kind == "joint_friction" and c.location == "joint2"]
        laws = [c for c in laws if c.shape in LAWS]
        assert len(laws) == len(LAWS)
        return search(known.point, problem, known.unknowns, laws)

    return search_them


@pytest.fixture(scope="module")
def weak(flown):
    return flown(WEAK, 1), flown(WEAK, 3)


def test_two_weak_recordings_name_together_what_neither_does(searched, weak):
    assert all(not searched(r).causes for r in weak)
    found = searched(*weak)
    (cause,) = found.causes
    assert cause.score.candidate.location == "joint2"
    # log-likelihoods of the two by themselves, filtered one by one, add up
    point, problem = found.last.changes.point, found.last.changes.problem
    sums = []
    for own in recordings_of(problem):
        assert own.parts == ()
        run = KalmanFilter(point.model(), own).advance(len(own.data.times))
        sums.append(run.log_likelihood)
    whole = found.last.changes.run.log_likelihood
    assert whole == pytest.approx(sum(sums), rel=1e-12)
    told = causes(found)[0]
    assert any(abs(p.value - WEAK) < 3.0 * p.sigma for p in told.parameters if p.name.endswith(".viscous"))
