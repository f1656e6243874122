"""Generic tests are sorted by their significance, however far beyond what a double can hold."""

import numpy as np
import pytest
from scipy.stats import chi2

from smsid.diagnose.specification_tests import PAST, SpecificationTest, _log_chance

SWITCH = 1000.0  # ratio from which the chance is that of its expansion
FREEDOMS = [1, 2, 3, 8, 18, 54]


@pytest.mark.parametrize("freedom", FREEDOMS)
def test_the_expansion_is_the_chance_where_that_can_be_computed(freedom):
    """What the first term leaves out is (freedom - 2) / ratio of the chance, and less than twice that."""
    for ratio in (SWITCH, 1100.0, 1200.0, 1400.0):
        exact = chi2.logsf(ratio, freedom)
        assert np.isfinite(exact)
        off = exact - _log_chance(ratio, freedom)
        assert abs(off) <= 2.0 * abs(freedom - 2) / ratio + 1e-9 * abs(exact)
    below = np.nextafter(SWITCH, 0.0)
    assert _log_chance(below, freedom) == pytest.approx(chi2.logsf(below, freedom), rel=1e-12)


@pytest.mark.parametrize("freedom", FREEDOMS)
def test_more_is_less_likely_also_beyond_what_underflows(freedom):
    assert chi2.sf(2000.0, freedom) == 0.0  # what the expansion is for
    ratios = np.concatenate([np.arange(900.0, 1100.0), np.geomspace(1100.0, 1e12, 200)])
    chances = np.array([_log_chance(r, freedom) for r in ratios])
    assert np.isfinite(chances).all()
    assert (np.diff(chances) < 0.0).all()


def test_of_two_that_no_double_can_hold_the_more_significant_is_first():
    few, many = SpecificationTest("a", "rate", 5000.0, 1), SpecificationTest("b", "angle", 5000.0, 54)
    more = SpecificationTest("c", "time", 5001.0, 1)
    assert few.p_value == many.p_value == more.p_value == 0.0
    assert sorted([many, few, more], key=lambda b: b.order) == [more, few, many]


def test_correlation_in_time_is_last_however_significant():
    symptom = SpecificationTest("imu.acceleration[x]", PAST, 1e9, 8)
    weak, empty = (
        SpecificationTest("torque of joint2", "angle", 3.0, 4),
        SpecificationTest("torque of joint1", "load", 0.0, 0),
    )
    assert sorted([symptom, empty, weak], key=lambda b: b.order) == [weak, empty, symptom]
