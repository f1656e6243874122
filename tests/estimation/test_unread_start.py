"""How a motion begins that nothing reads is sought, not filtered: derivatives, and the score at the truth."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import chi2

from smsid.estimation._differences import difference_equations
from smsid.estimation._normal_equations import normal_equations
from smsid.estimation._retraction import retract
from smsid.estimation._unread_start import with_unread_start
from smsid.estimation.flight import FlightOptions, flight_of
from smsid.estimation.initial_state import InitialPrior
from smsid.estimation.parameter_vector import Point
from smsid.estimation.unknowns import unknowns_of
from smsid.recording import Recording
from smsid.sensing import Sensor
from smsid.sensing.error_model import ErrorModel
from tests.estimation.satellite import Satellite, guess, recorded, rotation, true_values

RIGID = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))
PLACE = (0.5, 1.5, 0.6)
GNSS = Sensor(
    name="gnss", kind="pose", quantities=("position",), rate=1.0, position=PLACE,
    errors={"position": ErrorModel(noise_sigma=5e-3)},
)  # fmt: skip


def drive(t):
    """Burns along each axis, torques on the bus and on all wheels."""
    force, k = np.zeros(3), int((t + 1e-9) // 5.0)
    force[k % 3] = 2.0 if (k // 3) % 2 == 0 else -2.0
    torque = 0.05 * np.sin(2 * np.pi * np.array([0.04, 0.06, 0.09]) * t + [0, 1, 2])
    return force, torque, 0.1 * np.sin(2 * np.pi * np.array([0.05, 0.083, 0.031]) * t)


TURNED, RATE, WHEELS = (0.2, -0.1, 0.15), (0.004, -0.003, 0.002), (20.0, -10.0, 15.0)


@pytest.fixture(scope="module")
def flown():
    start = np.zeros(24)
    start[3:7] = pin.Quaternion(pin.exp3(np.array(TURNED))).coeffs()
    start[10:13], start[21:24] = RATE, RIGID.wheel * np.array(WHEELS)
    return RIGID.fly(60.0, drive, start=start)


def problem(flown, folder, seed):
    """Return the truth, unknowns and flight of positions at 1 Hz: nothing reads attitude, rate or wheels."""
    times, states, _, _ = flown
    rng, k = np.random.default_rng([seed, 91]), slice(None, None, 50)
    at = states[k, :3] + np.array([rotation(q) @ np.array(PLACE) for q in states[k, 3:7]])
    told = recorded(RIGID, flown, rng, every=1)
    channels = {c: (times, told[c]) for c in ("command.force", "command.torque", "command.wheel_torque")}
    channels["gnss.position"] = times[k], at + rng.normal(0.0, 5e-3, at.shape)
    made = Recording.from_arrays(
        None, channels, labels={"wheel": ("rw1", "rw2", "rw3")}, provenance={"inputs": "held"}, name="gnss"
    )
    description = guess(folder, RIGID, tank=False, panel=False)
    described = Point.of(description.model_copy(update={"sensor": (*description.sensor, GNSS)}))
    options = FlightOptions(initial=InitialPrior(attitude=0.2, rate=0.006))
    flight, start = with_unread_start(flight_of(described, made, "gnss", options))
    truth, own = true_values(RIGID, tank=False, panel=False), unknowns_of(described, components=True).unknowns
    truth |= dict(zip((u.name for u in start), (*TURNED, *RATE, *WHEELS), strict=True))
    unknowns = [*own, *start]
    return (
        retract(described, unknowns, np.array([truth[u.name] - described.value(u) for u in unknowns])),
        unknowns,
        flight,
    )


def test_what_nothing_reads_is_sought_with_what_was_known_of_it(flown, tmp_path):
    unknowns = problem(flown, tmp_path, 0)[1]
    start = {u.name.removeprefix("gnss: start."): u.sigma for u in unknowns if u.kind == "start"}
    assert start == pytest.approx(
        {f"attitude.{a}": 0.2 for a in "xyz"} | {f"rate.{a}": 0.006 for a in "xyz"} | dict.fromkeys(
            ("rw1", "rw2", "rw3"), 100.0)
    )  # fmt: skip


def test_derivatives_by_it_are_those_of_the_likelihood(flown, tmp_path):
    point, unknowns, flight = problem(flown, tmp_path, 0)
    here = normal_equations(point, unknowns, [flight])
    exact, own = (
        difference_equations(here, [flight]),
        [i for i, u in enumerate(unknowns) if u.kind == "start"],
    )
    np.testing.assert_allclose(np.diag(here.gram)[own], np.diag(exact.gram)[own], rtol=0.05)
    size = np.sqrt(np.diag(exact.gram))
    np.testing.assert_allclose((here.slope / size)[own], (exact.slope / size)[own], rtol=0.05, atol=0.05)


def test_the_score_at_the_truth_is_that_of_noise(flown, tmp_path):
    """Linear about wheels that may begin at 100 rad/s, a filter took momentum for known: 30 of 10."""
    squares = []
    for seed in range(6):
        point, unknowns, flight = problem(flown, tmp_path / str(seed), seed)
        found = normal_equations(point, unknowns, [flight])
        # of what is drawn anew with each recording, noise alone: prior means and the truth are the same
        slope = found.terms[0].slope
        size, basis = np.linalg.eigh(found.information / np.outer(found.scales, found.scales))
        told = size > 1e-6 * size[-1]
        squares.append(np.sum((basis.T @ (slope / found.scales))[told] ** 2 / size[told]))
        freedom = int(told.sum())
    assert chi2.ppf(0.001, 6 * freedom) < sum(squares) < chi2.ppf(0.999, 6 * freedom)
