"""Wheel allocation: layouts, limits, saturation."""

from __future__ import annotations

import numpy as np
import pytest
from control_cases import paper, two_arms

from smsid.control._wheels import Allocation, WheelLayout
from smsid.errors import ControlError

PYRAMID = WheelLayout.of(two_arms())
STILL = np.zeros(4)


def with_limits(torque=2.0, rate=420.0) -> WheelLayout:
    p = PYRAMID
    return WheelLayout(p.names, p.axes, p.inertia, np.full(4, torque), np.full(4, rate))


def on_base(found: Allocation) -> np.ndarray:
    return -PYRAMID.axes @ found.wheels


def saturated(found: Allocation) -> bool:
    return bool(found.torque_limited.any() or found.rate_limited.any())


def test_axes_and_limits_are_the_description_s():
    layout = WheelLayout.of(paper())
    np.testing.assert_allclose(layout.axes, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(layout.inertia, 0.159)
    assert layout.max_torque.tolist() == [2.0] * 3 and layout.max_rate.tolist() == [420.0] * 3


def test_within_limits_the_base_gets_what_is_asked():
    for seed in range(20):
        asked = np.random.default_rng(seed).uniform(-0.8, 0.8, 3)
        found = PYRAMID.allocate(asked, STILL, 0.01)
        np.testing.assert_allclose(on_base(found), asked, atol=1e-14)
        assert not saturated(found)


def test_the_null_space_is_used_before_the_direction_suffers():
    """An axis where the least-norm torques pass the limit but others of the same effect do not."""
    rng = np.random.default_rng(1)
    used = 0
    for _ in range(300):
        asked = rng.standard_normal(3)
        asked *= 3.0 / np.linalg.norm(asked)
        least = PYRAMID.inverse @ asked
        best = np.abs(PYRAMID._least_share_torques(-least)).max()
        assert best <= np.abs(least).max() + 1e-12
        if best < 2.0 < np.abs(least).max():
            used += 1
            found = with_limits(2.0).allocate(asked, STILL, 0.01)
            np.testing.assert_allclose(on_base(found), asked, atol=1e-9)
            assert not saturated(found)
    assert used > 0


def test_beyond_the_limits_the_direction_is_kept_and_it_is_told():
    asked = np.array([10.0, 4.0, -7.0])
    found = PYRAMID.allocate(asked, STILL, 0.01)
    assert found.torque_limited.any()
    assert np.abs(found.wheels).max() <= 2.0 + 1e-12
    np.testing.assert_allclose(np.cross(on_base(found), asked), 0.0, atol=1e-9)
    assert 0.0 < on_base(found) @ asked < asked @ asked


def test_no_wheel_passes_its_speed():
    layout = WheelLayout.of(paper())
    rates = np.array([419.99, 0.0, -419.99])
    found = layout.allocate(np.array([-1.0, 0.0, 1.0]), rates, 0.01)
    assert found.rate_limited.tolist() == [True, False, True]
    assert np.abs(rates + found.wheels / layout.inertia * 0.01).max() <= 420.0 + 1e-9
    back = layout.allocate(np.array([1.0, 0.0, -1.0]), rates, 0.01)
    assert not saturated(back)


def test_bad_layouts_are_refused():
    with pytest.raises(ControlError, match=r"cannot turn the base about body axis"):
        WheelLayout(("a", "b", "c"), np.eye(3)[:, [0, 1, 1]], np.ones(3), np.ones(3), np.ones(3))
    with pytest.raises(ControlError, match="layout is singular"):
        WheelLayout((), np.zeros((3, 0)), np.zeros(0), np.zeros(0), np.zeros(0))
    with pytest.raises(ControlError, match=r"`inertia` of 3 wheels has shape \(2,\)"):
        WheelLayout(("a", "b", "c"), np.eye(3), np.ones(2), np.ones(3), np.ones(3))
    with pytest.raises(ControlError, match="must be positive"):
        WheelLayout(("a", "b", "c"), np.eye(3), np.array([1.0, -1.0, 1.0]), np.ones(3), np.ones(3))
    with pytest.raises(ControlError, match="base torque of shape"):
        PYRAMID.allocate(np.zeros(2), STILL, 0.01)
