"""Causes that others made unnecessary are left out; those that are missed stay."""

from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose import stepwise
from smsid.diagnose._exchange_step import eliminate_backward
from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.score_test import Candidate, Score
from smsid.diagnose.specification_tests import SpecificationTest
from smsid.diagnose.thresholds import DetectionThresholds
from smsid.errors import SimulationError


def cause(location):
    """A cause without columns."""
    own = Candidate("joint_friction", location, "friction", "viscous", None, ("friction.viscous",), (1.0,))
    nothing = np.zeros((0, 1))
    return Cause(Score(own, 50.0, 1, nothing[0:0], nothing, 1.0, nothing, nothing), (), 50.0)


def fitted(objective):
    return SimpleNamespace(
        unknowns=(), point=None, problem=SimpleNamespace(coloured=False), objective=objective
    )


def left(
    monkeypatch,
    held,
    rest,
    whole=0.1,
    alone=0.1,
    proven=(),
    zero=False,
    absurd="",
    beside=("joint2",),
    recheck=(),
):
    """Where the causes are that stay of two, of which the first's strength has a statistic ``alone``.

    ``whole`` is that of all its parameters, ``held`` that with its further parameters held, ``rest`` the
    objective of the fit without it, ``None`` where there is none; with it, it is zero. ``zero``: the interval
    of each of its strengths holds nothing. The one ``absurd`` has a value that cannot be. The second is
    ``beside`` it, if at all.
    """

    by_itself = held

    def wald(found, candidate, *, held=False, strength=False):
        return 50.0 if candidate.location == "joint2" else by_itself if held else alone if strength else whole

    def refitted(point, unknowns, problem, **options):
        if rest is None:
            raise SimulationError("lost")
        return fitted(rest)

    for module in ("_exchange_step", "_wald_test"):
        monkeypatch.setattr(f"smsid.diagnose.{module}.wald", wald)
    monkeypatch.setattr(
        "smsid.diagnose._exchange_step.each_may_be_zero", lambda _, c: zero and c.location == "joint1"
    )
    monkeypatch.setattr(
        "smsid.diagnose._exchange_step.impossible_fit",
        lambda _, c: "cannot be" if c.location == absurd else "",
    )
    monkeypatch.setattr("smsid.diagnose._exchange_step.without_cause", lambda found, *_: found)
    monkeypatch.setattr("smsid.diagnose._exchange_step.fit", refitted)
    kept, _ = eliminate_backward(
        [cause(x) for x in ("joint1", *beside)], fitted(0.0), fitted(1e6), DetectionThresholds(), 60, proven,
        recheck,
    )  # fmt: skip
    return [c.score.candidate.location for c in kept]


def test_one_without_which_the_recording_is_lost_stays(monkeypatch):
    assert left(monkeypatch, held=0.1, rest=0.0) == ["joint2"]
    assert left(monkeypatch, held=0.1, rest=None) == ["joint1", "joint2"]


def test_one_whose_strength_goes_with_what_it_freed_stays_where_it_is_missed(monkeypatch):
    """The gap of a backlash and the torque of its crossing: only their product is known well."""
    assert left(monkeypatch, held=1000.0, rest=3900.0) == ["joint1", "joint2"]
    assert left(monkeypatch, held=0.1, rest=3900.0) == ["joint2"], "it ran away"
    assert left(monkeypatch, held=1000.0, rest=4.0) == ["joint2"], "nothing is missed"


def test_a_mass_that_may_be_none_stays_where_it_is_missed(monkeypatch):
    """However well the frequency is told of a mass that is as small as it is uncertain."""
    assert left(monkeypatch, held=50.0, rest=4.0, whole=50.0) == ["joint2"]
    assert left(monkeypatch, held=50.0, rest=3900.0, whole=50.0) == ["joint1", "joint2"]


def test_what_was_proven_beside_an_unknown_structure_stays_unless_it_may_be_nothing(monkeypatch):
    """A delay of 47 +- 50 microseconds stayed beside a payload that it has nothing to do with."""
    first = cause("joint1").score.candidate.key
    eight, one = (dict.fromkeys(("held", "rest", "whole", "alone"), x) for x in (8.0, 0.9))
    assert left(monkeypatch, **eight) == ["joint2"]
    assert left(monkeypatch, **eight, proven={first}) == ["joint1", "joint2"]
    assert left(monkeypatch, **one, proven={first}) == ["joint2"]


def test_one_whose_parameters_may_each_be_zero_stays_only_where_it_is_missed(monkeypatch):
    """An inertia of 2e8 +- 3e9 kg m^2 was named: of all six together something was told, of none alone."""
    told = dict.fromkeys(("held", "whole", "alone"), 1000.0)
    assert left(monkeypatch, **told, rest=0.0) == ["joint1", "joint2"]
    assert left(monkeypatch, **told, rest=0.0, zero=True) == ["joint2"]
    assert left(monkeypatch, **told, rest=3900.0, zero=True) == ["joint1", "joint2"]


def test_one_chosen_beside_what_has_given_way_stays_only_where_it_is_missed(monkeypatch):
    """A link's centre of mass, 9 standard deviations off, went on making up for what its inertia lacked when
    a payload had come in the place of that.
    """
    told = dict.fromkeys(("held", "whole", "alone"), 1000.0)
    first = {cause("joint1").score.candidate.key}
    assert left(monkeypatch, **told, rest=2.0) == ["joint1", "joint2"]
    assert left(monkeypatch, **told, rest=2.0, recheck=first) == ["joint2"]
    assert left(monkeypatch, **told, rest=3900.0, recheck=first) == ["joint1", "joint2"]


def test_one_with_a_value_that_cannot_be_goes_first_and_missed_or_not(monkeypatch):
    """A gyro's scale of -0.98 was the last of three causes, and what it had bent was left out before it."""
    doubtful = dict.fromkeys(("held", "whole", "alone"), 9.0)  # but the last one stays
    assert left(monkeypatch, **doubtful, rest=3900.0, absurd="joint2") == ["joint1"]
    sure = dict.fromkeys(("held", "whole", "alone"), 1000.0)
    assert left(monkeypatch, **sure, rest=3900.0, absurd="joint1") == ["joint2"]
    assert left(monkeypatch, **sure, rest=3900.0) == ["joint1", "joint2"]


@pytest.mark.parametrize("misfit", [True, False])
@pytest.mark.parametrize("ratio", [0.0, 900.0])
def test_a_needless_cause_is_left_out_whatever_else_is_left(monkeypatch, misfit, ratio):
    """It stood in the way of those that are needed: with it, nothing was believed."""
    state = SimpleNamespace(
        held=(),
        current="both",
        fitted=SimpleNamespace(misfit=misfit),
        causes=[],
        levels=DetectionThresholds(),
        least_listed={},
    )

    def prune():
        state.current = "one"
        return True

    state.prune, state.guarded = prune, lambda what, step: step()
    state.let_law_err = state.set_in_motion = lambda left: False
    monkeypatch.setattr(
        stepwise, "adequacy", lambda fit: (SpecificationTest(f"torque of {fit}", "angle", ratio, 4),)
    )
    monkeypatch.setattr(stepwise, "with_further", lambda *_: None)
    (test,) = stepwise._apply_generic_tests(state, frozenset())
    assert test.where == "torque of one"
