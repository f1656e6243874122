"""Strong causes beside a model that may err."""

import numpy as np
import pytest

from smsid.diagnose._strong_causes import coarse_cause
from smsid.diagnose.hypotheses import propose
from smsid.effects import ExternalWrench
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise
from smsid.experiments import fly, named_experiment
from smsid.model import build_model


@pytest.mark.parametrize(
    ("what", "pushes"),
    [
        ("torque", (-7.0, 4.0, 3.0)),
        pytest.param("force", (9.0, 0.0, -12.0), marks=pytest.mark.slow),
    ],
)
def test_a_strong_force_from_outside_needs_no_stated_size(description, known, what, pushes):
    """A torque of 2.5 N m that turned a craft over ended as the recording of another spacecraft."""
    effects = (*description.effect, ExternalWrench(name="outside", **{what: pushes}))
    pushed = build_model(description.model_copy(update={"effect": effects}))
    plan = named_experiment("exp2", build_model(description)).model_copy(update={"duration": 5.0})
    recording = fly(pushed, plan, np.random.default_rng(2)).recording
    data = measurements_of(known.point.base, recording, known.point.description.effective_sensors()).thinned(
        25.0
    )
    problem = Problem(
        recording, data, np.array([], dtype=int), CommandTiming("linear", "right"), ProcessNoise()
    )
    kinds = ("external_wrench", "payload", "torque_gain")
    candidates = [c for c in propose(known.point, problem, known.unknowns) if c.kind in kinds]
    found = coarse_cause(known.point, problem, known.unknowns, candidates)
    assert found is not None
    (cause,) = found.causes
    assert cause.score.candidate.kind == "external_wrench", cause.score.candidate.key
    assert cause.score.candidate.shape.startswith(what)
    at = found.fit.point
    sizes = [at.value(u) for u in found.fit.unknowns if u.name in cause.score.candidate.free]
    np.testing.assert_allclose(sizes, pushes, rtol=0.02, atol=0.1)
