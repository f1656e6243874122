"""Strong causes beside a model that may err."""

from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose import strong_causes
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.strong_causes import coarse_cause
from smsid.effects import ExternalWrench
from smsid.errors import SimulationError
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


@pytest.mark.parametrize(
    ("follow", "tried"),
    [
        ("ABCDEF", "AC"),  # what is far behind is not tried, another law of the best one's effect is
        ("CDEF", "ABC"),
        ("EF", "ABCDE"),  # of an encoder's bias, fifth, the first three of six did not follow
        ("", "ABCDEF"),
    ],
)
def test_which_strong_causes_are_fitted(monkeypatch, follow, tried):
    """By their worth where each is likeliest; laws of one effect differ by where they were begun."""
    worth = {"A": 100.0, "B": 70.0, "C": 60.0, "D": 50.0, "E": 40.0, "F": 30.0}
    every = [
        SimpleNamespace(name=n, key=("friction", "joint2", n) if n in "AC" else ("gain", f"joint {n}", n))
        for n in worth
    ]
    asked = []

    def fitted(candidate, *_):
        asked.append(candidate.name)
        fit = SimpleNamespace(objective=-worth[candidate.name], name=candidate.name)
        return (fit, ()) if candidate.name in follow else None

    for name, stub in {
        "thin_problem": lambda problem, rate: problem,
        "replace": lambda x, **_: x,
        "_starts": lambda point, candidates, _: [(c, c) for c in candidates],
        "_linear_starts": lambda *_: [],
        "_likelihood": lambda at, _: worth.get(getattr(at, "name", ""), 0.0),
        "_as_likely_as_can_be": lambda at, c, _, likely: (likely, at),
        "_fit_with_less_process_noise": fitted,
        "evaluate": lambda *_: (_ for _ in ()).throw(SimulationError("enough")),
        "loosen_model": lambda *_: None,
    }.items():
        monkeypatch.setattr(strong_causes, name, stub)
    point = SimpleNamespace(model=lambda: None)
    assert coarse_cause(point, SimpleNamespace(parts=()), (), every) is None
    assert "".join(asked) == tried
