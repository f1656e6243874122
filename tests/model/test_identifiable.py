"""Base parameters: as many as the rank, and they reproduce the regressor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smsid.description import Description
from smsid.errors import NotIdentifiableError
from smsid.model import build_model
from smsid.model.identifiable import base_parameters
from smsid.model.regressor import Regressor

URDF = Path(__file__).resolve().parents[2] / "urdf"


@pytest.fixture(scope="module")
def arm():
    """The paper's bus and arm in free floating: regressor of all torques at random states, and its model."""
    model = build_model(Description(name="x", urdf="paper_sms.urdf", folder=URDF))
    regressor = Regressor(model)
    rng = np.random.default_rng(5)
    q = np.array([pin.integrate(model.pin, model.home, x) for x in rng.standard_normal((60, model.nv))])
    v, a = rng.standard_normal((2, 60, model.nv))
    return regressor, q, v, a


def rank(y):
    values = np.linalg.svd(y / np.maximum(np.linalg.norm(y, axis=0), 1e-300), compute_uv=False)
    gap = values[:-1] / np.maximum(values[1:], 1e-300)
    count = int(np.sum(values > 1e-9 * values[0]))
    assert count == len(values) or gap[count - 1] > 1e4  # the rank is no matter of taste
    return count


def test_count_for_the_papers_arm_by_hand_and_by_svd(arm):
    """Free floating, a base has ten and each revolute joint adds seven (Ayusawa et al. 2014): 10 + 3 x 7."""
    regressor, q, v, a = arm
    y = regressor.torque(q, v, a).reshape(-1, regressor.columns)
    found = base_parameters(y, regressor.names, regressor.units)
    assert len(found) == 31 == rank(y)
    assert found.unseen == ()


def test_momentum_sees_as_much_as_its_rank(arm):
    regressor, q, v, _ = arm
    y = regressor.momentum(q, v).reshape(-1, regressor.columns)
    assert len(base_parameters(y, regressor.names, regressor.units)) == rank(y)


def test_base_parameters_reproduce_forces_never_seen(arm):
    regressor, q, v, a = arm
    y = regressor.torque(q, v, a).reshape(-1, regressor.columns)
    found = base_parameters(y[:200], regressor.names, regressor.units)
    theta = regressor.parameters
    expected = y[200:] @ theta
    beta = found.values(theta)
    assert beta.shape == (31,) and len(found.names) == len(found.units) == 31
    np.testing.assert_allclose(y[200:, found.independent] @ beta, expected, rtol=1e-8, atol=1e-6)


def test_names_are_readable(arm):
    regressor, q, v, a = arm
    y = regressor.torque(q, v, a).reshape(-1, regressor.columns)
    found = base_parameters(y, regressor.names, regressor.units)
    names = dict(zip([regressor.names[i] for i in found.independent], found.names, strict=True))
    assert names["bus.m"] == "bus.m + link1.m + link2.m + link3.m"
    assert names["bus.mx"] == "bus.mx - link1.m - link2.m - link3.m"  # the arm stands at x = -1
    assert names["link2.mx"] == "link2.mx + 2 link3.m"  # link 2 is 2 m long
    assert names["link3.mx"] == "link3.mx"
    units = dict(zip(names.values(), found.units, strict=True))
    assert units["bus.m + link1.m + link2.m + link3.m"] == "kg"


def test_preferred_columns_are_kept_and_none_is_lost(arm):
    regressor, q, v, a = arm
    y = regressor.torque(q, v, a).reshape(-1, regressor.columns)
    first = regressor.names.index("link3.m")
    found = base_parameters(y, regressor.names, regressor.units, prefer=[first])
    assert first in found.independent and len(found) == 31
    theta = np.random.default_rng(0).standard_normal(regressor.columns)
    np.testing.assert_allclose(y[:, found.independent] @ found.values(theta), y @ theta, atol=1e-6)


@st.composite
def dependent(draw):
    """A regressor with columns that are combinations of others, zero columns, and badly scaled ones."""
    kept = draw(st.integers(1, 6))
    extra = draw(st.integers(0, 5))
    zeros = draw(st.integers(0, 2))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    mixing = rng.integers(-3, 4, size=(kept, extra)).astype(float)
    base = rng.standard_normal((draw(st.integers(30, 60)), kept))
    y = np.hstack([base, base @ mixing, np.zeros((len(base), zeros))])
    scale = 10.0 ** rng.integers(-2, 3, size=y.shape[1])
    order = rng.permutation(y.shape[1])
    return (y * scale)[:, order], kept, rng


@settings(max_examples=100, deadline=None)
@given(dependent())
def test_dependent_columns_are_found_and_reproduced(case):
    y, count, rng = case
    names = [f"p{i}" for i in range(y.shape[1])]
    found = base_parameters(y, names, ["1"] * len(names))
    assert len(found) == count
    np.testing.assert_array_equal(found.matrix[:, found.independent], np.eye(count))
    theta = rng.standard_normal(y.shape[1])
    scale = np.abs(y).max() * np.abs(theta).sum()
    np.testing.assert_allclose(y[:, found.independent] @ found.values(theta), y @ theta, atol=1e-10 * scale)
    zero = {n for n, column in zip(names, y.T, strict=True) if not column.any()}
    assert set(found.unseen) == zero
    assert found.condition >= 1.0


def test_many_rows_are_taken_block_by_block():
    y = np.random.default_rng(0).standard_normal((45001, 3)) @ np.array([[1.0, 0, 1], [0, 1, 1], [0, 0, 0]])
    found = base_parameters(y, ["a", "b", "c"], ["1"] * 3)
    assert found.names == ("a + c", "b + c")


def test_nothing_moving_is_told():
    with pytest.raises(NotIdentifiableError, match="nothing moves"):
        base_parameters(np.zeros((5, 2)), ["a", "b"], ["1", "1"])
