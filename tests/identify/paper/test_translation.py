"""Exp. 1 along one axis against Newton's equations solved exactly, with and without noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify.paper._translation import AxisData, AxisEstimate, PanelForce, identify_axis, panel_weights
from smsid.identify.paper.combined import combine

from ..support import PARTICIPATION, SHAPES, TANK, TWO_TANKS, M, fly_exp1

CASES = pytest.mark.parametrize("panel", [False, True], ids=["rigid", "panel"])


def truth(tanks, panel: bool) -> np.ndarray:
    return np.array([M, *(x for tank in tanks for x in tank), *([1.0] if panel else [])])


def axis_data(
    tanks, panel: bool, rate: float = 100.0, noise: float = 1e-9, rng=None, bias=0.0, **more
) -> AxisData:
    """One flight; with ``rng`` white noise of size ``noise`` on base and stations."""
    t, force, acceleration = fly_exp1(tanks, panel=panel, rate=rate)
    base = acceleration[:, 0] + bias
    stations = acceleration[:, :1] + acceleration[:, 1 + len(tanks) :] @ SHAPES.T if panel else None
    if rng is not None:
        base = base + noise * rng.standard_normal(base.shape)
        stations = stations + noise * rng.standard_normal(stations.shape) if panel else None
    if not panel:
        return AxisData("x", t, force, base, noise)
    w = panel_weights(SHAPES, PARTICIPATION)
    p = (stations - base[:, None]) @ w
    return AxisData("z", t, force, base, noise, (PanelForce("rho", p, w, noise),))


@CASES
@pytest.mark.parametrize("tanks", [(), (TANK,), TWO_TANKS], ids=["no tank", "one tank", "two tanks"])
def test_exact_recovery(tanks, panel: bool):
    """Only the trapezoids' second order in the step is left: a quarter of the error at half the step."""
    errors = []
    for rate in (100.0, 200.0):
        found = identify_axis(axis_data(tanks, panel, rate), len(tanks))
        errors.append(np.abs(found.values / truth(tanks, panel) - 1.0))
    assert errors[0].max() < 5e-5
    if tanks:
        assert errors[0].max() / errors[1].max() == pytest.approx(4.0, rel=0.1)


def test_parameters_as_24_lists_them():
    """[1/m_r, k/(m_r m_s), k M/(m_r m_s), b/(m_r m_s), b M/(m_r m_s)], with the errata's m_r for a_1."""
    m_s, k, b = TANK
    m_r = M - m_s
    expected = [1 / m_r, k / (m_r * m_s), k * M / (m_r * m_s), b / (m_r * m_s), b * M / (m_r * m_s)]
    np.testing.assert_allclose(identify_axis(axis_data((TANK,), False)).pi, expected, rtol=2e-6)


def test_parameters_as_27_lists_them():
    """(1/m_r) [1, rho, k/m_s, k rho/m_s, k M/m_s, b/m_s, b rho/m_s, b M/m_s], rho as a factor."""
    m_s, k, b = TANK
    expected = np.array([1, 1, *np.array([1, 1, M]) * k / m_s, *np.array([1, 1, M]) * b / m_s]) / (M - m_s)
    # at 100 Hz the trapezoids leave 3e-5 on b rho/m_s, 2e-6 elsewhere
    np.testing.assert_allclose(identify_axis(axis_data((TANK,), True)).pi, expected, rtol=5e-5)


def test_density_is_the_panels_factor():
    """Described 30 % too light: p is too small by that, rho the larger."""
    data = axis_data((TANK,), True)
    (panel,) = data.panels
    light = replace(data, panels=(replace(panel, force=0.7 * panel.force),))
    assert identify_axis(light)["rho"][0] == pytest.approx(1 / 0.7, rel=1e-6)


@pytest.mark.parametrize(
    ("tanks", "panel", "noise"),
    [((TANK,), False, 1e-4), ((TANK,), True, 1e-4), (TWO_TANKS, False, 1e-6)],
    ids=["one tank", "panel", "two tanks"],
)
def test_covariance_against_monte_carlo(tanks, panel: bool, noise: float):
    """200 seeds at 20 Hz: a standard deviation is known to 5 %, four of those are allowed, and the mean fits.

    Two tanks are ill-conditioned (3e5): at 1e-4 m/s2 the masses scatter by several times what is linear.
    """
    rng = np.random.default_rng(1)
    clean = identify_axis(axis_data(tanks, panel, 20.0, 1e-12), len(tanks)).values
    runs = [identify_axis(axis_data(tanks, panel, 20.0, noise, rng), len(tanks)) for _ in range(200)]
    values = np.array([r.values for r in runs])
    predicted = np.mean([r.sigma for r in runs], axis=0)
    np.testing.assert_allclose(values.std(axis=0, ddof=1), predicted, rtol=0.2)
    if len(tanks) == 1:
        off = (values.mean(axis=0) - clean) / (predicted / np.sqrt(200))
        assert np.abs(off).max() < 4.0, off


def test_filtered_noise_is_followed():
    """Through a zero-phase low-pass at 5 Hz of 100 Hz samples, as the pipeline does."""
    from smsid.sensing import zero_phase

    rng = np.random.default_rng(2)
    clean = axis_data((TANK,), False)
    smooth = lambda x: zero_phase(x, 100.0, 5.0)  # noqa: E731
    runs = []
    for _ in range(60):
        a = clean.acceleration + 1e-4 * rng.standard_normal(len(clean.time))
        runs.append(
            identify_axis(AxisData("x", clean.time, smooth(clean.force), smooth(a), 1e-4, filtered=smooth))
        )
    spread = np.std([r.values for r in runs], axis=0, ddof=1)
    np.testing.assert_allclose(spread, np.mean([r.sigma for r in runs], axis=0), rtol=0.4)


def test_a_constant_bias_spoils_the_regressor():
    """A known weakness of the linear method: 1e-5 m/s2, a tenth of one sample's noise, spoils all but M.

    M by half a per cent, m_s by 3 %, k_s by 7 % along one axis, b_s by fifteen times its size. For -1e-5 m_s
    and k_s move by -5 and -4 %: what a bias does is not linear.
    """
    clean = identify_axis(axis_data((TANK,), False)).values
    found = 100 * (identify_axis(axis_data((TANK,), False, bias=1e-5)).values / clean - 1.0)
    np.testing.assert_allclose(found[:3], [-0.50, 3.2, -6.9], rtol=0.05)
    assert found[3] == pytest.approx(1480, rel=0.05)


def test_described_biases_widen_the_interval():
    """To first order by what a bias of one sigma does; here small enough for first order to be all."""
    size = 1e-9
    data = axis_data((TANK,), True, noise=1e-14)
    clean, (p,) = identify_axis(data).values, data.panels
    told = identify_axis(replace(data, bias=size)).sigma
    moved = replace(
        data,
        acceleration=data.acceleration + size,
        panels=(replace(p, force=p.force - size * p.weights.sum()),),
    )
    np.testing.assert_allclose(told, np.abs(identify_axis(moved).values - clean), rtol=2e-3)
    told = identify_axis(replace(data, panels=(replace(p, bias=size),))).sigma
    forces = [replace(data, panels=(replace(p, force=p.force + size * w),)) for w in p.weights]
    moves = [identify_axis(d).values - clean for d in forces]
    np.testing.assert_allclose(told, np.linalg.norm(moves, axis=0), rtol=2e-3)


def test_axes_are_brought_together():
    """Shared parameters by inverse variance, the others apart; the covariance is the weighted mean's."""
    x = AxisEstimate(
        "x", ("M", "k_s"), np.array([10.0, 1.0]), np.array([[4.0, 1.0], [1.0, 9.0]]), np.zeros(2), 1.0
    )
    y = AxisEstimate(
        "y", ("M", "k_s"), np.array([16.0, 2.0]), np.array([[2.0, 0.0], [0.0, 1.0]]), np.zeros(2), 1.0
    )
    both = combine([x, y])
    assert both.names == ("M", "k_s.x", "k_s.y")
    assert both["M"] == pytest.approx((14.0, np.sqrt(4 / 3)))
    assert both.covariance[0, 1] == pytest.approx(1 / 3)
    total = sum(np.outer(list(d.values()), list(d.values())) for d in both.directions())
    np.testing.assert_allclose(total, both.covariance, atol=1e-12)


def test_not_a_number_is_left_out():
    nan = np.array([[1.0, np.nan], [np.nan, np.nan]])
    x = AxisEstimate("x", ("M", "m_s1"), np.array([10.0, np.nan]), nan, np.zeros(2), 1.0)
    assert combine([x]).names == ("M",)


def test_two_tanks_alike_are_one():
    """Equal frequencies: the mass of both in one, and a second tank with no mass to speak of."""
    data = axis_data((TANK, TANK), False, rng=np.random.default_rng(0), noise=1e-5)
    found = identify_axis(data, 2)
    assert found["M"][0] == pytest.approx(M, rel=1e-3)
    masses = sorted((found[f"m_s{i}"] for i in "12"), key=lambda m: m[0])
    assert masses[1][0] == pytest.approx(2 * TANK[0], rel=0.05)
    assert abs(masses[0][0]) < 2.0 * masses[0][1]


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"force": np.zeros(12001)}, NotIdentifiableError, "No thrust acts along x"),
        ({"noise": 0.0}, SmsidError, "needs it positive"),
        ({"noise": np.nan}, SmsidError, "needs it positive"),
    ],
)
def test_refusals(change, error, message: str):
    data = replace(axis_data((TANK,), False), **change)
    with pytest.raises(error, match=message):
        identify_axis(data)


def test_wrong_sign_of_thrust_is_told():
    data = axis_data((TANK,), False)
    with pytest.raises(NotIdentifiableError, match="mass along x comes out as -"):
        identify_axis(AxisData("x", data.time, -data.force, data.acceleration, 1e-9))


def test_too_few_samples_are_told():
    data = axis_data((TANK,), False)
    short = AxisData("x", data.time[:100], data.force[:100], data.acceleration[:100], 1e-4)
    with pytest.raises(NotIdentifiableError, match="100 samples along x are too few") as caught:
        identify_axis(short)
    assert caught.value.evidence["needed"] == 160
