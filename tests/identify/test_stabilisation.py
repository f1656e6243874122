"""Stabilisation and clustering on poles made by hand."""

import numpy as np
import pytest

from smsid.errors import SmsidError
from smsid.identify.modes import Poles
from smsid.identify.stabilisation import Stability, stable_modes, stable_poles

TRUE = ((0.5, 0.01, [1.0, 0.5]), (0.505, 0.01, [-1.0, 1.0]), (2.0, 0.02, [0.3, 1.0]))


def made(order, modes, contribution=0.3):
    f = np.array([m[0] for m in modes])
    d = np.array([m[1] for m in modes])
    shapes = np.array([m[2] for m in modes], complex).reshape(len(modes), 2)
    values = 2 * np.pi * f * (-d + 1j * np.sqrt(1 - d**2))
    return Poles(order, values, shapes, np.full(len(f), contribution))


def diagram(seed=0, orders=10):
    rng = np.random.default_rng(seed)
    poles = []
    for k in range(orders):
        modes = [(f * (1 + 1e-4 * rng.normal()), d, s) for f, d, s in TRUE]
        modes += [(rng.uniform(0.1, 4), rng.uniform(0, 0.2), rng.normal(size=2)) for _ in range(k)]
        poles.append(made(2 * (k + 3), modes))
    return poles


def test_modes_stay_spurious_poles_go():
    modes = stable_modes(diagram(), 10.0)
    np.testing.assert_allclose([m.frequency for m in modes], [0.5, 0.505, 2.0], rtol=1e-3)
    np.testing.assert_allclose([m.damping for m in modes], [0.01, 0.01, 0.02], rtol=1e-6)
    np.testing.assert_allclose(modes[0].shape, [1.0, 0.5], atol=1e-6)
    assert all(m.orders == 9 and m.rate == 10.0 for m in modes)
    assert 0 < modes[0].frequency_order_spread < 1e-3


def test_close_modes_are_told_apart_by_shape():
    merged = [made(2 * k, [(0.5, 0.01, [1.0, 0.5]), (0.501, 0.01, [1.0, 0.5])]) for k in range(2, 8)]
    assert len(stable_modes(merged, 10.0)) == 1
    assert len(stable_modes(diagram(), 10.0)) == 3


def test_negative_and_large_damping_are_not_modes():
    poles = [made(2 * k, [(0.5, -0.01, [1.0, 0.5]), (1.0, 0.3, [1.0, 0.5])]) for k in range(2, 8)]
    assert stable_modes(poles, 10.0) == ()
    assert len(stable_modes(poles, 10.0, Stability(largest_damping=0.5))) == 1


def test_weak_and_rare_poles_are_not_modes():
    weak = [made(2 * k, [(0.5, 0.01, [1.0, 0.5])], contribution=1e-4) for k in range(2, 8)]
    assert stable_modes(weak, 10.0) == ()
    rare = [made(2 * k, [(0.5, 0.01, [1.0, 0.5])] if k > 6 else []) for k in range(2, 10)]
    assert stable_modes(rare, 10.0) == ()


def test_lowest_order_is_never_stable():
    masks = stable_poles(diagram())
    assert not masks[0].any()
    assert masks[1][:3].all()


def test_too_few_orders():
    with pytest.raises(SmsidError, match="orders"):
        stable_modes(diagram()[:2], 10.0)
