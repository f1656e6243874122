"""Which found mode is which described one."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smsid.identify.modes import SAME_MODE, match_modes


def modes(*frequencies: float) -> list:
    return [SimpleNamespace(frequency=f) for f in frequencies]


@pytest.mark.parametrize(
    ("found", "described", "expected"),
    [
        ((0.05, 0.29, 0.80), (0.046, 0.286, 0.801), {0: 0, 1: 1, 2: 2}),
        ((0.29, 0.80), (0.046, 0.286, 0.801), {1: 0, 2: 1}),  # the first is missing: the others stay
        ((0.05, 0.80), (0.046, 0.286, 0.801), {0: 0, 2: 1}),
        ((0.80, 0.05, 0.29), (0.046, 0.286, 0.801), {0: 1, 1: 2, 2: 0}),
        ((0.05, 0.29, 0.80, 1.6), (0.06, 0.37, 1.04), {0: 0, 1: 1, 2: 2}),  # described 30 % too high
        ((0.046, 0.286, 0.801), (0.092, 0.572, 1.602), {0: 0, 1: 1, 2: 2}),  # stiffness four times too high
        ((0.286, 0.801), (0.0205, 0.127, 0.356), {1: 0, 2: 1}),  # two thirds as long
        ((5.0,), (0.046, 0.286), {}),
        ((), (0.046,), {}),
        ((0.05,), (), {}),
    ],
)
def test_matching(found, described, expected):
    assert match_modes(modes(*found), modes(*described)) == expected


@given(st.lists(st.floats(0.01, 10.0), min_size=1, max_size=5, unique=True), st.data())
def test_a_mode_left_out_pushes_no_other(frequencies, data):
    """Of well separated modes any may be missing; the rest find themselves."""
    described = np.cumprod(1.0 + SAME_MODE * np.ones(len(frequencies)) + np.sort(frequencies))
    keep = data.draw(st.lists(st.sampled_from(range(len(described))), unique=True))
    found = match_modes(modes(*described[keep]), modes(*described))
    assert found == {k: i for i, k in enumerate(keep)}
