"""A strong cause beside a structure that does not move as described: neither is followed by itself."""

from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from smsid.diagnose import stepwise
from smsid.diagnose._strong_causes import Coarse
from smsid.diagnose._unknown_input import CHANCE
from smsid.diagnose.specification_tests import SpecificationTest
from smsid.diagnose.thresholds import DetectionThresholds
from smsid.errors import RecordingError, SimulationError

PAYLOAD, SCALE = (SimpleNamespace(location=place) for place in ("tool", "panel.acceleration"))


@pytest.fixture
def asked(monkeypatch):
    """What strong causes were sought in, and among which candidates; the whole is not followed with any."""
    asked = SimpleNamespace(seen=[], follows="without panel", alone="", refined=[], lost=(), erring=None)
    fit = SimpleNamespace(run=None, point=None, stretch=0.0, objective=0.0)

    def coarse(point, problem, unknowns, candidates):
        asked.seen.append((problem.name, list(candidates)))
        return Coarse("nominal", fit, "cause") if problem.name in asked.follows else None

    def unknown(found, problem):
        for place in ("tank", "panel"):
            yield place, SimpleNamespace(name=f"without {place}", data=problem.data)

    def levels(found, *_):
        asked.fitted = found
        if found.unknown in asked.lost:
            raise np.linalg.LinAlgError("singular")
        return found

    for name, stub in {
        "first_fit": lambda *_: SimpleNamespace(fit=fit, misfit=True, alone=False, by_channel={}, unknown=""),
        "normalised_rmse": lambda *_: 1e3,
        "_is_local": lambda _: False,
        "unexplained_fraction": lambda *_: 2.0 - bool(asked.alone) * 1.5,
        "_follows": lambda point, unknowns, problem: problem.name == asked.alone,
        "coarse_cause": coarse,
        "erring_fit": lambda *_: asked.erring,
        "unknown_structures": unknown,
        "with_levels": levels,
        "refine_steps": lambda fit: asked.refined.append(fit) or fit,
        "SearchState": lambda fitted, candidates, *_, **known: (fitted.unknown, candidates, known),
    }.items():
        monkeypatch.setattr(stepwise, name, stub)
    return asked


def begun():
    data, recording = SimpleNamespace(rows=1), SimpleNamespace(name="recording")
    problem = SimpleNamespace(name="whole", data=data, recording=recording)
    return stepwise._initial_state(SimpleNamespace(), problem, (), [PAYLOAD, SCALE], DetectionThresholds())


def test_a_strong_cause_that_cannot_be_gone_on_from_is_lost_alone(asked):
    """Its scores failed numerically, and the recording was not evaluated."""
    asked.follows, asked.lost = "without tank without panel", ("tank",)
    unknown, *_ = begun()
    assert unknown == "panel" and [name for name, _ in asked.seen][1:] == ["without tank", "without panel"]


def test_a_strong_cause_is_followed_in_steps_that_its_motion_needs(asked):
    """Friction of 40 N m that turned over was off by 1300 in chi-squared, and outliers were made of that."""
    begun()
    assert len(asked.refined) == 1


def test_what_nothing_follows_is_tried_with_each_structure_unknown(asked):
    """A payload of 10 kg in the craft whose panel is a chain: a scale of the panel's sensor led, in vain."""
    unknown, candidates, known = begun()
    assert unknown == "panel" and candidates == [PAYLOAD, SCALE]
    assert known == {"known": "cause", "nominal": "nominal"}
    assert [name for name, _ in asked.seen] == ["whole", "without tank", "without panel"]
    assert asked.seen[0][1] == [PAYLOAD, SCALE] and asked.seen[2][1] == [PAYLOAD]
    np.testing.assert_array_equal(asked.fitted.factors, [1.0])


def test_what_is_not_followed_with_any_structure_unknown_is_refused(asked):
    asked.follows = "nothing"
    with pytest.raises(RecordingError, match="worse than no motion"):
        begun()
    assert len(asked.seen) == 3
    asked.erring = SimpleNamespace(unknown="erring")
    unknown, _, known = begun()  # by a model that errs it is searched, and refused if that finds nothing
    assert unknown == "erring" and "worse than no motion" in str(known["lost"])


def test_no_strong_cause_is_sought_beside_a_structure_without_which_all_is_followed(asked):
    """A thruster's gain: with the panel unknown, a link's mass was taken for it; counted misfit names it."""
    asked.alone = "without panel"
    unknown, candidates, known = begun()
    assert [name for name, _ in asked.seen] == ["whole", "without tank"] and not (unknown or known)
    assert candidates == [PAYLOAD, SCALE]


def test_what_is_needless_goes_before_a_structure_is_taken_in_again(monkeypatch):
    """A delay of nothing stayed beside a payload: what was proven is not judged where misfit counts."""
    steps = []

    class Searching:
        lost = None
        fitted = SimpleNamespace(unknown="panel", misfit=True, alone=False, by_channel={}, factors=np.ones(1))
        causes, held, scores, failed, samples, normalised_rmse = (), (), (), (), 1, 1.0
        current = nominal = SimpleNamespace(run=None)
        one_unknown = None

        def guarded(self, what, step):
            return bool(step())

        def __getattr__(self, name):
            return lambda *_: steps.append(name) or name == "restore"

    begun = {"_initial_state": Searching(), "adequacy": [], "band_tests": [], "normalised_rmse": 1.0}
    for name, value in begun.items():
        monkeypatch.setattr(stepwise, name, lambda *_, value=value: value)
    stepwise.search(SimpleNamespace(), SimpleNamespace(), (), ())
    asked = [step for step in steps if step != "forget_columns"]
    look = ["forward_step", "close", "go_on", "prune"]
    assert asked == [*look, "restore", *look]


@pytest.mark.parametrize(
    ("left", "stretch", "objective", "taken"),
    [(1.5, 100.0, -1.0, True), (1.5, 100.0, 1.0, False), (1.5, 20.0, -1.0, False), (1.0, 100.0, -1.0, False)],
)
def test_what_is_followed_by_bodies_that_nobody_believes_may_be_a_strong_cause(
    asked, monkeypatch, left, stretch, objective, taken
):
    """Where it is likelier, and noise is not all that is left: a mass that is off is no fit to be doubted."""
    bent = SimpleNamespace(run=None, point=None, stretch=stretch, objective=0.0)
    strong = SimpleNamespace(run=None, point=None, stretch=0.0, objective=objective)
    nominal = SimpleNamespace(fit=bent, misfit=False, alone=False, by_channel={}, unknown="")
    monkeypatch.setattr(stepwise, "first_fit", lambda *_: nominal)
    monkeypatch.setattr(stepwise, "replace", lambda x, **changes: x)
    monkeypatch.setattr(stepwise, "continue_fit", lambda fit, **_: fit)
    monkeypatch.setattr(stepwise, "normalised_rmse", lambda *_: left)
    monkeypatch.setattr(stepwise, "unknown_structures", lambda *_: ())
    monkeypatch.setattr(stepwise, "coarse_cause", lambda *_: Coarse("nominal", strong, "cause"))
    _, _, known = begun()
    assert known == ({"known": "cause", "nominal": "nominal"} if taken else {})


@pytest.mark.parametrize("follows", [True, False])
def test_what_is_lost_is_searched_as_a_model_that_may_err(asked, monkeypatch, follows):
    """Without an encoder's bias of 0.7 rad the filter lost an arm, and nothing was evaluated."""
    error, noise = SimulationError("lost"), object()
    erring = SimpleNamespace(unknown="", misfit=True, alone=False, by_channel={}, factors=np.ones(1))
    erring.strict = noise

    def lose(*_):
        raise error

    asked.follows = "nothing"
    stubs = {"first_fit": lose, "but_for_one": lambda *_: None, "erring_fit": lambda *_: erring}
    stubs["SearchState"] = lambda fitted, *_, **known: (fitted, known)
    for name, stub in stubs.items():
        monkeypatch.setattr(stepwise, name, stub)
    assert begun() == (erring, {"lost": error})

    class Searching:
        lost, fitted = error, erring
        causes, held, scores, failed, samples, normalised_rmse = (), (), (), (), 1, 1.0
        current = nominal = SimpleNamespace(run=None)
        one_unknown = None

        def guarded(self, what, step):
            erring.strict = None if follows else noise
            return False

        def __getattr__(self, name):
            return lambda *_: False

    begins = {"_initial_state": Searching(), "adequacy": [], "band_tests": [], "normalised_rmse": 1.0}
    for name, value in begins.items():
        monkeypatch.setattr(stepwise, name, lambda *_, value=value: value)
    if follows:
        assert stepwise.search(SimpleNamespace(), SimpleNamespace(), (), ()).last is Searching.current
        return
    with pytest.raises(SimulationError, match="lost"):
        stepwise.search(SimpleNamespace(), SimpleNamespace(), (), ())


def test_with_one_unknown_torque_its_test_is_told_and_no_cause_is_judged_further(monkeypatch):
    """Nor is a further parameter freed, or a law let err, of causes that are parts of something else."""
    steps, others = [], [SpecificationTest("torque of joint1", "rate", 40.0, 3, location="joint1")]
    test = SpecificationTest("torque of joint2", CHANCE, 900.0, 1, location="joint2")

    class Searching:
        lost = None
        fitted = SimpleNamespace(unknown="", misfit=False, alone=False, by_channel={}, factors=np.ones(1))
        causes, held, scores, failed, samples, normalised_rmse = (), (), (), (), 1, 1.0
        current = nominal = SimpleNamespace(run=None)
        one_unknown = SimpleNamespace(test=test)
        least_listed: ClassVar = {}

        def guarded(self, what, step):
            return bool(step())

        def __getattr__(self, name):
            return lambda *_: steps.append(name)

    begun = {"_initial_state": Searching(), "adequacy": others, "band_tests": [], "normalised_rmse": 1.0}
    for name, value in begun.items():
        monkeypatch.setattr(stepwise, name, lambda *_, value=value: value)
    found = stepwise.search(SimpleNamespace(), SimpleNamespace(), (), ())
    assert [step for step in steps if step != "forget_columns"] == ["forward_step", "close", "go_on"]
    assert found.one_unknown and found.blocks == (test, *others)
    assert found.left_before[0] is test and found.left[0] is test
