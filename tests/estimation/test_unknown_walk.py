"""A torque that nobody recorded is a random walk in continuous time, however often it is looked at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from smsid.estimation import kalman
from smsid.estimation.flight import flight_of
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Timing, UnknownInput
from smsid.estimation.smoother import predicted_covariances
from smsid.recording import Recording

from .satellite import Satellite, guess

WALK, SECONDS = 0.02, 2.4


def grown(folder, step, timing=None):
    """Return the covariance after a flight at rest of which nothing is read, all known at its start."""
    times = np.arange(round(SECONDS / step) + 1) * step
    rates = np.zeros((len(times), 3))
    channels = {"gyro.angular_rate": rates, "tacho.wheel_rate": rates}
    point = Point.of(guess(folder, Satellite(), tank=False, panel=False))
    recording = Recording.from_arrays(times, channels, labels={"wheel": ("rw1", "rw2", "rw3")}, name="rest")
    problem = flight_of(point, recording, "rest").problem
    unread = replace(problem.data, values=np.full_like(problem.data.values, np.nan))
    wheel = problem.begin.v.size - 3
    known = replace(problem.begin, covariance=np.zeros_like(problem.begin.covariance))
    inputs = (UnknownInput(wheel, 0.0, WALK, motor=True),)
    problem = replace(problem, data=unread, begin=known, unknown_inputs=inputs, locked=np.zeros(0, dtype=int))
    problem = replace(problem, timing=timing or Timing("linear"))
    model = point.model()
    filtering = KalmanFilter(model, problem)
    first = filtering.covariance
    run = filtering.advance(len(times))
    whole = predicted_covariances(run, first, problem.data.sigma**2, filtering.input_noise, filtering.walk)
    inverse = pin.computeMinverse(model.pin, model.pin.createData(), model.home)[wheel, wheel]
    return filtering.covariance, whole[-1], model.nv + wheel, inverse


@pytest.mark.parametrize("step", [0.05, 0.1])
@pytest.mark.parametrize("plain", [True, False])
def test_what_a_walk_does_is_its_integral_at_any_rate_of_samples(tmp_path, step, plain, monkeypatch):
    if plain:
        monkeypatch.setattr(kalman, "compiled_model", lambda base: None)
    filtered, smoothed, rate, inverse = grown(tmp_path, step)
    np.testing.assert_allclose(filtered, smoothed, rtol=1e-9, atol=1e-18)
    expected = (
        WALK**2
        * SECONDS
        * np.array(
            [[(inverse * SECONDS) ** 2 / 3.0, inverse * SECONDS / 2.0], [inverse * SECONDS / 2.0, 1.0]]
        )
    )
    own = [rate, len(filtered) - 1]
    np.testing.assert_allclose(filtered[np.ix_(own, own)], expected, rtol=1e-6)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("plain", [True, False])
def test_a_motor_that_is_held_jumps_at_the_samples(tmp_path, side, plain, monkeypatch):
    """By the sum over the jumps, each of which drives the wheel until the end."""
    if plain:
        monkeypatch.setattr(kalman, "compiled_model", lambda base: None)
    step = 0.1
    filtered, smoothed, rate, inverse = grown(tmp_path, step, Timing("held", side))
    np.testing.assert_allclose(filtered, smoothed, rtol=1e-9, atol=1e-18)
    jumps = step * (np.arange(round(SECONDS / step)) + (side == "right"))
    drives = inverse * (SECONDS - jumps)
    across = drives.sum()
    expected = WALK**2 * step * np.array([[drives @ drives, across], [across, len(jumps)]])
    own = [rate, len(filtered) - 1]
    np.testing.assert_allclose(filtered[np.ix_(own, own)], expected, rtol=1e-6)
