"""How far the parameters of a candidate are from doing nothing, at a fit."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose._added_oscillator import LEAST, STEP
from smsid.diagnose._profiled_hypothesis import ResolvedHypothesis
from smsid.diagnose._wald_test import wald
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.model_comparison import refit
from smsid.diagnose.score_test import Candidate, score_candidates, signatures
from smsid.effects import Slosh
from smsid.estimation.map_estimate import fit

WHITE = SimpleNamespace(coloured=False)  # a problem whose levels count no misfit


def test_how_far_from_doing_nothing(known, problem):
    """How far from it a parameter is, in its standard deviations; linear ones as the score says."""
    current = fit(known.point, known.unknowns[:1], problem)
    candidates = propose(known.point, problem, known.unknowns[:1])
    one = next(c for c in candidates if c.key == ("joint_friction", "joint2", "viscous"))
    (own,) = score_candidates(current, [one], list(signatures(current, [one]).values()))
    found = refit(current, own)
    assert wald(found, one) == pytest.approx(own.ratio, rel=0.2, abs=0.5)
    at = [u.name for u in found.unknowns].index(one.free[0])
    flat = replace(found, gram=np.array(found.gram))  # the same where hardly anything tells the parameter
    flat.gram[at] *= 1e-3
    flat.gram[:, at] *= 1e-3
    assert wald(flat, one) < 1e-4 * wald(found, one) + 1e-9


@pytest.mark.parametrize(("mass", "there"), [(LEAST, False), (0.2, True)])
def test_a_spring_without_a_mass_is_no_cause(known, mass, there):
    """Its mass went where it does nothing: how well its spring is known then says nothing."""
    tank = Slosh(name="more", position=(0.0,) * 3, mass=LEAST, stiffness=(1.0,) * 3, damping=(0.0,) * 3)
    names, steps = ("more.mass", "more.stiffness.x"), (STEP, 0.01)
    candidate = ResolvedHypothesis("slosh", "bus", "slosh", "another slosh mass", tank, names, steps)
    fitted = tank.with_values({"more.mass": mass + 1e-17, "more.stiffness.x": 3.0})
    found = SimpleNamespace(
        unknowns=candidate.unknowns(()),
        point=known.point.with_effect(fitted),
        covariance=lambda held, white: np.diag([1e-2, 1e-6]),
        problem=WHITE,
    )
    assert (wald(found, candidate) > 1e6) is there
    assert wald(found, candidate, strength=True) == pytest.approx(4.0 if there else 0.0, abs=1e-9)


def test_what_an_effect_freed_is_held_where_that_is_asked(known):
    """A strength that goes with what it freed is close to nothing by itself, and far from it beside that."""
    tank = Slosh(name="more", position=(0.0,) * 3, mass=LEAST, stiffness=(1.0,) * 3, damping=(0.0,) * 3)
    candidate = Candidate(
        "slosh", "bus", "slosh", "", tank, ("more.mass",), (STEP,), also=("more.stiffness.x",)
    )
    found = SimpleNamespace(
        unknowns=candidate.unknowns(()),
        point=known.point.with_effect(tank.with_values({"more.mass": 0.2})),
        covariance=lambda held, white: np.array([[1e-4 if "more.stiffness.x" in held else 1.0]]),
        problem=WHITE,
    )
    assert wald(found, candidate) == pytest.approx(0.04)
    assert wald(found, candidate, held=True) == pytest.approx(400.0)
