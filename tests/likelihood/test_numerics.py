"""The numerical parts: pseudo-inertia, integration rule, interpolation, splines."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import BSpline
from scipy.linalg import expm
from scipy.sparse import csr_array

from smsid.errors import DescriptionError
from smsid.likelihood.channels import Channel, gram_root
from smsid.likelihood.normal import Normal
from smsid.likelihood.pseudo_inertia import (
    factor,
    is_body,
    parameters_at,
    parameters_of,
    step_factor,
    tangent,
)
from smsid.likelihood.spline import DEGREE, DerivativeSamples, along, basis_sums, fit_motion
from smsid.likelihood.time_grid import PLACES, A, B, C, Timeline, stage_values, transitions


def bodies() -> list[np.ndarray]:
    """Clouds of point masses, flat ones among them."""
    rng = np.random.default_rng(3)
    found = []
    for k in range(20):
        points = rng.standard_normal((6, 3)) * [1.0, 1.0, 0.01 if k % 2 else 1.0] + rng.standard_normal(3)
        masses = rng.uniform(1.0, 10.0, 6)
        total = np.zeros(10)
        for m, r in zip(masses, points, strict=True):
            total += pin.Inertia(m, r, np.zeros((3, 3))).toDynamicParameters()
        found.append(total)
    return found


def test_factor_reproduces_the_parameters():
    for theta in bodies():
        np.testing.assert_allclose(parameters_of(factor(theta)), theta, rtol=1e-12, atol=1e-12)


def test_any_step_leads_to_a_body_that_can_exist():
    rng = np.random.default_rng(0)
    for theta in bodies():
        there = parameters_of(step_factor(factor(theta), 0.5 * rng.standard_normal(10)))
        assert is_body(there)


def test_tangent_is_the_derivative():
    for theta in bodies():
        lower = factor(theta)
        h = 1e-6
        for k, column in enumerate(tangent(lower).T):
            step = h * np.eye(10)[k]
            found = (parameters_of(step_factor(lower, step)) - parameters_of(step_factor(lower, -step))) / (
                2 * h
            )
            np.testing.assert_allclose(column, found, atol=1e-8 * np.abs(theta).max())


def test_parameters_far_away_and_their_slopes_are_those_of_the_factor_there():
    rng = np.random.default_rng(1)
    for theta in bodies():
        lower, phi, h = factor(theta), 0.5 * rng.standard_normal(10), 1e-6
        there, slope = parameters_at(lower, phi)
        size = np.abs(there).max()
        np.testing.assert_allclose(there, parameters_of(step_factor(lower, phi)), atol=1e-12 * size)
        for column, step in zip(slope.T, h * np.eye(10), strict=True):
            ends = [parameters_of(step_factor(lower, phi + s * step)) for s in (1.0, -1.0)]
            np.testing.assert_allclose(column, (ends[0] - ends[1]) / (2 * h), atol=1e-8 * size)
        np.testing.assert_allclose(parameters_at(lower, np.zeros(10))[1], tangent(lower), atol=1e-12 * size)


def test_a_flat_body_is_refused():
    rod = pin.Inertia(1.0, np.zeros(3), np.diag([0.0, 1.0, 1.0])).toDynamicParameters()
    assert not is_body(rod)
    with pytest.raises(DescriptionError):
        factor(pin.Inertia(1.0, np.zeros(3), np.diag([3.0, 1.0, 1.0])).toDynamicParameters(), "wide")


def test_tableau_is_consistent():
    np.testing.assert_allclose(A.sum(axis=1), C, atol=1e-15)
    np.testing.assert_allclose([B @ C**k for k in range(6)], 1.0 / np.arange(1, 7), rtol=1e-13)


def test_integration_is_of_order_six():
    """A forced oscillator: halving the step divides the error by 64."""
    rate = np.array([[0.0, 1.0], [-4.0, -0.1]])
    errors = []
    for n in (20, 40, 80):
        h = np.full(n, 5.0 / n)
        times = np.arange(n)[:, None] * h[0] + h[0] * np.array(PLACES)
        drive = np.stack([np.zeros_like(times), np.cos(times)], -1)
        phi, gamma = transitions([np.broadcast_to(rate, (n, 2, 2))] * 7, h)
        x = np.array([1.0, 0.0])
        for a, b, d in zip(phi, gamma.reshape(n, 2, -1), drive.reshape(n, -1), strict=True):
            x = a @ x + b @ d
        # the oscillator with (cos, sin) as two more states
        big = np.zeros((4, 4))
        big[:2, :2], big[1, 2], big[2, 3], big[3, 2] = rate, 1.0, -1.0, 1.0
        exact = expm(5.0 * big) @ [1.0, 0.0, 1.0, 0.0]
        errors.append(np.abs(x - exact[:2]).max())
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 6.0, atol=0.5)


def test_stages_are_those_of_the_step():
    """What the stages' slopes sum to is the map of the step, for a rate that is another at every stage."""
    rng = np.random.default_rng(0)
    rate, h = list(rng.standard_normal((7, 5, 3, 3))), rng.uniform(0.1, 0.3, 5)
    starts = rng.standard_normal((5, 3))
    stages = stage_values(rate, starts, h)
    end = starts + h[:, None] * np.einsum("j,jnab,jnb->na", B, np.array(rate), stages)
    phi, _ = transitions(rate, h)
    np.testing.assert_allclose(np.einsum("nab,nb->na", phi, starts), end, rtol=1e-12)


def test_interpolation_never_crosses_a_jump():
    line = Timeline.of(0.0, 12.0, [4.0], 0.1)
    node_times = line.evaluations[line.node_evaluation]
    segment = line.evaluation_segment[line.node_evaluation]
    values = np.sin(3 * node_times) + 5.0 * segment
    times = np.linspace(0.0, 12.0, 1201)
    expected = np.sin(3 * times) + 5.0 * (times >= 4.0 - 1e-9)
    # (w h)^8 / 8! times the largest product of distances to eight nodes, 630 in the outermost interval
    bound = 0.3**8 / 40320 * 630 * 1.1
    np.testing.assert_allclose(line.interpolation(times) @ values, expected, rtol=0.0, atol=bound)


def test_spline_takes_positions_and_rates_and_states_its_error():
    """Angle and rate within what the densities say: over 40 draws the mean square is one."""
    times = np.arange(0.0, 40.0, 0.01)
    angle, rate = np.sin(0.7 * times), 0.7 * np.cos(0.7 * times)
    scores = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        samples = [
            DerivativeSamples(
                0, times, (angle + 1e-5 * rng.standard_normal(len(times)))[:, None], np.array([1e-5])
            ),
            DerivativeSamples(
                1, times, (rate + 1e-4 * rng.standard_normal(len(times)))[:, None], np.array([1e-4])
            ),
        ]
        motion = fit_motion(samples, 0.0, times[-1], 100.0, 0.1)
        q, qd, _ = motion.values(times)
        share = (motion.intervals + 5) / len(times)
        scores.append(
            [
                np.mean((q[:, 0] - angle) ** 2) / (motion.angle_density[0] ** 2 * share),
                np.mean((qd[:, 0] - rate) ** 2) / (motion.rate_density[0] ** 2 * share),
            ]
        )
        assert motion.rate_density[0] < 1e-4  # positions help
    np.testing.assert_allclose(np.mean(scores, axis=0), 1.0, atol=0.25)


def test_a_sum_that_is_known_far_better_than_its_terms_has_the_deviation_of_exact_arithmetic():
    """From the covariance it was the root of a negative number, or rounding."""
    n, small = 3, 3e-7
    prior, sums = np.eye(n), np.ones((n, n)) / small**2
    found = Normal(sums, prior, np.zeros(n))
    (variance,) = found.covariance_of(np.ones((1, n))).ravel()
    assert variance == pytest.approx(1.0 / (1.0 / small**2 + 1.0 / n), rel=1e-6)
    rows = np.random.default_rng(3).normal(size=(2, n - 1))
    mild = Normal(np.diag([1.0, 4.0, 9.0]) + 0.5, prior, np.zeros(n))
    expected = rows @ np.linalg.inv(mild.information)[:2, :2] @ rows.T
    np.testing.assert_allclose(mild.covariance_of(rows), expected, rtol=1e-12)


def test_a_prior_beside_a_million_samples_is_not_lost_in_rounding():
    """One sum is known 1e10 times better than before, another hardly, one not at all: rounding hides that."""
    basis, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    noise = 3e3 * np.random.default_rng(1).normal(size=(3, 3))  # what sums of 1e20 are rounded to
    data = (basis * [1e20, 1e10, 0.0]) @ basis.T + noise + noise.T
    found = Normal(data, np.eye(3), data @ basis[:, 1] * 1e-3 + 1e4 * basis[:, 2])
    strong, weak, unseen = (float(found.covariance_of(row[None])[0, 0]) for row in basis.T)
    assert strong == pytest.approx(1e-20, rel=1e-3) and unseen == pytest.approx(1.0, rel=1e-6)
    assert 1e-10 < weak <= 1.0 + 1e-9  # known less than rounding: not told rather than told wrong
    assert abs(basis[:, 2] @ found.solved()) < 1e-6  # a gradient of rounding leads nowhere


def test_a_step_takes_its_part_off_the_gradient():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(9, 4))
    found = Normal(root.T @ root, np.eye(4), rng.normal(size=4), pull=rng.normal(size=4))
    np.testing.assert_allclose(found.after(found.solved()).gradient, 0.0, atol=1e-12)
    held, damped = found.solved(np.array([True, True, False, True])), found.solved(damping=1e3)
    free = np.ix_([0, 1, 3], [0, 1, 3])
    np.testing.assert_allclose(found.information[free] @ held, found.gradient[[0, 1, 3]], atol=1e-12)
    diagonal = np.diag(np.diag(found.information))
    np.testing.assert_allclose((found.information + 1e3 * diagonal) @ damped, found.gradient, atol=1e-9)


@pytest.mark.parametrize("derivative", [0, 1])
def test_sums_of_a_spline_are_those_of_its_design(derivative):
    rng = np.random.default_rng(4)
    knots = np.concatenate([[0.0] * DEGREE, np.linspace(0.0, 10.0, 14), [10.0] * DEGREE])
    times, columns = np.sort(rng.uniform(-1.0, 10.0, 300)), rng.normal(size=(300, 2))
    unit = [BSpline(knots, row, DEGREE) for row in np.eye(len(knots) - DEGREE - 1)]
    x = np.column_stack([along(b, times, derivative) for b in unit])
    gram, sums = basis_sums(times, knots, derivative, columns)
    for d, own in enumerate(gram):
        np.testing.assert_allclose(own[: len(own) - d], np.diag(x.T @ x, -d), atol=1e-10)
    np.testing.assert_allclose(sums, x.T @ columns, atol=1e-10)


def test_knots_of_a_long_record_are_those_that_its_liveliest_part_needs():
    """Ten seconds of 0.5 Hz in ten minutes of rest at 100 Hz."""
    times = np.arange(60_000) / 100.0
    window = np.exp(-(((times - 433.0) / 4.0) ** 2))
    exact = window * np.sin(np.pi * times)
    noisy = exact + 1e-4 * np.random.default_rng(5).standard_normal(len(times))
    motion = fit_motion(
        [DerivativeSamples(0, times, noisy[:, None], np.array([1e-4]))], 0.0, times[-1], 100.0, 0.1
    )
    assert motion.spacing < 1.0
    assert np.abs(motion.values(times)[0][:, 0] - exact).max() < 3e-4


def test_a_channel_without_some_samples_shares_its_weights():
    timeline = Timeline.of(0.0, 4.0, [], 0.1)
    times, rng = np.linspace(0.0, 4.0, 301), np.random.default_rng(6)
    weights, coarse = timeline.interpolation(times), timeline.coarse.interpolation(times)
    root = gram_root(csr_array(coarse.T @ coarse))
    sensor: Any = SimpleNamespace(name="imu")
    whole = Channel(
        sensor, "angular_rate", times, rng.normal(size=(301, 2)), np.eye(2), weights, coarse, root
    )
    kept = rng.uniform(size=301) > 0.1
    once = whole.only(kept)
    twice = once.only(np.arange(len(once.times)) != 7)
    rows = np.delete(np.flatnonzero(kept), 7)
    nodes, own = rng.normal(size=(41, 2)), coarse.toarray()[rows]
    np.testing.assert_allclose(twice.residual(nodes, None), whole.values[rows] - (weights @ nodes)[rows])
    np.testing.assert_allclose(twice.to_coarse(twice.values), own.T @ twice.values, atol=1e-12)
    np.testing.assert_allclose((twice.root.T @ twice.root).toarray(), own.T @ own, atol=1e-7)
    assert twice.weights is whole.weights and twice.dropped == 301 - len(rows)
