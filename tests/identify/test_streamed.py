"""Chunk by chunk comes out what the whole gives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest

from smsid.identify.hidden_states import hidden_states
from smsid.identify.modal_state import ModalState
from smsid.identify.momentum import HiddenStates, step_a, step_b
from smsid.identify.motion import Motion, prepare
from smsid.identify.noise_replicates import add_noise_replicate
from smsid.identify.robust import hac_covariance, inverse_root
from smsid.identify.square_root_information import RowSums, ScoreSums
from smsid.identify.streamed import identify_streamed, momentum_of_chunks, with_hidden_states
from smsid.model import SpacecraftModel
from smsid.recording import Recording
from smsid.sensing import add_noise


@pytest.fixture(scope="module")
def recorded(model: SpacecraftModel, twin_flight: Recording) -> Recording:
    return add_noise(twin_flight, model.description.sensor, np.random.default_rng(5))


@pytest.fixture(scope="module")
def whole(model: SpacecraftModel, recorded: Recording) -> Motion:
    noisier = add_noise_replicate(recorded, model.description.sensor, np.random.default_rng(0))
    return replace(prepare(model, recorded), again=prepare(model, noisier))


@pytest.fixture(scope="module")
def hidden(model: SpacecraftModel, whole: Motion) -> HiddenStates:
    return hidden_states(model, whole)


def cut(states: HiddenStates, kept: slice) -> HiddenStates:
    return HiddenStates(
        {k: (a[kept], b[kept]) for k, (a, b) in states.slosh.items()},
        {k: ModalState(m.position[kept], m.velocity[kept]) for k, m in states.modes.items()},
        cut(states.again, kept) if states.again else None,
    )


def test_steps_a_and_b_from_uneven_chunks(model: SpacecraftModel, whole: Motion, hidden: HiddenStates):
    edges = [0, 7, 150, 151, 400, len(whole)]

    def chunks() -> Iterator[tuple[Motion, HiddenStates]]:
        for a, b in pairwise(edges):
            yield whole.only(slice(a, b)), cut(hidden, slice(a, b))

    mass = model.mass
    a = step_a(model, whole, hidden, mass)
    b = step_b(model, whole, hidden, mass, a.position)
    found = momentum_of_chunks(model, chunks, mass)
    assert found.samples == len(whole)
    np.testing.assert_allclose(found.a.position, a.position, atol=1e-10)
    np.testing.assert_allclose(found.a.position_sigma, a.position_sigma, rtol=1e-9)
    assert found.a.moments.base.names == a.moments.base.names
    np.testing.assert_allclose(found.a.moments.values, a.moments.values, rtol=1e-10, atol=1e-10)
    assert found.b.base.names == b.base.names
    size = np.abs(b.values).max()
    np.testing.assert_allclose(found.b.values, b.values, rtol=1e-10, atol=1e-10 * size)
    np.testing.assert_allclose(found.b.sigma, b.sigma, rtol=1e-8)
    np.testing.assert_allclose(found.b.shares, b.shares, rtol=1e-9, atol=1e-12)


def test_a_drifting_centre_of_mass(model: SpacecraftModel, whole: Motion, hidden: HiddenStates):
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


def test_hidden_states_are_carried_on(model: SpacecraftModel, whole: Motion, hidden: HiddenStates):
    edges = [0, 250, 500, len(whole)]
    pieces = (whole.only(slice(a, b)) for a, b in pairwise(edges))
    found = [states for _, states in with_hidden_states(model, pieces)]
    assert [len(x.slosh["tank"][0]) for x in found] == np.diff(edges).tolist()
    for own, theirs in ((found, hidden), ([x.again for x in found], hidden.again)):
        assert theirs is not None
        for k in range(2):
            joined = np.concatenate([x.slosh["tank"][k] for x in own])
            np.testing.assert_allclose(joined, theirs.slosh["tank"][k], atol=1e-12)
        modes = np.concatenate([x.modes["panel"].position for x in own])
        expected = theirs.modes["panel"].position
        # what lies further ahead than the next piece hardly matters
        assert np.abs(modes - expected).max() < 0.01 * np.abs(expected).max()


@dataclass
class Held:
    """A recording in memory as windows."""

    recording: Recording
    start: float = 0.0
    stop: float = 40.0

    def window(self, t0: float, t1: float) -> Recording:
        return self.recording.window(t0, t1)


def test_windows_of_a_recording(
    model: SpacecraftModel, recorded: Recording, whole: Motion, hidden: HiddenStates
):
    """Filters settle in the margins, and noise once more is drawn anew: within a part of the uncertainty."""
    mass = model.mass
    a = step_a(model, whole, hidden, mass)
    b = step_b(model, whole, hidden, mass, a.position)
    found = identify_streamed(model, Held(recorded), mass, length=13.0)
    assert found.samples == len(whole)
    assert found.b.base.names == b.base.names
    assert np.all(np.abs(found.b.values - b.values) < b.sigma)
    np.testing.assert_allclose(found.b.sigma, b.sigma, rtol=0.3)


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
