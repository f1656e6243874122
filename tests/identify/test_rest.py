"""Whether a recording starts at rest."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.errors import NotIdentifiableError
from smsid.identify.rest import check_at_rest

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
