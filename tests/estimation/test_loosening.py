"""First searches on fewer samples: which flights have them, and what they may not change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from smsid.estimation import loosening
from smsid.estimation.commands_between_samples import as_commands_act
from smsid.estimation.flight import flight_of
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.loosening import FIRST_SHARE, likeliest_share, loosen_model, thin_flight
from smsid.estimation.parameter_vector import Point
from tests.estimation.satellite import Satellite, guess, recorded, true_values

RIGID = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))


def pushed(t):
    force = np.array([2.0 * np.sin(0.5 * t), np.cos(0.4 * t), np.sin(0.3 * t)])
    return force, np.zeros(3), 0.1 * np.sin(np.array([0.9, 1.3, 1.7]) * t)


@pytest.fixture(scope="module")
def recording():
    return recorded(RIGID, RIGID.fly(20.0, pushed), np.random.default_rng(1), every=1)


def test_only_long_flights_of_one_rate_have_fewer_samples(tmp_path, recording, monkeypatch):
    flight = flight_of(Point.of(guess(tmp_path, RIGID, tank=False, panel=False)), recording, "flight")
    assert thin_flight(flight) is flight  # 201 samples would be left
    monkeypatch.setattr(loosening, "MOST_SAMPLES", 200)
    fewer = thin_flight(flight).problem
    assert len(fewer.data.times) == 201 and len(flight.problem.data.times) == 1001
    assert fewer.substep == pytest.approx(0.025)
    values = flight.problem.data.values.copy()
    values[np.arange(1001) % 5 != 2, 0] = np.nan  # every fifth: none of them is among the samples left
    data = replace(flight.problem.data, values=values)
    slower = replace(flight, problem=replace(flight.problem, data=data))
    assert thin_flight(slower) is slower


@pytest.mark.parametrize(("factor", "low", "high"), [(1.0, 0.0, 0.0), (1.1, 3e-3, 0.3), (10.0, 0.3, 0.3)])
def test_a_model_errs_by_what_its_inertia_is_off(tmp_path, factor, low, high):
    """A factor on the inertia is an error of as much of what drives the turning."""
    truth = replace(RIGID, centre=(0.0, 0.0, 0.0), inertia=tuple(map(tuple, np.diag((80.0, 95.0, 70.0)))))
    made = recorded(truth, truth.fly(20.0, pushed), np.random.default_rng(1), every=1)
    wrong = replace(truth, inertia=tuple(map(tuple, factor * np.array(truth.inertia))))
    point = Point.of(guess(tmp_path, wrong, off=0.0, tank=False, panel=False))
    flight = as_commands_act(point, (), flight_of(point, made, "flight"), False)
    assert low <= likeliest_share(point, [flight], FIRST_SHARE) <= high


def test_they_do_not_change_what_is_found(tmp_path, recording, monkeypatch):
    description, found = guess(tmp_path, RIGID, tank=False, panel=False), []
    recording = recording.window(0.0, 10.0)
    for many in (100, 10_000):
        monkeypatch.setattr(loosening, "MOST_SAMPLES", many)
        found.append(identify_flights(description, [recording]).estimate)
    for p in found[1].parameters:
        assert abs(found[0][p.name].value - p.value) < 0.1 * p.sigma
        assert found[0][p.name].sigma == pytest.approx(p.sigma, rel=1e-2)


def burning(t):
    k, force = int(t // 5.0), np.zeros(3)
    force[k % 3] = 2.0 if (k // 3) % 2 == 0 else -2.0
    torque = 0.05 * np.sin(2 * np.pi * np.array([0.04, 0.06, 0.09]) * t + [0, 1, 2])
    return force, torque, 0.1 * np.sin(2 * np.pi * np.array([0.05, 0.083, 0.031]) * t)


@pytest.mark.parametrize("tank", [0.3, 1e-9])
def test_what_a_model_errs_by_counts_in_intervals_where_noise_hides_it(tmp_path, tank):
    """A tank of 0.3 kg that nobody lists leaves no channel louder than noise."""
    truth = replace(RIGID, tank=(tank, 0.36 * tank, 0.06 * tank))
    made = recorded(truth, truth.fly(40.0, burning, 0.1), np.random.default_rng(0), every=1)
    found = identify_flights(guess(tmp_path, truth, tank=False, panel=False), [made])
    true, (m, _, _), at = true_values(truth, tank=False, panel=False), truth.tank, np.array(truth.tank_at)
    still = m * ((at @ at) * np.eye(3) - np.outer(at, at))
    true["bus.m"] = true["total.mass"] = truth.mass + m
    true |= {f"bus.m{a}": true[f"bus.m{a}"] + m * x for a, x in zip("xyz", at, strict=True)}
    pairs = [(i, k) for i in range(3) for k in range(i, 3)]
    true |= {(n := f"bus.I{'xyz'[i]}{'xyz'[k]}"): true[n] + still[i, k] for i, k in pairs}
    off = [(p.value - true[p.name]) / p.sigma for p in found.estimate.parameters if p.name in true]
    assert len(off) >= 10
    np.testing.assert_allclose(off, 0.0, atol=3.0)
    assert all(c.judgement == "explained" for c in found.quality.channels)
    listed = tank < 1e-3
    assert found.quality.judgement == ("explained" if listed else "roughly")
    assert (found.quality.model_error == 0.0) is listed
    assert listed or "errs slowly" in found.quality.sentence


def test_a_heavier_craft_is_moved_as_much_by_errors_of_its_model(tmp_path, recording):
    """Errors are accelerations: ten times the inertia would need ten times the force, and is no likelier."""
    heavy = replace(RIGID, mass=10.0 * RIGID.mass, inertia=tuple(map(tuple, 10.0 * np.array(RIGID.inertia))))
    light, much = (Point.of(guess(tmp_path, s, off=0.0, tank=False, panel=False)) for s in (RIGID, heavy))
    flight = flight_of(light, recording, "flight")
    loose = loosen_model(flight.model, flight.problem, 0.1)
    moved = []
    for point in (light, much):
        model = point.model()
        mass = pin.crba(model.pin, model.pin.createData(), model.home)[:6, :6]
        noise = KalmanFilter(model, loose).input_noise
        moved.append(np.sqrt(noise[:6]) * np.diag(np.linalg.inv(np.triu(mass) + np.triu(mass, 1).T)))
        assert noise[0] > 100.0 * KalmanFilter(model, flight.problem).input_noise[0]
    np.testing.assert_allclose(moved[1], moved[0], rtol=0.05)
