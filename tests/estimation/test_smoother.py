"""Smoothed states: against dense least squares over all states at once, and against a numpy world's truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import cho_factor, cho_solve

from smsid.effects import ModalAppendage
from smsid.estimation._normal_equations import normal_equations
from smsid.estimation._smoother import bryson_frazier, smoothed_states
from smsid.estimation.fit_quality import fit_quality
from smsid.estimation.flight import FlightOptions, flight_of
from smsid.estimation.hidden_states import hidden_states
from smsid.estimation.identify_flights import FlightEstimate
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import CommandTiming
from smsid.estimation.unknowns import unknowns_of
from smsid.identify.estimate import Estimate, classify
from smsid.recording import load_recording, save_recording
from tests.estimation.satellite import Satellite, guess, recorded


def linear_system(rng, samples=12, width=4, rows=3, seen=0.8):
    """Return a random time-varying system, its readings, and which of them are there."""
    f = 0.4 * rng.normal(size=(samples - 1, width, width)) + np.eye(width)
    h = rng.normal(size=(samples, rows, width))
    q = np.array([x @ x.T for x in 0.3 * rng.normal(size=(samples - 1, width, 2))])  # singular
    first = np.diag([1.0, 4.0, 0.25, 0.0])  # one state is known exactly at first
    y = rng.normal(size=(samples, rows))
    sigma = rng.uniform(0.3, 1.0, size=rows)
    there = rng.random((samples, rows)) < seen
    there[3] = False
    return f, h, q, first, y, sigma, there


def kalman_filter(f, h, q, first, y, sigma, there):
    """Return what a run keeps of a plain Kalman filter that begins at zero."""
    n, rows, width = h.shape
    x, p = np.zeros(width), first
    predicted, states = np.zeros((n, width, width)), np.zeros((n, width))
    whitening, gain, innovations = np.zeros((n, rows, rows)), np.zeros((n, width, rows)), np.zeros((n, rows))
    for k in range(n):
        predicted[k], states[k] = p, x
        at = np.flatnonzero(there[k])
        if len(at):
            hk = h[k][at]
            s = hk @ p @ hk.T + np.diag(sigma[at] ** 2)
            w = np.linalg.inv(np.linalg.cholesky(s))
            kk = p @ hk.T @ w.T @ w
            whitening[k][np.ix_(at, at)], gain[k][:, at] = w, kk
            innovations[k, at] = w @ (y[k, at] - hk @ x)
            x, p = x + kk @ (y[k, at] - hk @ x), p - kk @ hk @ p
        if k < n - 1:
            x, p = f[k] @ x, f[k] @ p @ f[k].T + q[k]
    return states, predicted, whitening, gain, innovations


@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_dense_least_squares_solution_of_all_states_at_once(seed):
    f, h, q, first, y, sigma, there = linear_system(np.random.default_rng(seed))
    states, predicted, whitening, gain, innovations = kalman_filter(f, h, q, first, y, sigma, there)
    change, covariance = bryson_frazier(predicted, f, h, whitening, gain, innovations)
    # the prior of the whole history, dense, conditioned on every reading
    n, rows, width = h.shape
    blocks = [first, *q]
    lead = np.zeros((n * width, n * width))
    for k in range(n):
        part = np.eye(width)
        for i in range(k, -1, -1):
            lead[k * width : (k + 1) * width, i * width : (i + 1) * width] = part
            part = part @ f[i - 1] if i else part
    root = np.zeros_like(lead)
    for k, block in enumerate(blocks):
        root[k * width : (k + 1) * width, k * width : (k + 1) * width] = block
    prior = lead @ root @ lead.T
    big = np.zeros((n * rows, n * width))
    for k in range(n):
        big[k * rows : (k + 1) * rows, k * width : (k + 1) * width] = h[k]
    kept = there.ravel()
    big, noise, readings = big[kept], np.diag(np.tile(sigma**2, n)[kept]), y.ravel()[kept]
    factor = cho_factor(big @ prior @ big.T + noise)
    mean = prior @ big.T @ cho_solve(factor, readings)
    whole = prior - prior @ big.T @ cho_solve(factor, big @ prior)
    np.testing.assert_allclose((states + change).ravel(), mean, atol=1e-10)
    for k in range(n):
        own = slice(k * width, (k + 1) * width)
        np.testing.assert_allclose(covariance[k], whole[own, own], atol=1e-10)


def burns(t):
    """Thrust along each axis in turn: all of the tank's springs are seen."""
    force = np.zeros(3)
    force[int(t // 8.0) % 3] = (2.0 if t % 8.0 < 3.0 else -2.0) * (t % 8.0 < 6.0) * (t < 24.0)
    return force, np.zeros(3), np.zeros(3)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """The truth's flight, its recording, and a description in which only the tank is uncertain."""
    truth = Satellite()
    flight = truth.fly(36.0, burns)
    folder = tmp_path_factory.mktemp("craft")
    plain = guess(folder, truth, off=0.0).model_copy(update={"inertias": "trusted"})
    tank, panel = plain.effect
    assert isinstance(panel, ModalAppendage)
    _write_bus(folder, truth, panel.rigid_inertia().toDynamicParameters())
    panel = panel.model_copy(update={"known": ("all",)})
    description = plain.with_effects(tank, panel)
    return truth, flight, description, recorded(truth, flight, np.random.default_rng(2))


def _write_bus(folder, truth, panel):
    """Put all that is rigid but the panel into the URDF: the truth counts the panel at rest in."""
    j = np.array(truth.inertia)
    own = np.array([truth.mass, *(truth.mass * np.array(truth.centre)), *j[np.tril_indices(3)]]) - panel
    bus = pin.Inertia.FromDynamicParameters(own)
    (x, y, z), i = bus.lever, bus.inertia
    (folder / "satellite.urdf").write_text(
        f'<robot name="satellite"><link name="bus"><inertial><origin xyz="{x} {y} {z}"/>'
        f'<mass value="{bus.mass}"/><inertia ixx="{i[0, 0]}" iyy="{i[1, 1]}" izz="{i[2, 2]}" '
        f'ixy="{i[0, 1]}" ixz="{i[0, 2]}" iyz="{i[1, 2]}"/></inertial></link></robot>',
        encoding="utf-8",
    )


def estimated(description, recording):
    """Return the estimate of the tank: a Gauss-Newton step from the truth, where the maximum is near."""
    point = Point.of(description)
    flight = flight_of(point, recording, "flight")
    flight = replace(flight, problem=replace(flight.problem, timing=CommandTiming("held", "right")))
    unknowns = unknowns_of(point, bodies=False).unknowns
    for _ in range(2):
        equations = normal_equations(point, unknowns, [flight])
        point = point.moved(unknowns, np.linalg.solve(equations.gram, equations.slope) * equations.scales)
    equations = normal_equations(point, unknowns, [flight])
    bias = classify("flight: gyro.acceleration.bias.x", 1e-5, "m/s^2", 1e-6, "nuisance")
    more = [replace(bias, name=bias.name.replace("bias.x", f"bias.{a}")) for a in "yz"]
    estimate = Estimate("satellite", "maximum_likelihood", (bias, *more))
    quality = fit_quality(equations)
    return FlightEstimate(estimate, np.zeros((3, 3)), point.description, quality, (), equations, (flight,))


def test_slosh_and_panel_are_where_the_truth_has_them(world, tmp_path):
    """Nothing of them is measured; the true states are inside their bands, and the bands are narrow."""
    _, flight, description, recording = world
    found = estimated(description, recording)
    hidden = hidden_states(found)
    times, states = flight[0][::5], flight[1][::5]
    np.testing.assert_allclose(hidden.time("smoothed.slosh_position"), times, atol=1e-9)
    inside = []
    for channel, true in (
        ("slosh_position", states[:, 13:16]),
        ("slosh_velocity", states[:, 16:19]),
        ("modal_position", states[:, 19:20] * 2.6),
        ("modal_velocity", states[:, 20:21] * 2.6),
    ):
        value, sigma = hidden[f"smoothed.{channel}"], hidden[f"smoothed_sigma.{channel}"]
        size = np.sqrt(np.mean(true**2))
        assert np.sqrt(np.mean((value - true) ** 2)) < 0.05 * size, channel
        assert np.all(sigma > 0.0)
        off = (value - true) / sigma
        assert np.sqrt(np.mean(off**2)) < 2.0, channel
        inside.append(np.abs(off) < 1.96)
    assert np.mean(np.concatenate([x.ravel() for x in inside])) > 0.85
    np.testing.assert_allclose(hidden["bias_gyro.acceleration"], np.full((len(times), 3), 1e-5))
    np.testing.assert_allclose(hidden["bias_gyro_sigma.acceleration"], np.full((len(times), 3), 1e-6))
    save_recording(hidden, tmp_path / "states.nc")
    again = load_recording(tmp_path / "states.nc")
    np.testing.assert_array_equal(again["smoothed.slosh_position"], hidden["smoothed.slosh_position"])
    bare = hidden_states(found, parameters=False)
    for channel in ("slosh_position", "modal_position"):
        narrow, wide = (x[f"smoothed_sigma.{channel}"] for x in (bare, hidden))
        assert np.all(narrow <= wide * (1.0 + 1e-9))


def test_an_unrecorded_torque_is_a_hidden_state(world):
    _, _, description, recording = world
    options = FlightOptions(torque=(0.1, 0.01))
    point = Point.of(description)
    flight = flight_of(point, recording.window(0.0, 10.0), "a", options)
    found = smoothed_states(point.model(), flight.problem)
    n, nv = len(flight.problem.data.times), point.base.nv
    k = len(flight.problem.unknown_inputs)
    assert found.unknown.shape == (n, k) and k >= 3
    assert found.covariance.shape == (n, 2 * nv + k, 2 * nv + k)
    assert np.linalg.eigvalsh(found.covariance[n // 2]).min() > -1e-9
