"""The joints' motion eliminated in time order: what dense normal equations give, at a cost linear in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from smsid.likelihood.fit import fit
from smsid.likelihood.jacobian import columns
from smsid.likelihood.normal import normal_at
from smsid.likelihood.nuisance_parameters import Nuisance
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import Evaluation, SearchPoint, step_point
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm, piece_of
from smsid.likelihood.spline import DEGREE, DerivativeSamples, fit_motion, inverse_bands

from . import twin


@pytest.fixture(scope="module", params=["few knots", "a knot at every other node", "clocks sought"])
def case(request: pytest.FixtureRequest) -> tuple[RecordingTerm, Evaluation, Prior]:
    """Twelve seconds: four stretches of nodes at a point away from the maximum."""
    clocks = ("imu", "panel") if request.param == "clocks sought" else ()
    driving = request.param == "clocks sought"
    nuisance = Nuisance(scale={"imu.acceleration": 0.01}, clocks=clocks, driving_clocks=driving)
    piece, local = piece_of(twin.model(), twin.noisy(twin.exp2(12.0), 0), nuisance)
    if request.param == "a knot at every other node":
        joints = piece.drive.joints
        assert joints is not None
        finer = joints.divided(8)
        piece = piece.with_joints(joints.refitted(8 * joints.intervals))
        local = replace(local, motion=finer.coefficients)
    piece = piece.following()
    at = Parameters.of(twin.model())
    rng = np.random.default_rng(3)
    local = replace(local, motion=local.motion + 1e-5 * rng.standard_normal(local.motion.shape))
    at = at.moved(0.01 * rng.standard_normal(at.size))
    # what is known of the bodies to 1 %: a covariance that 16 digits tell to nine
    return piece, Evaluation.at([piece], SearchPoint(at, (local,))), Prior(at, 0.01)


def dense(piece: RecordingTerm, seen: Evaluation) -> tuple[np.ndarray, np.ndarray]:
    """Information and gradient of data and encoders, by (parameters, local ones, coefficients)."""
    at, (local,) = seen.point.parameters, seen.point.locals
    found = columns(piece, at, local, seen.predictions[0])
    n = found[0].shape[2]
    information, gradient = np.zeros((n, n)), np.zeros(n)
    for c, own, r in zip(piece.channels, found, seen.residuals[0], strict=True):
        rows = c.coarse_weights @ (c.whitening @ own).reshape(len(own), -1)
        rows = rows.reshape(-1, n)
        information += rows.T @ rows
        gradient += rows.T @ (r @ c.whitening.T).ravel()
    encoder = piece.encoders(local)
    m, joints = local.motion.shape
    first = n - m * joints
    for j in range(joints):
        place = first + np.arange(m) * joints + j
        band = sum(np.diag(encoder.bands[j, d, : m - d], -d) for d in range(DEGREE + 1))
        information[np.ix_(place, place)] += band + np.tril(band, -1).T
    gradient[first:] += encoder.gradient.ravel()
    clock = [at.size + s.start for s in piece.encoder_clocks]
    if clock:
        information[np.ix_(clock, clock)] += encoder.of_clock
        information[first:, clock] += encoder.by_clock.reshape(-1, 2)
        information[clock, first:] += encoder.by_clock.reshape(-1, 2).T
        gradient[clock] += encoder.clock_gradient
    return information, gradient


def test_step_and_covariance_are_those_of_dense_normal_equations(case):
    piece, seen, prior = case
    found = normal_at([piece], seen, prior)
    k = len(found.gradient)
    information, gradient = dense(piece, seen)
    information[:k, :k] += found.prior
    off, jacobian = prior.residual(seen.point.parameters)
    gradient[: jacobian.shape[1]] -= jacobian.T @ off
    _, pull, _ = piece.prior(seen.point.locals[0])
    gradient[jacobian.shape[1] : k] += pull
    scale = 1.0 / np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    sigma = np.sqrt(np.diag(inverse)[:k])
    np.testing.assert_allclose(
        found.covariance() / np.outer(sigma, sigma), inverse[:k, :k] / np.outer(sigma, sigma), atol=1e-8
    )
    step = inverse @ gradient
    own = found.covariance() @ found.gradient
    np.testing.assert_allclose(own / sigma, step[:k] / sigma, atol=1e-8 * np.abs(step[:k] / sigma).max())
    (motion,) = found.motion_steps(own)
    assert motion is not None
    expected = step[k:].reshape(motion.shape)
    np.testing.assert_allclose(motion, expected, atol=1e-8 * np.abs(expected).max())
    gain = found.motion_gain + own @ found.gradient
    assert gain == pytest.approx(gradient @ step, rel=1e-9)


def test_along_the_ridge_the_joints_follow_one_parameter(case):
    """Without the Newton step: the least sum of squares for a parameter that is held elsewhere."""
    piece, seen, prior = case
    found = normal_at([piece], seen, prior)
    k = len(found.gradient)
    information, _ = dense(piece, seen)
    step = 0.01 * np.sin(np.arange(1.0, k + 1.0))
    (motion,) = found.motion_steps(step, newton=False)
    expected = -np.linalg.solve(information[k:, k:], information[k:, :k] @ step)
    assert motion is not None
    np.testing.assert_allclose(motion.ravel(), expected, atol=1e-8 * np.abs(expected).max())


def test_units_of_a_step_do_not_move_the_joints(case):
    piece, seen, prior = case
    found = normal_at([piece], seen, prior)
    units = np.exp(np.sin(np.arange(len(found.gradient))))
    step = np.cos(np.arange(len(units)))
    (a,), (b,) = found.motion_steps(step), found.scaled(units).motion_steps(step / units)
    assert a is not None and b is not None
    np.testing.assert_allclose(a, b, atol=1e-9 * np.abs(a).max())


def test_a_gap_of_the_encoders_is_bridged_by_what_else_is_known():
    """Two seconds without a reading: other sensors and smoothness tell, and the search comes to rest."""
    recording = twin.noisy(twin.exp2(20.0), 1)
    gone = {}
    for name in recording.channels:
        times, values = recording.time(name), np.array(recording[name])
        if name.startswith("encoder."):
            values[(times > 8.0) & (times < 10.0)] = np.nan
        gone[name] = (times, values)
    labels = {"joint": list(twin.model().arm_joints.names), "wheel": list(twin.model().wheels.names)}
    holed = type(recording).from_arrays(None, gone, labels=labels, role="estimation", name="exp2")
    piece, local = piece_of(twin.model(), holed, Nuisance())
    at = Parameters.of(twin.model())
    found = fit([piece], SearchPoint(at, (local,)), Prior(at))
    assert found.pieces[0].follows
    assert found.cost / found.samples == pytest.approx(1.0, abs=0.05)


def test_the_step_of_the_joints_lowers_the_cost_by_what_it_says(case):
    """From near the maximum, everything else held: the gain of the motion alone."""
    piece, seen, prior = case
    found = normal_at([piece], seen, prior)
    still = np.zeros(len(found.gradient))
    # a small part of the way, where the sum of squares is a parabola: twice the part is gained
    part = [x if x is None else 1e-3 * x for x in found.motion_steps(still)]
    there = Evaluation.at([piece], step_point([piece], seen.point, still, part))
    lowered = seen.cost([piece], prior) - there.cost([piece], prior)
    # derivatives are carried on steps twice as long
    assert lowered == pytest.approx((2e-3 - 1e-6) * found.motion_gain, rel=0.02)


def test_inverse_within_the_band():
    rng = np.random.default_rng(0)
    times = np.linspace(0.0, 10.0, 300)
    values = rng.standard_normal((300, 2))
    motion = fit_motion([DerivativeSamples(0, times, values, np.array([1.0, 0.1]))], 0.0, 10.0, 30.0, 0.5)
    found = inverse_bands(motion.information)
    m = motion.information.shape[2]
    for own, bands in zip(found, motion.information, strict=True):
        lower = sum(np.diag(bands[d, : m - d], -d) for d in range(DEGREE + 1))
        expected = np.linalg.inv(lower + np.tril(lower, -1).T)
        for d in range(DEGREE + 1):
            np.testing.assert_allclose(own[d, : m - d], np.diag(expected, -d), rtol=1e-7, atol=1e-12)
