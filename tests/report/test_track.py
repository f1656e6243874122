"""What a page on a track says of the model: larger innovations are a warning, smaller ones are none."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from smsid.report.track import verdict


@pytest.mark.parametrize(
    ("size", "tone", "said"),
    [(1.0, "good", "stated noise: the model holds"), (2.0, "warn", "larger than expected: gyro.rate (2)")],
)
def test_the_sentence_goes_by_the_size_of_innovations(size, tone, said):
    sentence, found = verdict(_history(size))  # pyright: ignore[reportArgumentType]
    assert found == tone and said in sentence


def test_innovations_below_a_wide_noise_are_no_alarm():
    sentence, tone = verdict(_history(0.1))  # pyright: ignore[reportArgumentType]
    assert tone == "good" and "gyro.rate (0.1)" in sentence and "stated wide" in sentence


def _history(size: float) -> SimpleNamespace:
    fit = np.random.default_rng(1).standard_normal((400, 2)) * [1.0, size]
    return SimpleNamespace(fit=fit, channels=("pose.position", "gyro.rate"))
