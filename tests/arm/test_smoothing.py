"""Smoothing splines whose cutoff and noise are found: errors are as large as they say."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.arm._smoothing import JointSamples, smooth_joint

NONE = np.zeros(0)


def motion(t):
    """A joint's angle, rate and acceleration: three sines."""
    size, omega = np.array([0.5, 0.3, 0.1]), 2.0 * np.pi * np.array([0.1, 0.25, 0.6])
    arg = omega * t[:, None] + np.array([0.0, 1.0, 2.0])
    return (
        (size * np.sin(arg)).sum(1),
        (size * omega * np.cos(arg)).sum(1),
        -(size * omega**2 * np.sin(arg)).sum(1),
    )


@pytest.mark.parametrize(("rate", "noise"), [(100.0, 2e-4), (125.0, 5e-5), (500.0, 1e-5)])
def test_errors_of_angle_rate_and_acceleration_are_as_large_as_told(rate, noise, rng):
    t = np.arange(0.0, 20.0, 1.0 / rate)
    truth = motion(t)
    found = smooth_joint([JointSamples(t, truth[0] + noise * rng.normal(size=t.size), NONE, NONE)])
    assert found.noise == pytest.approx(noise, rel=0.1)
    inner = (t > found.edge) & (t < 20.0 - found.edge)
    for d, sigma in enumerate(found.sigma):
        error = (found.splines[0](t, nu=d) - truth[d])[inner]
        assert 0.5 * sigma < np.sqrt(np.mean(error**2)) < 1.5 * sigma
    # far less than differences of the samples have, and no bias
    assert found.sigma[1] < 0.05 * noise * rate


def test_samples_far_closer_than_knots_lose_nothing_by_being_averaged(rng):
    t = np.arange(0.0, 20.0, 1.0 / 2000.0)
    samples = JointSamples(t, motion(t)[0] + 1e-4 * rng.normal(size=t.size), NONE, NONE)
    found = smooth_joint([samples])
    assert len(found.splines[0].c) < 0.1 * t.size
    assert found.noise == pytest.approx(1e-4, rel=0.05)  # of a sample, not of a mean
    inner = (t > found.edge) & (t < 20.0 - found.edge)
    for d, sigma in enumerate(found.sigma):
        error = (found.splines[0](t, nu=d) - motion(t)[d])[inner]
        assert 0.5 * sigma < np.sqrt(np.mean(error**2)) < 1.5 * sigma


def test_a_measured_rate_makes_the_motion_better_known(rng):
    t = np.arange(0.0, 20.0, 0.008)
    q, v, a = motion(t)
    angles = q + 5e-4 * rng.normal(size=t.size)
    rates = v + 2e-4 * rng.normal(size=t.size)
    without, both = (smooth_joint([JointSamples(t, angles, *more)]) for more in ((NONE, NONE), (t, rates)))
    assert both.rate_noise == pytest.approx(2e-4, rel=0.15)
    inner = slice(300, -300)
    errors = [np.std((s.splines[0](t, nu=2) - a)[inner]) for s in (without, both)]
    assert errors[1] < 0.5 * errors[0] and both.sigma[2] < 0.5 * without.sigma[2]


def test_jitter_and_a_gap_are_no_obstacle(rng):
    t = np.cumsum(rng.uniform(0.008, 0.013, 2000))
    pieces = [t[:900], t[1100:]]
    samples = [JointSamples(p, motion(p)[0] + 1e-4 * rng.normal(size=p.size), NONE, NONE) for p in pieces]
    found = smooth_joint(samples)
    assert found.noise == pytest.approx(1e-4, rel=0.1)
    for spline, p in zip(found.splines, pieces, strict=True):
        assert np.std((spline(p, nu=1) - motion(p)[1])[100:-100]) < 2.0 * found.sigma[1]
