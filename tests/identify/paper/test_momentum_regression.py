"""Block by block comes out what the whole gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from smsid.identify.paper import momentum_regression
from smsid.identify.paper._momentum_printed import step_b_printed
from smsid.identify.paper.hidden_states import HiddenStates, hidden_states
from smsid.identify.paper.momentum import step_a, step_b
from smsid.identify.paper.motion import MeasuredMotion, prepare
from smsid.identify.paper.noise_replicates import add_noise_replicate
from smsid.identify.paper.square_root_information import RowSums, ScoreSums
from smsid.identify.robust import hac_covariance, inverse_root
from smsid.model import SpacecraftModel
from smsid.recording import Recording
from smsid.sensing import add_noise


@pytest.fixture(scope="module")
def recorded(model: SpacecraftModel, twin_flight: Recording) -> Recording:
    return add_noise(twin_flight, model.description.sensor, np.random.default_rng(5))


@pytest.fixture(scope="module")
def whole(model: SpacecraftModel, recorded: Recording) -> MeasuredMotion:
    noisier = add_noise_replicate(recorded, model.description.sensor, np.random.default_rng(0))
    return replace(prepare(model, recorded), again=prepare(model, noisier))


@pytest.fixture(scope="module")
def hidden(model: SpacecraftModel, whole: MeasuredMotion) -> HiddenStates:
    return hidden_states(model, whole)


def test_steps_a_and_b_block_by_block(
    model: SpacecraftModel, whole: MeasuredMotion, hidden: HiddenStates, monkeypatch: pytest.MonkeyPatch
):
    """Blocks of 150 samples, the last shorter than errors are correlated over."""
    mass, without = model.mass, hidden.without_slosh()

    def steps():
        a = step_a(model, whole, hidden, mass)
        b = step_b(model, whole, hidden, mass, a.position)
        return a, b, step_b_printed(model, whole, without, mass, 49.6, a.position)

    a, b, printed = steps()
    monkeypatch.setattr(momentum_regression, "BLOCK", 150)
    assert len(momentum_regression.blocks_of(whole, hidden)) > 5
    again, b_again, printed_again = steps()
    np.testing.assert_allclose(again.position, a.position, atol=1e-10)
    np.testing.assert_allclose(again.position_sigma, a.position_sigma, rtol=1e-9)
    for found, expected in ((again.moments, a.moments), (b_again, b), (printed_again, printed)):
        assert found.base.names == expected.base.names
        size = np.abs(expected.values).max()
        np.testing.assert_allclose(found.values, expected.values, rtol=1e-9, atol=1e-9 * size)
        np.testing.assert_allclose(found.sigma, expected.sigma, rtol=1e-7)
        np.testing.assert_allclose(found.shares, expected.shares, rtol=1e-8, atol=1e-11)


def test_a_drifting_centre_of_mass(model: SpacecraftModel, whole: MeasuredMotion, hidden: HiddenStates):
    """Seen from a frame that drifts, momentum's conservation is the same: Step A finds drift and start."""
    drift = np.array([0.02, -0.05, 0.03])
    seen = replace(whole, again=None)
    elapsed = (whole.time - whole.time[0])[:, None]
    body = np.einsum("nji,j->ni", whole.rotation, drift)
    moving = replace(seen, position=whole.position + elapsed * drift, velocity=whole.velocity + body)
    rest, found = (step_a(model, m, replace(hidden, again=None), model.mass) for m in (seen, moving))
    np.testing.assert_allclose(found.velocity - rest.velocity, drift, atol=1e-5)
    np.testing.assert_allclose(found.position, rest.position, atol=5e-4)  # a quarter of its sigma
    np.testing.assert_allclose(found.moments.values, rest.moments.values, atol=0.1)


def test_sums_of_correlated_scores():
    rng = np.random.default_rng(2)
    rows, residual = rng.standard_normal((500, 3, 4)), rng.standard_normal((500, 3))
    expected = hac_covariance(rows.reshape(-1, 4), residual.ravel(), 500, 12)
    sums = ScoreSums(12)
    for part in np.split(np.arange(500), [1, 5, 6, 100, 480]):  # some shorter than the lags
        sums.add(rows[part], residual[part])
    np.testing.assert_allclose(sums.covariance(inverse_root(rows.reshape(-1, 4))), expected, rtol=1e-11)


def test_factors_hold_what_rows_do():
    rng = np.random.default_rng(3)
    rows, rhs = rng.standard_normal((300, 2, 5)), rng.standard_normal((300, 2))
    sums = RowSums(2)
    for part in np.array_split(np.arange(300), 7):
        sums.add(rows[part], rhs[part])
    x = rng.standard_normal(3)
    left = rhs - rows[:, :, [0, 2, 4]] @ x
    np.testing.assert_allclose(sums.residual([0, 2, 4], x), np.sqrt(np.mean(left**2, axis=0)), rtol=1e-12)
    stacked = sums.columns([0, 1], [1, 3])
    own = rows[:, :, [1, 3]].reshape(-1, 2)
    np.testing.assert_allclose(stacked.T @ stacked, own.T @ own, rtol=1e-12)
    assert sum(len(f) for f in sums.factors) <= 12
