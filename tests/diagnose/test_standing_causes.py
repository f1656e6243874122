"""Which causes stand though something else is left, in words and by their own components."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from smsid.diagnose import _standing_causes as standing_causes
from smsid.diagnose._standing_causes import find_standing_causes
from smsid.diagnose.result import Alias, Diagnosis, FoundCause, Value
from smsid.diagnose.thresholds import DetectionThresholds
from smsid.diagnose.verdict import verdict

BIAS = "sensor", "imu.angular_rate"
DRAG = "friction", "joint2"
PANEL = "appendage", "panel"
REST, BENT = (SimpleNamespace(problem=SimpleNamespace(coloured=c)) for c in (False, True))


def told(family, location, value=1e-3, aliases=()):
    values = (Value("it.size", value, 1e-5, "1"),)
    return FoundCause("effect", location, family, "shape", values, aliases, {"likelihood_ratio": 90.0})


def cause(family, location):
    candidate = SimpleNamespace(
        family=family, location=location, free=("f.viscous",), also=(), key=location, effect=None
    )
    return SimpleNamespace(score=SimpleNamespace(candidate=candidate, sides=2))


@pytest.fixture
def stands(monkeypatch):
    """Return which of some causes stand, by their places, where another place is unknown and their Wald
    statistic there is given; told with their values in that fit, those at that place with the ones they had.
    ``followed`` is how much of the errors all of them take away, ``left`` what that of joint2 leaves,
    ``nothing`` where one may as well be none.
    """

    def judge(
        *named, unknown="panel", ratio=90.0, misfit=True, followed=0.8, left="", nothing="", quieter=None
    ):
        likeliest = REST if quieter is None else SimpleNamespace(problem=SimpleNamespace(coloured=True))
        found = SimpleNamespace(
            misfit=misfit, candidates=100, levels=DetectionThresholds(), followed=followed,
            causes=tuple(cause(c.family, c.location) for c in named), last=BENT, nominal=None, failed=(),
        )  # fmt: skip
        own = {c.location: replace(c, parameters=(Value("it.size", 2e-3, 1e-5, "1"),)) for c in named}
        for name, stub in {
            "_but_for_a_structure" if misfit else "_rest_unknown": lambda _: (
                REST,
                {f"equation of {unknown}": unknown},
            ),
            "chance_of_nothing": lambda fit, *_: chi2.sf(
                ratio if quieter is None or fit is not likeliest else quieter, 1
            ),
            "without_cause": lambda *_: None,
            "fit_noise_of_unknown_inputs": lambda rest: likeliest,
            "each_may_be_zero": lambda _, candidate: candidate.location == nothing,
            "own_component_left": lambda _, c: left if c.score.candidate.location == "joint2" else "",
            "replace": lambda found, **new: SimpleNamespace(**{**vars(found), **new}),
            "_stand_otherwise": lambda found, stand, lost, likeliest: stand,
            "with_profile_intervals": lambda asked: SimpleNamespace(bent=[*asked.causes], failed=()),
            "causes": lambda by: tuple(own[c.score.candidate.location] for c in by.causes),
        }.items():
            monkeypatch.setattr(standing_causes, name, stub)
        by, out = find_standing_causes(found, named)
        elsewhere = [o for o in out if o is not None and o.location != unknown]
        assert [unknown in note for note in by.failed] == [True] * bool(elsewhere)
        assert by.last is likeliest and len(by.causes) == len(elsewhere)
        assert by.bent == [*by.causes]  # of no others are profiles followed
        assert all(o.parameters[0].value == 2e-3 for o in elsewhere)
        return tuple(o is not None for o in out)

    return judge


@pytest.mark.parametrize("misfit", [True, False])
@pytest.mark.parametrize(
    ("ratio", "unknown", "expected"),
    [
        (90.0, "panel", (True, True, False)),
        (90.0, "joint2", (True, False, True)),
        (9.0, "panel", (False, False, False)),
        (90.0, "", (False, False, False)),  # what acts on the bus may be anything
    ],
)
def test_a_cause_stands_where_it_is_needed_with_the_rest_unknown(stands, misfit, ratio, unknown, expected):
    """Never at the place that is unknown, whatever its statistic."""
    named = [told(*BIAS), told(*DRAG), told(*PANEL)]
    assert stands(*named, unknown=unknown, ratio=ratio, misfit=misfit) == expected


@pytest.mark.parametrize(("quieter", "expected"), [(90.0, (True, True)), (9.0, (False, False))])
def test_a_cause_is_needed_with_what_its_size_is_told_by(stands, quieter, expected):
    """An encoder's bias of three standard deviations stood beside a random torque: with the noise that hides
    all of the torque it seemed to be needed.
    """
    assert stands(told(*BIAS), told(*DRAG), misfit=False, quieter=quieter) == expected


def test_what_may_as_well_be_nothing_does_not_stand(stands):
    """A mass of 0.02 +- 0.06 kg on a spring that is known well."""
    assert stands(told(*BIAS), told(*DRAG), nothing="joint2") == (True, False)


@pytest.mark.parametrize(("misfit", "ratio"), [(True, 90.0), (True, 9.0), (False, 90.0)])
def test_what_a_structure_lacks_stands_where_causes_take_most_of_its_misfit_away(stands, misfit, ratio):
    """A chain that softens under thrust, beside the modes that a beam has not."""
    (bias, panel) = stands(told(*BIAS), told(*PANEL), ratio=ratio, misfit=misfit, followed=0.95)
    assert bias is (ratio > 10.0) and panel is (misfit and ratio > 10.0)


def test_what_leaves_its_own_component_far_off_does_not_stand(stands):
    """A friction of another shape was off by 700 sigma; with misfit, that is counted in them."""
    assert stands(told(*BIAS), told(*DRAG), misfit=False, left="joint2 is left") == (True, False)
    assert stands(told(*BIAS), told(*DRAG), misfit=True, left="joint2 is left") == (True, True)


@pytest.mark.parametrize(
    ("one", "expected"),
    [
        (told(*DRAG), True),
        (told(*DRAG, value=float("nan")), False),
        (told(*DRAG, aliases=(Alias("e", "joint2", "friction", "other shape", 0.9, ""),)), True),
        (told(*DRAG, aliases=(Alias("e", "joint1", "friction", "shape", 0.9, ""),)), False),
    ],
)
def test_what_cannot_be_or_looks_like_something_elsewhere_does_not_stand(stands, one, expected):
    assert stands(one) == (expected,)


def test_nothing_stands_where_no_structure_is_all_that_is_left(monkeypatch):
    monkeypatch.setattr(standing_causes, "_but_for_a_structure", lambda _: None)
    found = SimpleNamespace(misfit=True)
    assert find_standing_causes(found, [told(*DRAG)]) == (found, (None,))


def test_the_sentence_and_the_file_say_what_stands_and_what_does_not():
    named = [told(*BIAS), told(*PANEL)]
    strays = SimpleNamespace(
        left=(), misfit=True, followed=0.8, noise={"panel.acceleration": 16.0}, causes=()
    )
    said, sentence = verdict(strays, named, named[:1], named[1:])
    assert said == "unexplained"
    stands, hint = sentence.split("What stands all the same: ")[1].split("Explaining a part: ")
    assert "imu.angular_rate" in stands and "panel" not in stands and "panel" in hint
    assert Diagnosis("sms", ("r",), said, sentence, causes=tuple(named[:1])).extends
    assert not Diagnosis("sms", ("r",), said, sentence, partial=tuple(named)).extends


def test_all_components_of_a_channel_are_taken_as_unknown_at_once(monkeypatch):
    """Four of a panel's accelerometers were left by a chain: one after the other they used up what may be
    unknown, and a lever arm known to 0.4 % was a hint.
    """
    tests = {"mode panel.mode3": "panel.mode3", "torque of joint3": "joint3"}
    tests |= {f"panel.acceleration[{k}.z]": f"panel.acceleration[{k}.z]" for k in range(4)}
    unknown = []

    def left(gone):
        return tuple(
            SimpleNamespace(where=w, location=at, ratio=9.0, freedom=1 + k, dependence="")
            for k, (w, at) in enumerate(tests.items())
            if w not in gone
        )

    def with_unknown(problem, *names, **_):
        unknown.append(set(names))
        return names

    run = SimpleNamespace(point=None, unknowns=None, problem=None, run=None)
    for name, stub in {
        "equations_of": lambda _: [],
        "with_unknown": with_unknown,
        "fit": lambda point, unknowns, problem, **_: problem,
        "adequacy": left,
        "replace": lambda found, *, last, blocks: SimpleNamespace(last=last, left=blocks),
    }.items():
        monkeypatch.setattr(standing_causes, name, stub)
    rest, lost = standing_causes._rest_unknown(SimpleNamespace(last=run, left=left(())))
    assert set(rest) == set(lost) == set(tests)
    assert [len(names) for names in unknown] == [1, 2, 6]


@pytest.mark.parametrize(
    ("low", "high", "offset", "nothing"),
    [(1e-9, np.inf, 0.2, True), (0.06, np.inf, 0.2, True), (1e-9, 0.3, 0.0, True), (0.02, 0.3, 0.2, False)],
)
def test_what_may_as_well_be_nothing_by_its_profile_does_not_stand(low, high, offset, nothing):
    """Another slosh mass of 0.1 kg (1e-9 to inf), 2.1 standard deviations off, stood beside a ripple,
    one of 0.06 kg to inf beside a torque that drifts with the temperature.
    """
    parameters = [SimpleNamespace(name=n, value=v) for n, v in (("more.mass", 1e-9), ("more.offset.x", 0.0))]
    effect = SimpleNamespace(parameters=lambda: parameters, strength=("mass",))
    candidate = SimpleNamespace(free=("more.mass", "more.offset.x"), effect=effect)
    values = (
        Value("more.mass", 0.1, 0.047, "kg", profile=(low, high)),
        Value("more.offset.x", offset, 0.1, "m"),
    )
    told = FoundCause("slosh", "bus", "slosh", "another slosh mass", values, (), {})
    assert standing_causes._is_of_no_size(candidate, told) is nothing
    assert not standing_causes._is_of_no_size(SimpleNamespace(effect=None), told)


@pytest.mark.parametrize(
    ("before", "followed", "likelier", "needed", "expected"),
    [
        ("joint3", True, 5.0, False, [False, False, False]),
        ("joint3", True, 5.0, True, [False, True, False]),  # a cause at joint3 is what is unknown there
        ("joint3", True, -5.0, False, [True, True, False]),  # they explain more than that it is unknown
        (
            "joint3",
            False,
            5.0,
            False,
            [True, True, False],
        ),  # something else is left then: it explains nothing
        ("joint2", True, 5.0, False, [True, True, False]),  # as is taken as unknown already
    ],
)
def test_what_is_not_needed_where_another_equation_is_unknown_does_not_stand(
    monkeypatch, before, followed, likelier, needed, expected
):
    """A random torque at joint3 was three causes there and in a tank, which left a little at joint2."""
    asked = []

    @dataclass(frozen=True)
    class Found:
        blocks: str
        before: str
        causes: tuple

    def rest(found, rounds):
        asked.append((found.blocks, rounds))
        return (REST, {f"torque of {before}": before}) if followed else None

    monkeypatch.setattr(standing_causes, "_rest_unknown", rest)
    monkeypatch.setattr(standing_causes, "_is_needed", lambda found, c, last: needed and last is REST)
    rival, likeliest = (
        SimpleNamespace(run=SimpleNamespace(samples=9, log_likelihood=x)) for x in (likelier, 0.0)
    )
    monkeypatch.setattr(standing_causes, "fit_noise_of_unknown_inputs", lambda last: rival)
    causes = tuple(cause(family, at) for family, at in (("friction", "joint3"), BIAS, DRAG))
    found = Found("after", "before", causes)
    unknown = {"torque of joint2": "joint2"}
    assert standing_causes._stand_otherwise(found, [True, True, False], unknown, likeliest) == expected
    assert asked == [("before", 1)]
