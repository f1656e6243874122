"""Whether a recording starts at rest."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.errors import NotIdentifiableError
from smsid.identify.paper.rest import check_at_rest, starting_value

T = np.arange(2000) / 100.0


def check(samples: np.ndarray, time: np.ndarray = T) -> None:
    check_at_rest("rec", {"the body rate": (time, samples, "rad/s")})


def test_a_start_under_torque_is_rest():
    """Accelerating from the first sample on, with noise a hundredth of the later motion and without."""
    motion = np.column_stack([0.02 * np.sin(0.3 * T), 0.05 * T, -0.01 * T**2])
    check(motion)
    check(motion + 1e-3 * np.random.default_rng(0).standard_normal(motion.shape))


def test_false_alarms_are_rare():
    """Noise alone, 300 seeds: six sigmas of a fit to 100 samples are never passed."""
    for seed in range(300):
        check(np.random.default_rng(seed).standard_normal((2000, 3)))


def test_a_bias_that_does_not_matter_is_rest():
    check(1e-4 + 0.05 * np.sin(0.3 * T)[:, None])


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_moving_is_told_with_size_and_unit(noise: float):
    motion = 0.01 + 0.02 * np.sin(0.3 * T)[:, None] * np.ones(3)
    noisy = motion + noise * np.random.default_rng(0).standard_normal(motion.shape)
    with pytest.raises(NotIdentifiableError, match=r"'rec' .* the body rate is 0.0\d+ rad/s") as caught:
        check(noisy)
    assert caught.value.evidence["start"] == pytest.approx([0.01] * 3, abs=2e-3)
    assert "from before the motion began" in str(caught.value)


def test_slow_sensors_use_more_than_a_second():
    t = np.arange(40) / 2.0
    check(0.05 * np.sin(0.1 * t)[:, None], t)
    with pytest.raises(NotIdentifiableError, match="not start at rest"):
        check(0.05 * np.cos(0.1 * t)[:, None], t)


def test_too_few_samples_say_nothing():
    check(np.ones((3, 3)), T[:3])
    check(np.zeros((2000, 0)))


@pytest.mark.parametrize("rate", [20.0, 100.0, 1000.0])
@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
@pytest.mark.parametrize("fast", [3.0, 10.0, 30.0])
def test_a_joint_that_is_fast_within_the_first_second_starts_at_rest(rate: float, noise: float, fast: float):
    """Exactly at rest at t = 0, to and fro before the second is over: no cubic describes all of it."""
    t = np.arange(round(20.0 * rate)) / rate
    if fast / rate > 0.5:
        pytest.skip("not enough samples of the motion to say anything")
    motion = 0.4 * np.sin(fast * t) ** 2 * np.exp(-t / 3.0)
    samples = motion + noise * np.random.default_rng(1).standard_normal(len(t))
    check(np.column_stack([samples, 0.1 * samples]), t)


@pytest.mark.parametrize("fast", [3.0, 30.0])
def test_moving_fast_from_before_is_told(fast: float):
    """The same motions cut out later, at a size a fifth of the largest."""
    motion = 0.4 * np.sin(fast * T + 0.45)[:, None]
    noisy = motion + 1e-3 * np.random.default_rng(2).standard_normal(motion.shape)
    for samples in (motion, noisy):
        with pytest.raises(NotIdentifiableError, match="not start at rest"):
            check(samples)


def test_the_interval_of_the_start_holds():
    """z of a start of 2 mrad/s under a motion of several hertz: standard normal over 300 draws."""
    z = []
    for seed in range(300):
        noise = 1e-3 * np.random.default_rng(seed).standard_normal(len(T))
        found = starting_value(T, 0.002 + 0.3 * np.sin(9.0 * T) ** 2 + noise)
        z.append((found.value - 0.002) / found.sigma)
    assert 0.85 < np.std(z) < 1.3 and abs(np.mean(z)) < 0.35
    assert np.abs(z).max() < 5.0


def test_quantised_and_resting_sensors_start_at_rest():
    """A tachometer that counts: zeros, then steps; no noise of its own."""
    check(np.round(0.5 * T**2 / 0.05)[:, None] * 0.05)
    check(np.zeros((2000, 2)))
