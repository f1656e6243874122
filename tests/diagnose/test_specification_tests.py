"""Generic tests are sorted by their significance, however far beyond what a double can hold."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from smsid.diagnose._unknown_input import disturbances
from smsid.diagnose.specification_tests import PAST, SpecificationTest, _log_chance, band_tests
from smsid.estimation.bias_walk import BiasWalk
from smsid.estimation.kalman import run_filter

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


def test_misfit_is_said_by_channel_and_band(plain):
    """White noise fills no band; a sine of amplitude a among N samples has a^2 N / 2 in its own."""
    rng = np.random.default_rng(4)
    run, data = plain.run, plain.problem.data
    n, rows = run.normalised.shape
    white = rng.standard_normal((n, rows))
    used = np.ones((n, rows), dtype=bool)
    quiet = replace(plain, run=replace(run, normalised=white, used=used))
    assert band_tests(quiet, np.ones(rows)) == []
    block = next(b for b in data.blocks if b.channel == "encoder.joint_velocity")
    width, highest = block.rows.stop - block.rows.start, 0.5 / float(np.median(np.diff(data.times)))
    cycles, size = n // 20, 20.0  # a tenth of the highest frequency
    loud = white.copy()
    loud[:, block.rows.start] += size * np.sin(2 * np.pi * cycles * np.arange(n) / n)
    factors = np.full(rows, 2.0)  # the noise was raised to it: errors are half of what they are in the stated
    (one,) = band_tests(replace(plain, run=replace(run, normalised=loud / 2.0, used=used)), factors)
    assert (one.where, one.location) == ("encoder.joint_velocity",) * 2
    low, high = highest / 16, highest / 4
    assert one.dependence.startswith(f"frequency, {low:.2g} to {high:.2g} Hz (")
    inside = 2.0 * np.sum((np.arange(n // 2 + 1) > n / 32) & (np.arange(n // 2 + 1) <= n / 8)) * width
    assert one.freedom == inside
    assert one.ratio == pytest.approx(size**2 * n / 2 + inside, rel=0.1)


def test_disturbances_beside_a_bias_that_hardly_wanders_are_those_without(known, problem):
    model = known.point.model()
    column = np.zeros(problem.data.rows)
    column[0] = 1.0
    walks = (BiasWalk(column, 1e-12),)
    one, two = (disturbances(run_filter(model, p)) for p in (problem, replace(problem, bias_walks=walks)))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-5, atol=1e-6 * np.abs(a).max())
