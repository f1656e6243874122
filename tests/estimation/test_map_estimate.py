"""Fits that go astray: what is out of reach is given up, steps that lead up are damped."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import minimize

from smsid.effects import GearCompliance
from smsid.effects.friction import JointFriction
from smsid.estimation import map_estimate as fitting
from smsid.estimation._trust_region import (
    bounded_step,
    damping_within,
    next_radius,
    room_within_bounds,
    sizes,
)
from smsid.estimation.map_estimate import evaluate, fit
from smsid.estimation.measurements import measurements_of
from smsid.estimation.parameter_vector import Unknown
from smsid.experiments import fly, named_experiment


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


def test_what_comes_to_rest_in_vain_is_given_up_there_and_not_on_its_way(known, problem, runs):
    reached = fit(astray(known), known.unknowns, problem, iterations=8)
    begun, asked = astray(known), []
    (far,) = (u for u in known.unknowns if begun.value(u) != known.point.value(u))
    runs.clear()
    # in vain where it began: it goes on, as it leads elsewhere
    on = fit(
        begun, known.unknowns, problem, iterations=8, in_vain=lambda f: f.point.value(far) == begun.value(far)
    )
    assert on.objective == reached.objective
    whole = len(runs)
    runs.clear()
    # in vain everywhere: nearly at rest it is seen, not before
    stopped = fit(begun, known.unknowns, problem, iterations=8, in_vain=lambda f: not asked.append(f))
    assert len(runs) < whole and reached.objective < stopped.objective < reached.objective + 20.0
    assert len(asked) == 2 and asked[0] is stopped


def test_no_step_leads_up_where_bounds_hold_it(known, problem):
    """The best step within bounds is scipy's, and promises a gain; one bound after the other may not."""
    start = evaluate(astray(known), known.unknowns, problem)
    free = bounded_step(start)
    rng = np.random.default_rng(3)
    for _ in range(20):
        scales = np.array([u.scale for u in known.unknowns])
        now = np.array([start.point.value(u) for u in known.unknowns])
        near = np.abs(free) * rng.uniform(0.05, 1.5, (2, len(free))) + 1e-9
        bound = [
            replace(u, lower=v - a * s, upper=v + b * s)
            for u, v, s, a, b in zip(known.unknowns, now, scales, *near, strict=True)
        ]
        held = replace(start, unknowns=tuple(bound))
        step = bounded_step(held)
        low, high = room_within_bounds(held.point, held.unknowns)
        assert (step >= low - 1e-9).all() and (step <= high + 1e-9).all()

        def off(x):
            return 0.5 * x @ start.gram @ x - start.slope @ x

        def slope(x):
            return start.gram @ x - start.slope

        oracle = minimize(
            off, np.zeros(len(step)), jac=slope, bounds=list(zip(low, high, strict=True)), method="L-BFGS-B",
            options={"maxiter": 5000, "maxfun": 20000, "ftol": 1e-14},
        )  # fmt: skip
        assert off(step) <= oracle.fun + 1e-6 * abs(oracle.fun)
        assert off(step) < 0.0


def test_damping_shortens_first_what_the_data_tell_least_of(known, problem):
    start = evaluate(astray(known), known.unknowns, problem)
    start = replace(start, unknowns=tuple(replace(u, lower=-np.inf, upper=np.inf) for u in start.unknowns))
    size = np.sqrt(np.diag(start.gram))
    full, damped = bounded_step(start), bounded_step(start, 0.1)
    scaled = start.gram / np.outer(size, size)
    assert damped * size == pytest.approx(
        np.linalg.solve(scaled + 0.1 * np.eye(len(size)), start.slope / size), rel=1e-6, abs=1e-9
    )
    _, basis = np.linalg.eigh(scaled)
    least, most = basis[:, 0], basis[:, -1]
    assert abs(least @ (damped * size)) < 0.5 * abs(least @ (full * size))
    assert abs(most @ (damped * size)) > 0.5 * abs(most @ (full * size))


@pytest.mark.parametrize("share", [0.9, 0.3, 1e-3])
def test_a_step_is_as_long_as_it_may_be(known, problem, share):
    start = evaluate(astray(known), known.unknowns, problem)
    start = replace(start, unknowns=tuple(replace(u, lower=-np.inf, upper=np.inf) for u in start.unknowns))

    def length(damping):
        return np.linalg.norm(sizes(start) * bounded_step(start, damping))

    assert damping_within(start, 2.0 * length(0.0)) == 0.0
    assert damping_within(start, np.inf) == 0.0
    radius = share * length(0.0)
    assert length(damping_within(start, radius)) == pytest.approx(radius, rel=0.05)


@pytest.mark.parametrize("wanted", [0.0, 1.0, 1e3])
def test_what_a_bound_holds_does_not_shorten_the_rest(wanted):
    """A friction of zero that the data want far below zero: the others go as far as without it."""
    unknowns = [Unknown(n, "effect", "1", 0.0, np.inf, 1.0) for n in "ab"]
    held = Unknown("c", "effect", "1", 0.0, np.inf, 1.0, lower=0.0)
    point = SimpleNamespace(value=lambda u: 0.0, bounds=lambda u: (u.lower, u.upper))
    small = np.array([[1.0, 0.6], [0.6, 2.0]])
    free = SimpleNamespace(gram=small, slope=np.array([3.0, -4.0]), point=point, unknowns=unknowns)
    whole = SimpleNamespace(
        gram=block_diag(small, 1.0), slope=np.array([3.0, -4.0, -wanted]), point=point,
        unknowns=[*unknowns, held],
    )  # fmt: skip
    alone, beside = (bounded_step(f, damping_within(f, 0.7)) for f in (free, whole))
    assert beside == pytest.approx([*alone, 0.0], rel=0.02, abs=1e-9)
    assert np.linalg.norm(sizes(free) * alone) == pytest.approx(0.7, rel=0.05)


def test_a_step_that_led_up_is_followed_by_one_to_the_lowest_point_of_a_parabola():
    """Down by 2 a unit at first, up by 4 at the end of 3 units: -6 s + 10 s^2 in shares of the step."""
    assert next_radius(3.0, 6.0, 4.0) == pytest.approx(0.9)
    assert next_radius(3.0, 6.0, 1e9) == pytest.approx(0.15)
    assert next_radius(3.0, 6.0, np.inf) == pytest.approx(0.15)


def test_a_bent_valley_is_followed_to_its_end(known, problem):
    """How fast and how sharply a friction falls with the rate trade for each other and for its size: a fit
    from another shape comes as low as the truth is. Steps cut in length alone crept along that valley.
    """
    true = JointFriction(name="curve", joint="joint3", coulomb=0.3, stribeck=0.6, stribeck_rate=0.02)
    true = true.model_copy(update={"stribeck_exponent": 0.8})
    point = known.point.with_effect(true)
    model = point.model()
    plan = named_experiment("exp2", known.point.model()).model_copy(update={"duration": 12.0})
    recording = fly(model, plan, np.random.default_rng(5)).recording
    here = replace(problem, recording=recording, data=measurements_of(model, recording, point.sensors()))
    free = [
        Unknown(p.name, "effect", p.unit, p.value, np.inf, 1e-2, lower=p.lower, upper=p.upper)
        for p in true.parameters()
        if p.name.rpartition(".")[2] in ("coulomb", "stribeck", "stribeck_rate", "stribeck_exponent")
    ]
    start = true.with_values(
        {"curve.stribeck_rate": 0.05, "curve.stribeck_exponent": 2.0, "curve.coulomb": 0.4}
    )
    unknowns = (*known.unknowns, *free)
    truth = fit(point, unknowns, here, iterations=8)
    found = fit(known.point.with_effect(start), unknowns, here, iterations=12)
    assert found.objective == pytest.approx(truth.objective, abs=1.0)


def test_the_spread_of_parameters_with_others_held_is_that_without_these(known, problem):
    found = evaluate(known.point, known.unknowns, problem)
    held = {u.name for u in known.unknowns[1::2]}
    kept = [i for i, u in enumerate(known.unknowns) if u.name not in held]
    scales = found.scales[kept]
    expected = np.linalg.inv(found.gram[np.ix_(kept, kept)]) * np.outer(scales, scales)
    covariance = found.covariance(held)
    size = np.sqrt(np.diag(expected))
    assert covariance[np.ix_(kept, kept)] / np.outer(size, size) == pytest.approx(
        expected / np.outer(size, size), abs=1e-6
    )
    assert (size < np.sqrt(np.diag(found.covariance())[kept])).any(), "something was held that matters"


def test_a_parameter_that_nothing_tells_takes_nothing_from_the_others(known, problem):
    """A gear's damper, where its motor takes no part in the motion, made scores of all candidates fail."""
    gear = GearCompliance(name="gear", joint="joint2", compliance=1e-6, quasistatic=True)
    own = [
        Unknown(f"gear.{n}", "effect", "1", getattr(gear, n), np.inf, 1e-6) for n in ("compliance", "damping")
    ]
    here = known.point.with_effect(gear)
    found = evaluate(here, (*known.unknowns, *own), problem)
    told = evaluate(here, (*known.unknowns, own[0]), problem)
    assert not found.told[-1] and found.told[:-1].all() and told.told.all()
    columns = np.random.default_rng(1).standard_normal((told.whitened[..., 0].size, 2))
    (whole,), (less,) = found.projected([columns]), told.projected([columns])
    assert whole.gram == pytest.approx(less.gram, rel=1e-12)
    assert whole.slope == pytest.approx(less.slope, rel=1e-9)
    assert whole.taken[:-1] == pytest.approx(less.taken, abs=1e-12) and not whole.taken[-1].any()


def test_what_is_known_of_parameters_counts_like_what_was_measured(known, problem):
    u = next(u for u in known.unknowns if u.kind == "inertial")
    moved = evaluate(known.point.moved((u,), np.array([3.0 * u.sigma])), known.unknowns, problem)
    assert evaluate(known.point, known.unknowns, problem).stretch == 0.0
    off = np.sqrt(2.0 * (moved.objective + moved.run.log_likelihood))  # the density of the priors itself
    assert moved.stretch == pytest.approx(off / np.sqrt(len(moved.prior.off)), rel=1e-9)
