"""Which combinations a motion tells does not depend on how their names are rounded."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.model.identifiable import base_parameters

NAMES, UNITS = ["a", "b", "c"], ["kg"] * 3


def regressor(factor: float) -> np.ndarray:
    rows = np.random.default_rng(1).normal(size=(50, 2))
    return np.column_stack([rows, factor * rows[:, 0]])


@pytest.mark.parametrize("off", [-1e-12, 1e-12])
def test_half_way_between_two_roundings_is_no_other_combination(off):
    one, other = (base_parameters(regressor(0.030625 + x), NAMES, UNITS) for x in (0.0, off))
    assert one.unlike(other) == ()
    assert one.names == other.names == ("a + 0.03062 c", "b")


def test_another_factor_is_named():
    one, other = (base_parameters(regressor(x), NAMES, UNITS) for x in (0.03, 0.04))
    assert one.unlike(other) == ("a + 0.03 c",)


def test_a_combination_lost_is_named():
    full = np.random.default_rng(2).normal(size=(50, 3))
    one, other = base_parameters(full, NAMES, UNITS), base_parameters(regressor(0.03), NAMES, UNITS)
    assert one.unlike(other) == ("c", "a")
