"""Fits that go astray: what is out of reach is given up, a step too long is cut to its lowest point."""

import numpy as np
import pinocchio as pin
import pytest

from smsid.diagnose import fit as fitting
from smsid.diagnose.fit import evaluate, fit
from smsid.diagnose.point import Unknown
from smsid.effects.extra_mode import ExtraMode


@pytest.fixture()
def runs(monkeypatch):
    """How often the filter has run."""
    count, run_filter = [], fitting.run_filter

    def counted(*args, **kwargs):
        count.append(1)
        return run_filter(*args, **kwargs)

    monkeypatch.setattr(fitting, "run_filter", counted)
    return count


def astray(known):
    """The point with one parameter far off, in prior standard deviations."""
    u = next(u for u in known.unknowns if u.kind == "inertial")
    return known.point.moved((u,), np.array([30.0 * u.scale]))


def test_what_is_out_of_reach_is_given_up(known, problem, runs):
    fit(astray(known), known.unknowns, problem, iterations=6, at_most=-np.inf)
    given_up = len(runs)
    runs.clear()
    reached = fit(astray(known), known.unknowns, problem, iterations=6)
    assert given_up < len(runs)
    runs.clear()
    again = fit(astray(known), known.unknowns, problem, iterations=6, at_most=reached.objective + 1.0)
    assert again.objective == pytest.approx(reached.objective, abs=1.0)


def test_a_step_too_long_is_cut_to_its_lowest_point(known, problem, runs):
    start = evaluate(astray(known), known.unknowns, problem)
    step = fitting.bounded_step(start)
    runs.clear()
    better = fitting._descend(start, 8.0 * step, known.unknowns, problem)
    assert better is not None and better.objective < start.objective
    assert len(runs) <= 3  # halves would take four


def test_a_mass_on_springs_that_moves_leaves_the_whole_as_it_is(known):
    """What one more mode has of the panel's mass is no other mass: the spacecraft at rest weighs and turns as
    before, wherever along the panel it sits.
    """
    place = (2.0, 0.3, 0.0)
    mode = ExtraMode(name="more", appendage="panel", mass=0.4, position=place, frequency=0.5)
    point = known.point.with_effect(mode)
    free = [p for p in mode.parameters() if p.name in ("more.mass", "more.position.x", "more.position.y")]
    own = tuple(Unknown(p.name, "effect", p.unit, p.value, np.inf, 1.0) for p in free)
    inertial = tuple(u for u in known.unknowns if u.kind == "inertial")
    step = np.concatenate([np.zeros(len(inertial)), [-0.2, 0.8, -0.5]])
    moved = fitting._straight(point, (*inertial, *own), step)
    assert moved.description.get_effect("more").position == pytest.approx((2.8, -0.2, 0.0))
    whole = [composite(p) for p in (point, moved)]
    assert whole[1] == pytest.approx(whole[0], abs=1e-6 * np.abs(whole[0]).max())


def composite(point) -> np.ndarray:
    """Inertia (6, 6) of the whole spacecraft at home, about the bus."""
    model = point.model()
    return pin.crba(model.pin, model.pin.createData(), model.home)[:6, :6]
