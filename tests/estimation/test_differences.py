"""Slopes of the log-posterior by differences of whole runs, where those along the filter's states fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from smsid.estimation._differences import DERIVATIVE_TOLERANCE, derivatives_hold, difference_equations
from smsid.estimation._maximum import _one_step_on, equations_at_maximum, has_converged, maximise
from smsid.estimation._normal_equations import normal_equations, objective_of
from smsid.estimation._retraction import retract
from smsid.estimation._trust_region import bounded_step, predicted_gain
from smsid.estimation.flight import FlightOptions, flight_of
from smsid.estimation.initial_state import InitialPrior
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import CommandTiming
from smsid.estimation.unknowns import unknowns_of
from tests.estimation.satellite import Satellite, guess, recorded


@pytest.fixture(scope="module")
def flight(known, recording):
    return flight_of(known.point, recording.window(0.0, 2.0), "flight")


@pytest.fixture(scope="module")
def unknowns(known):
    names = ("bus.m", "bus.Ixx")
    return [u for u in unknowns_of(known.point).unknowns if u.name in names]


def test_the_slope_is_the_objectives_where_the_model_is_wrong(known, flight, unknowns):
    """Commands taken as linear where they are held: innovations of many standard deviations."""
    wrong = [replace(flight, problem=replace(flight.problem, timing=CommandTiming("linear", "right")))]
    found = normal_equations(known.point, unknowns, wrong)
    exact = difference_equations(found, wrong)
    for i, u in enumerate(unknowns):
        step = np.zeros(len(unknowns))
        step[i] = 0.03 / np.sqrt(found.gram[i, i])
        up, down = (
            objective_of(retract(known.point, unknowns, s * u.scale), unknowns, wrong) for s in (step, -step)
        )
        assert exact.slope[i] == pytest.approx(-(up - down) / (2.0 * step[i]), rel=1e-2, abs=1e-3 / step[i])


def test_both_curvatures_agree_where_the_model_is_right(known, flight, unknowns):
    """By differences it is a little more: what the covariance of the innovations tells is in it."""
    found = normal_equations(known.point, unknowns, [flight])
    exact = difference_equations(found, [flight])
    size = np.sqrt(np.diag(found.gram))
    np.testing.assert_allclose((exact.gram - found.gram) / np.outer(size, size), 0.0, atol=0.1)


def test_slopes_along_what_is_least_told_are_asked_of_bodies_too(known, recording, unknowns):
    """A slope that lacks a standard deviation's worth along the weaker of two axes."""
    flights = [flight_of(known.point, recording, "flight")]
    found, _ = maximise(known.point, unknowns, flights)
    assert derivatives_hold(found, flights)
    size = np.sqrt(np.diag(found.gram))
    weakest = np.linalg.eigh(found.gram / np.outer(size, size))[1][:, 0] / size
    off = found.gram @ weakest / np.sqrt(weakest @ found.gram @ weakest)
    (term,) = found.terms
    wrong = replace(found, terms=(replace(term, slope=term.slope + off),))
    assert not derivatives_hold(wrong, flights)


def test_from_a_halt_it_goes_on_to_the_maximum(known, flight, unknowns):
    """A start two standard deviations off in each parameter."""
    at = normal_equations(known.point, unknowns, [flight])
    start = retract(known.point, unknowns, 2.0 * at.scales / np.sqrt(np.diag(at.gram)))
    end = equations_at_maximum(normal_equations(start, unknowns, [flight]), [flight])
    assert has_converged(end) and end.objective < at.objective


def test_a_little_last_step_asks_for_no_differences_anew(known, flight, unknowns):
    """Its slopes are those that the quadratic form has there, if the step gained what the form promised."""
    end, _ = maximise(known.point, unknowns, [flight])

    def away(size: float):
        step = size / np.sqrt(end.gram[0, 0]) * np.eye(len(unknowns))[0]
        return normal_equations(retract(end.point, unknowns, step * end.scales), unknowns, [flight])

    exact = difference_equations(away(0.4), [flight])
    best = normal_equations(
        retract(exact.point, unknowns, bounded_step(exact) * exact.scales), unknowns, [flight]
    )
    little, anew = _one_step_on(exact, best), difference_equations(best, [flight])
    assert little is not None and little.exact
    off = little.slope - anew.slope
    assert off @ np.linalg.solve(anew.gram, off) < 0.05**2
    promised = predicted_gain(exact, bounded_step(exact))
    assert _one_step_on(exact, replace(best, objective=exact.objective - 0.5 * promised)) is None
    assert _one_step_on(difference_equations(away(2.0), [flight]), best) is None


RIGID = Satellite(wheel=0.001, tank=(1e-6, 1e-4, 1e-6), panel=(1.0, 0.1, 1e-6, -1e-6))


def test_information_is_the_curvature_where_wheels_follow_their_measured_motion(tmp_path):
    """Wheels that turn alike turn the craft about one axis: three combinations of its inertia are not told,
    and no correlation with what wheels did not do tells them.
    """

    def alike(t):
        return np.zeros(3), np.zeros(3), np.full(3, 0.3 * np.sin(0.3 * t))

    flown = RIGID.fly(30.0, alike)
    only = ("st.attitude", "gyro.acceleration", "command.force", "command.torque", "command.wheel_torque")
    made = recorded(RIGID, flown, np.random.default_rng(5), without=only)
    truth = guess(tmp_path, RIGID, off=0.0, tank=False, panel=False)
    point = Point.of(truth)
    some = [u for u in unknowns_of(point).unknowns if u.name.startswith("bus.I")]
    flights = [flight_of(point, made, "flight")]
    exact = difference_equations(normal_equations(point, some, flights), flights)
    told, basis = np.linalg.eigh(exact.gram)
    assert told[0] < 100.0  # 2522 with the correlations that the filter expects
    for information, direction in zip(told[3:], basis.T[3:], strict=True):
        step = direction * exact.scales / np.sqrt(information)
        low, here, high = (
            objective_of(retract(point, some, k * step), some, flights) for k in (-1.0, 0.0, 1.0)
        )
        assert low + high - 2.0 * here == pytest.approx(1.0, abs=0.1)


TANKED = Satellite(panel=(1.0, 0.1, 1e-6, -1e-6))


def sines(t):
    return np.zeros(3), 0.3 * np.sin(2 * np.pi * np.array([0.2, 0.3, 0.45]) * t), np.zeros(3)


@pytest.fixture(scope="module")
def tank(tmp_path_factory):
    """Four seconds of a tank without attitude, at the truth but for a URDF without products."""
    made = recorded(TANKED, TANKED.fly(4.0, sines), np.random.default_rng(3), without=("st.attitude",))
    description = guess(tmp_path_factory.mktemp("craft"), TANKED, off=0.0, panel=False)
    return Point.of(description), made


def test_slopes_by_springs_of_a_tank_that_begins_anyhow_are_not_those_along_the_filters_states(tank):
    point, made = tank
    some = [u for u in unknowns_of(point).unknowns if u.name == "tank.stiffness.y"]
    flights = [flight_of(point, made, "flight")]
    found = normal_equations(point, some, flights)
    assert not derivatives_hold(found, flights)
    exact = difference_equations(found, flights)
    size = float(np.sqrt(found.gram[0, 0]))
    step = np.array([0.1 / size])
    up, down = (objective_of(retract(point, some, s * some[0].scale), some, flights) for s in (step, -step))
    assert exact.slope[0] == pytest.approx(-float((up - down) / (2.0 * step[0])), abs=0.03 * size)
    assert abs(exact.slope[0] - found.slope[0]) > DERIVATIVE_TOLERANCE * size


def test_of_a_tank_that_begins_at_rest_they_say_what_is_right(tank):
    point, made = tank
    some = [u for u in unknowns_of(point).unknowns if u.name.startswith("tank.stiffness")]
    flights = [flight_of(point, made, "flight", FlightOptions(initial=InitialPrior(at_rest=True)))]
    assert derivatives_hold(normal_equations(point, some, flights), flights)


def test_slopes_along_what_is_hardly_told_are_the_objectives(known, recording):
    """Single parameters are told a thousand times better than a combination of them."""
    some = unknowns_of(known.point).unknowns
    flights = [flight_of(known.point, recording, "flight")]
    exact = difference_equations(normal_equations(known.point, some, flights), flights)
    size = np.sqrt(np.diag(exact.gram))
    told, basis = np.linalg.eigh(exact.gram / np.outer(size, size))
    assert told[0] < 1e-6
    for share, direction in zip(told[:8], basis.T[:8], strict=True):
        step = direction / size / np.sqrt(share)  # a standard deviation
        ends = [retract(known.point, some, s * step * exact.scales) for s in (0.03, -0.03)]
        up, down = (objective_of(p, some, flights) for p in ends)
        assert exact.slope @ step == pytest.approx((down - up) / 0.06, abs=0.02)


def test_what_is_not_told_is_not_told_by_its_bend(tmp_path):
    """Rotation tells an inertia to a ten-thousandth, and nothing of the centre of mass but by the bend of the
    inertia about it, which is the square of the centre's distance.
    """

    def slowly(t):
        return np.zeros(3), np.zeros(3), 0.05 * np.sin(0.3 * np.array([1.0, 1.5, 2.2]) * t + [0.0, 1.0, 2.0])

    light = replace(
        RIGID, mass=100.0, centre=(0.0,) * 3, inertia=((6.5, 0.4, -0.3), (0.4, 6, 0.2), (-0.3, 0.2, 4.5))
    )
    only = ("st.attitude", "gyro.acceleration", "command.force", "command.torque", "command.wheel_torque")
    made = recorded(light, light.fly(20.0, slowly), np.random.default_rng(5), without=only)
    point = Point.of(guess(tmp_path, light, off=0.0, tank=False, panel=False))
    some = [u for u in unknowns_of(point).unknowns if u.kind == "inertial"]
    flights = [flight_of(point, made, "flight")]
    best = maximise(point, some, flights)[0].point
    point = best.moved(some, np.array([0.05 if u.name == "bus.mx" else 0.0 for u in some]))
    found = normal_equations(point, some, flights)
    exact = difference_equations(found, flights)
    told, basis = np.linalg.eigh(found.gram)  # in units of what is known beforehand
    assert told[3] == pytest.approx(1.0, abs=0.01) and told[4] > 1e6
    for share, direction in zip(told, basis.T, strict=True):
        step = direction / np.sqrt(share)  # a standard deviation
        assert step @ exact.gram @ step == pytest.approx(1.0, abs=0.1)
        ends = [retract(point, some, s * step * exact.scales) for s in (0.001, -0.001)]
        up, down = (objective_of(p, some, flights) for p in ends)
        assert exact.slope @ step == pytest.approx((down - up) / 0.002, abs=0.01)
