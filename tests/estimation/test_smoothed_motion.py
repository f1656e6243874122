"""The likeliest motion by disturbances, and slopes along it: against another smoother, and differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from smsid.effects import SensorScale
from smsid.estimation import _normal_equations as equations
from smsid.estimation import _smoothed_motion as smoothed_motion
from smsid.estimation import _walks_by_gain as walks_by_gain
from smsid.estimation import kalman
from smsid.estimation._normal_equations import normal_equations, objective_of, problem_at
from smsid.estimation._retraction import retract
from smsid.estimation._smoothed_motion import SmoothedRun, smoothed_runs
from smsid.estimation._smoother import smoothed_states
from smsid.estimation.flight import FlightOptions, flight_of
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.loosening import loosen_model
from smsid.estimation.parameter_vector import Point
from smsid.estimation.unknowns import effect_unknown, sensor_unknowns, unknowns_of
from smsid.sensing.error_model import ErrorModel
from tests.estimation.satellite import Satellite, guess, recorded, true_values

COMMANDS = ("command.force", "command.torque", "command.wheel_torque")


def turning(t):
    return np.zeros(3), np.zeros(3), 0.1 * np.sin(np.array([0.9, 1.3, 0.6]) * t)


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """A point near the truth, its unknowns and a flight of 8 s whose wheels follow measured motion, read with
    unknown scales, beside a gyro that wanders.
    """
    truth = Satellite(tank=(1e-9, 1e-9, 1e-9))
    recording = recorded(truth, truth.fly(8.0, turning), np.random.default_rng(5), without=COMMANDS)
    described = guess(tmp_path_factory.mktemp("followed"), truth, off=0.0, tank=False)
    gyro = next(s for s in described.sensor if s.name == "gyro")
    rate = gyro.errors["angular_rate"].model_copy(update={"random_walk": 2e-6})
    wanders = gyro.model_copy(update={"errors": gyro.errors | {"angular_rate": rate}})
    tacho = next(s for s in described.sensor if s.name == "tacho")
    scaled = tacho.errors["wheel_rate"].model_copy(update={"scale_sigma": 0.05})
    uncertain = tacho.model_copy(update={"errors": {"wheel_rate": scaled}})
    sensors = tuple({"gyro": wanders, "tacho": uncertain}.get(s.name, s) for s in described.sensor)
    begun = Point.of(described.model_copy(update={"sensor": sensors}))
    unknowns, true = list(unknowns_of(begun).unknowns), true_values(truth, tank=False)
    unknowns += sensor_unknowns(begun.base, sensors, {"tacho.wheel_rate"}, "flight", set())
    wanted = [0.01 if u.kind == "sensor" else 1.002 * true[u.name] for u in unknowns]
    point = retract(begun, unknowns, np.array(wanted) - [begun.value(u) for u in unknowns])
    flight = flight_of(point, recording, "flight", FlightOptions())
    return point, unknowns, replace(flight, problem=replace(flight.problem, of_all_readings=True))


def paths(point, flight, samples):
    return list(smoothed_runs(KalmanFilter(point.model(), problem_at(point, flight)), samples))


def joined(runs, name, where="states"):
    return np.concatenate([getattr(getattr(r.along, where), name) for r in runs])


def test_a_gyro_wanders_and_wheels_are_followed(followed):
    flight = followed[-1]
    assert flight.problem.at_likeliest_motion
    assert flight.problem.bias_walks


@pytest.mark.parametrize("samples", [7, 2000])
def test_it_is_the_motion_that_smoothing_by_covariances_finds(followed, samples):
    """Bryson and Frazier's smoother needs a covariance a sample, and knows nothing of pieces."""
    point, _, flight = followed
    runs, model = paths(point, flight, samples), point.model()
    other = smoothed_states(model, problem_at(point, flight))
    predicted = np.concatenate([r.ran.states.v for r in runs])
    moved = np.abs(other.states.v - predicted).max(axis=0)
    np.testing.assert_allclose((joined(runs, "v") - other.states.v) / moved, 0.0, atol=1e-6)
    turned = [pin.difference(model.pin, a, b) for a, b in zip(joined(runs, "q"), other.states.q, strict=True)]
    assert np.abs(turned).max() < 1e-6 * moved.max()


def test_forces_on_the_way_take_one_rate_to_the_next(followed):
    """A motion in the mean of whose accelerations nothing is left over, but for what steps leave (h^2)."""
    point, _, flight = followed
    run = paths(point, flight, 2000)[0].along
    mean = np.diff(run.states.v, axis=0) / np.diff(run.states.time)[:, None]
    assert np.abs(run.middle.a - mean).max() < 1e-3 * np.abs(mean).max()


def test_without_compiled_code_it_is_the_same(followed, monkeypatch):
    point, _, flight = followed
    runs = paths(point, flight, 2000)
    monkeypatch.setattr(smoothed_motion, "compiled_pays", lambda: False)
    plain = paths(point, flight, 2000)
    for where in ("states", "middle"):
        there = joined(runs, "a", where)
        np.testing.assert_allclose(joined(plain, "a", where), there, atol=1e-9 * np.abs(there).max())


def slope_errors(point, unknowns, flight):
    """Return by how much slopes differ from differences to both sides, and the slopes, in sigmas (m,)."""
    found = normal_equations(point, unknowns, [flight])
    size, off = np.sqrt(np.diag(found.gram)), []
    for i, u in enumerate(unknowns):
        step = np.zeros(len(unknowns))
        step[i] = 1e-2 / size[i] * u.scale
        up, down = (objective_of(retract(point, unknowns, s * step), unknowns, [flight]) for s in (1.0, -1.0))
        off.append(-(up - down) / 2e-2 - found.slope[i] / size[i])
    return np.array(off), found.slope / size


@pytest.mark.parametrize("samples", [30, 2000])
def test_slopes_are_those_of_the_objective(followed, samples, monkeypatch):
    """Some sigmas off the maximum; what is left is of the filter's linearisation about what it had."""
    monkeypatch.setattr(equations, "SAMPLES_AT_ONCE", samples)
    off, slope = slope_errors(*followed)
    assert np.abs(slope).max() > 1.0
    assert np.abs(off).max() < 0.06


def test_along_filtered_states_slopes_lack_a_part(followed, monkeypatch):
    """What is shown by the test before: otherwise it could not fail."""
    monkeypatch.setattr(
        equations, "_runs_along", lambda kalman: [SmoothedRun(run := kalman.advance(2000), run)]
    )
    off, _ = slope_errors(*followed)
    assert np.abs(off).max() > 0.2


@pytest.mark.parametrize(("share", "lacking"), [(0.01, 0.04), (0.1, 0.2)])
def test_slopes_of_a_model_that_may_err_are_those_of_the_objective(followed, share, lacking, monkeypatch):
    """Of a heavier craft larger forces make the same errors: without that, inertias' slopes lack a part."""
    point, unknowns, flight = followed
    loose = replace(flight, problem=loosen_model(flight.model, flight.problem, share))
    assert loose.problem.at_likeliest_motion
    off, slope = slope_errors(point, unknowns, loose)
    assert np.abs(slope).max() > 1.0
    assert np.abs(off).max() < 0.035
    held = problem_at(point, loose)
    variance = kalman.input_covariance(point.model(), held)
    monkeypatch.setattr(walks_by_gain, "input_covariance", lambda model, problem: variance)
    assert np.abs(slope_errors(point, unknowns, loose)[0]).max() > lacking


def test_a_scale_that_nothing_tells_costs_nothing(tmp_path, monkeypatch):
    """A craft 5 % lighter, turned by wheels 5 % slower than what they read as, turns alike."""
    truth = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))
    recording = recorded(truth, truth.fly(8.0, turning), np.random.default_rng(5), without=COMMANDS)
    described = guess(tmp_path, truth, off=0.0, tank=False, panel=False)
    tacho = next(s for s in described.sensor if s.name == "tacho")
    point = Point.of(described)
    flight = flight_of(point, recording, "flight", FlightOptions())
    flight = replace(flight, problem=replace(flight.problem, of_all_readings=True))
    unknowns = list(unknowns_of(point).unknowns)
    unknowns += sensor_unknowns(
        point.base,
        (tacho.model_copy(update={"errors": {"wheel_rate": ErrorModel(scale_sigma=0.1)}}),),
        {"tacho.wheel_rate"},
        "flight",
        set(),
    )
    step = np.array([0.05 if u.kind == "sensor" else point.value(u) * (1 / 1.05 - 1) for u in unknowns])
    other = point.moved(unknowns, step)

    def cost():
        return objective_of(other, [], [flight]) - objective_of(point, [], [flight])

    as_read = cost()
    monkeypatch.setattr(equations, "walks_as_read", lambda problem: problem)
    assert cost() < -1.0, "walks as they were would tell it: the cost falls with the torques"
    assert abs(as_read) < 0.03 * abs(cost()), "what is left is of the first state, and grows no more"


def test_a_scale_that_is_listed_as_an_effect_moves_walks_as_a_sensors_own(followed):
    """Without that the slope is off by 0.02 in 8 s, and more in longer flights."""
    point, _, flight = followed
    at = {"sensor": "tacho", "quantity": "wheel_rate", "error": 0.01}
    effects = [SensorScale(name=f"s{k}", component=k, **at) for k in range(3)]
    own = replace(point, biases={}, description=point.description.with_effects(*effects))
    off, slope = slope_errors(own, [effect_unknown(e.unknowns()[0]) for e in effects], flight)
    assert np.abs(off).max() < 0.01 and np.abs(slope).max() > 5.0
