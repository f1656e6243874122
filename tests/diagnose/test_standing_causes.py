"""Which causes stand though something else is left, in words and by their own components."""

from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose import standing_causes
from smsid.diagnose.model_comparison import DetectionThresholds
from smsid.diagnose.result import Alias, Diagnosis, FoundCause, Value
from smsid.diagnose.standing_causes import own_components, standing
from smsid.diagnose.verdict import verdict

NAMES = (
    "imu.angular_rate[x]", "imu.angular_rate[y]", "encoder.joint_velocity[joint1]",
    "encoder.joint_velocity[joint2]", "panel.acceleration[1]",
)  # fmt: skip
BIAS = "sensor", "imu.angular_rate"
DRAG = "friction", "joint2"
PANEL = "appendage", "panel"


def told(family, location, value=1e-3, aliases=()):
    values = (Value("it.size", value, 1e-5, "1"),)
    return FoundCause("effect", location, family, "shape", values, aliases, {"likelihood_ratio": 90.0})


def cause(family, location):
    """What it explains is in the panel alone, whatever its place."""
    candidate = SimpleNamespace(family=family, location=location, key=("effect", location, "shape"))
    columns = np.zeros((4 * len(NAMES), 1))
    columns[4 :: len(NAMES)] = 1.0
    return SimpleNamespace(score=SimpleNamespace(candidate=candidate, columns=columns, estimate=np.ones(1)))


def search(*places, before, after):
    last = SimpleNamespace(
        problem=SimpleNamespace(data=SimpleNamespace(names=NAMES)),
        run=SimpleNamespace(innovations=np.zeros((4, len(NAMES)))),
    )
    causes = tuple(cause(*p) for p in places)
    return SimpleNamespace(misfit=True, causes=causes, strays=(np.array(before), np.array(after)), last=last)


@pytest.mark.parametrize(("place", "rows"), [(BIAS, [0, 1]), (DRAG, [3]), (PANEL, [4])])
def test_a_cause_shows_at_its_sensor_or_joint_else_where_it_explains_most(place, rows):
    found = search(place, before=np.ones(5), after=np.ones(5))
    assert list(np.flatnonzero(own_components(found, found.causes[0]))) == rows


@pytest.mark.parametrize(
    ("after", "stands"),
    [
        ([1.0, 1.5, 40.0, 1.2, 20.0], [True, True, False]),  # another joint is not its own
        ([1.0, 3.5, 1.0, 1.2, 20.0], [False, True, False]),  # above three times its noise
        ([1.0, 1.5, 1.0, 1.9, 1.0], [True, False, True]),  # a tenth of four is 1.26
    ],
)
def test_it_stands_where_its_own_components_are_explained(after, stands):
    found = search(BIAS, DRAG, PANEL, before=[1.0, 110.0, 40.0, 4.0, 21.0], after=after)
    named = [told(*p) for p in (BIAS, DRAG, PANEL)]
    assert standing(found, named) == (found, tuple(stands))


@pytest.mark.parametrize(
    ("one", "stands"),
    [
        (told(*DRAG), True),
        (told(*DRAG, value=float("nan")), False),
        (told(*DRAG, aliases=(Alias("e", "joint2", "friction", "other shape", 0.9, ""),)), True),
        (told(*DRAG, aliases=(Alias("e", "joint1", "friction", "shape", 0.9, ""),)), False),
    ],
)
def test_what_cannot_be_or_looks_like_something_elsewhere_does_not_stand(one, stands):
    found = search(DRAG, before=np.full(5, 40.0), after=np.ones(5))
    assert standing(found, [one])[1] == (stands,)


def test_without_misfit_it_is_needed_where_the_rest_is_unknown(monkeypatch):
    """Never at the equation that is left, whatever its statistic."""
    found = search(DRAG, before=np.ones(5), after=np.ones(5))
    found.misfit, found.candidates = False, 100
    found.causes[0].score.sides, found.causes[0].score.candidate.free = 2, ("f.viscous",)
    point = SimpleNamespace(value=lambda u: 1.0)
    unknown = SimpleNamespace(name="f.viscous")
    rest = SimpleNamespace(unknowns=(unknown,), point=point, covariance=lambda: np.eye(1))
    found.levels = DetectionThresholds()
    monkeypatch.setattr(standing_causes, "replace", lambda found, last: last)
    for ratio, place, stands in (
        (90.0, "joint1", True),
        (9.0, "joint1", False),
        (90.0, "joint2", False),
        (90.0, "", False),  # the bus
    ):
        monkeypatch.setattr(standing_causes, "_rest_unknown", lambda found, at=place: (rest, {"it": at}))
        monkeypatch.setattr(standing_causes, "wald", lambda *_, ratio=ratio: ratio)
        assert standing(found, [told(*DRAG)]) == (rest, (stands,))


def test_the_sentence_and_the_file_say_what_stands_and_what_does_not():
    named = [told(*BIAS), told(*PANEL)]
    strays = SimpleNamespace(left=(), misfit=True, followed=0.8, noise={"panel.acceleration": 16.0})
    said, sentence = verdict(strays, named, named[:1], named[1:])
    assert said == "unexplained"
    stands, hint = sentence.split("What stands all the same: ")[1].split("Explaining a part: ")
    assert "imu.angular_rate" in stands and "panel" not in stands and "panel" in hint
    assert Diagnosis("sms", ("r",), said, sentence, causes=tuple(named[:1])).extends
    assert not Diagnosis("sms", ("r",), said, sentence, partial=tuple(named)).extends
