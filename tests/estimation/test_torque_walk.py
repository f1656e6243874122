"""How torques wander is found as it was drawn, by a likelihood that is a Gaussian density."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from smsid.estimation import _torque_walk as torque_walk
from smsid.estimation._torque_walk import SPAN, _log_likelihood, acceleration_walks

SIGMA = np.array([0.02, 0.05])


def drawn(rng, order, walk, count=1500, step=0.1, integrations=1, jitter=0.0):
    """Return times, readings (N, 2) and root mean square acceleration and jerk of what was drawn."""
    times = np.cumsum(step * (1.0 + jitter * rng.uniform(-1.0, 1.0, count)))
    x = np.zeros((2, integrations + order))
    read, states = np.zeros((count, 2)), np.zeros((count, 2))
    for k in range(count):
        read[k], states[k] = x[:, 0], x[:, integrations]
        h = step if k == count - 1 else times[k + 1] - times[k]
        x[:, -1] += walk * np.sqrt(h) * rng.standard_normal(2)
        for i in range(x.shape[1] - 1):  # Taylor's series of what is constant within the step
            x[:, i] += sum(
                x[:, j] * h ** (j - i) / np.prod(range(1, j - i + 1)) for j in range(i + 1, x.shape[1])
            )
    rises = np.diff(states, axis=0) / np.diff(times)[:, None]
    scales = np.sqrt(np.mean(states**2, axis=0)), np.sqrt(np.mean(rises**2, axis=0))
    return times, read + SIGMA * rng.standard_normal(read.shape), scales


@pytest.mark.parametrize("integrations", [1, 2])
@pytest.mark.parametrize("order", [1, 2])
def test_a_walk_is_found_as_it_was_drawn(order, integrations):
    """To a quarter of a decade: what noise of 0.05 on an angle leaves of the rate of its acceleration."""
    rng, walk = np.random.default_rng(order), 0.3
    times, read, scales = drawn(rng, order, walk, integrations=integrations, jitter=0.3)
    found = acceleration_walks(times, read, SIGMA, integrations, scales)
    assert [f.slope > 0.0 for f in found] == [order == 2] * 2
    np.testing.assert_allclose(np.log10([f.walk for f in found]), np.log10(walk), atol=0.25)


def test_scales_that_are_far_off_are_no_matter():
    rng = np.random.default_rng(3)
    times, read, scales = drawn(rng, 1, 0.3)
    near = acceleration_walks(times, read, SIGMA, 1, scales)
    far = acceleration_walks(times, read, SIGMA, 1, (scales[0], scales[1] / 300.0))
    for a, b in zip(near, far, strict=True):
        assert abs(np.log10(b.walk / a.walk)) < 0.05 and b.slope == a.slope == 0.0


@pytest.mark.parametrize("integrations", [1, 2])
@pytest.mark.parametrize("order", [1, 2])
def test_the_likelihood_is_that_of_a_gaussian_of_all_readings(order, integrations):
    """The covariance of all readings is written down from what each jump does to each."""
    rng, walk, n = np.random.default_rng(5), np.array([[0.2, 0.7]]), 12
    times = np.cumsum(rng.uniform(0.05, 0.15, n))
    start = np.full((2, order), 0.4)
    read = rng.standard_normal((n, 2))
    read[4, 0] = np.nan
    ours = _log_likelihood(times, read, SIGMA, integrations, start, walk)[0]
    passed = times - times[0]
    width = integrations + order
    powers = np.array([passed**i / np.prod(range(1, i + 1)) for i in range(width)])
    for j in range(2):
        first = np.zeros(width)
        first[0] = SIGMA[j] ** 2
        if integrations == 2:
            first[1] = (2.0 * SIGMA[j] / (times[1] - times[0])) ** 2 + 1.0
        first[integrations:] = start[j] ** 2
        covariance = (powers.T * first) @ powers + SIGMA[j] ** 2 * np.eye(n)
        for k in range(n - 1):
            since = np.maximum(times - times[k], 0.0)
            reach = since ** (width - 1) / np.prod(range(1, width))
            covariance += walk[0, j] ** 2 * (times[k + 1] - times[k]) * np.outer(reach, reach)
        there = np.flatnonzero(np.isfinite(read[1:, j])) + 1
        # the filter begins at the first reading, known within its noise
        own = covariance[np.ix_(there, there)]
        density = multivariate_normal(np.full(len(there), read[0, j]), own).logpdf(read[there, j])
        np.testing.assert_allclose(ours[j], density + 0.5 * len(there) * np.log(2.0 * np.pi), rtol=1e-9)


def test_a_long_recording_is_read_in_spans():
    """To a tenth of a decade, as well as a parabola through half decades finds its top."""
    rng = np.random.default_rng(6)
    times, read, scales = drawn(rng, 1, 0.3, count=5 * SPAN)
    found = acceleration_walks(times, read, SIGMA, 1, scales)
    np.testing.assert_allclose([f.walk for f in found], 0.3, rtol=0.3)


def test_clocks_of_others_change_nothing():
    """Nor does a first reading that is missing: a state that began with it told of no walk anything."""
    rng = np.random.default_rng(7)
    times, read, scales = drawn(rng, 1, 0.3)
    alone = acceleration_walks(times, read, SIGMA, 1, scales)
    both = np.sort(np.concatenate([times, times - 0.03]))
    among = np.full((len(both), 2), np.nan)
    among[1::2] = read
    assert acceleration_walks(both, among, SIGMA, 1, scales) == alone
    among[1, 0] = np.nan
    other = acceleration_walks(both, among, SIGMA, 1, scales)
    np.testing.assert_allclose([f.walk for f in other], [f.walk for f in alone], rtol=0.02)


def test_what_was_found_of_a_reading_is_kept_in_any_order(monkeypatch):
    rng = np.random.default_rng(8)
    times, sigma = np.arange(200) * 0.1, np.array([0.02, 0.02, 0.03])
    readings = np.cumsum(rng.normal(0.0, 0.1, (200, 3)), axis=0) + rng.normal(0.0, sigma, (200, 3))
    scales = np.ones(3), np.full(3, 10.0)
    first = acceleration_walks(times, readings, sigma, 1, scales)
    asked = []
    walks = torque_walk._walks
    monkeypatch.setattr(
        torque_walk, "_walks", lambda t, y, *more: asked.append(y.shape[1]) or walks(t, y, *more)
    )
    order = [2, 0, 1]
    again = acceleration_walks(times, readings[:, order], sigma[order], 1, scales)
    assert again == [first[i] for i in order] and not asked
    other = readings.copy()
    other[:, 1] *= 3.0
    changed = acceleration_walks(times, other, sigma, 1, scales)
    assert [changed[0], changed[2]] == [first[0], first[2]] and asked == [1]
    assert changed[1].walk > 2.0 * first[1].walk
    assert changed == walks(times, other, sigma, 1, scales)
