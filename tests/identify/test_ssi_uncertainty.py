"""Predicted spread of SSI-COV against the spread over records of a system known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter

from smsid.errors import NotIdentifiableError
from smsid.identify.ssi import ssi_cov
from smsid.identify.ssi_uncertainty import ssi_cov_uncertain

RATE = 20.0
STIFFNESS = 60.0 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
DAMPING = 0.01


def chain(rng: np.random.Generator, samples: int) -> np.ndarray:
    """Positions (samples, 3) of three unit masses on a line under white force, 5 % of sensor noise."""
    w, shapes = np.linalg.eigh(STIFFNESS)
    rate = np.zeros((6, 6))
    rate[:3, 3:] = np.eye(3)
    rate[3:, :3] = -STIFFNESS
    rate[3:, 3:] = -shapes @ np.diag(2 * DAMPING * np.sqrt(w)) @ shapes.T
    step = expm(rate / RATE)
    push = np.linalg.solve(rate, (step - np.eye(6))[:, 3:])
    values, vectors = np.linalg.eig(step)
    lead = 2000
    force = rng.standard_normal((samples + lead, 3)) @ push.T
    modal = np.linalg.solve(vectors, force.T.astype(complex))
    states = np.array([lfilter([1.0], [1.0, -v], x) for v, x in zip(values, modal, strict=True)])
    y = (vectors @ states).real.T[lead:, :3]
    return y + 0.05 * y.std() * rng.standard_normal(y.shape)


def truth() -> tuple[np.ndarray, np.ndarray]:
    w, shapes = np.linalg.eigh(STIFFNESS)
    return np.sqrt(w) / (2 * np.pi), shapes.T


def test_spread_over_records_is_the_predicted_one():
    """60 records: the ratio of spreads scatters by 9 % (chi-squared), coverage by 3 % per parameter."""
    frequency, shapes = truth()
    scores, shape_scores, inside = [], [], []
    for seed in range(60):
        found = ssi_cov_uncertain(
            chain(np.random.default_rng(seed), 24_000), RATE, block_rows=20, orders=[6], segments=60
        )[0]
        f, z = found.poles.frequency, found.poles.damping
        scores.append([(f - frequency) / found.frequency_sigma, (z - DAMPING) / found.damping_sigma])
        of_f, of_z = found.interval()
        inside.append([(of_f[:, 0] < frequency) & (frequency < of_f[:, 1])])
        inside.append([(of_z[:, 0] < DAMPING) & (of_z[:, 1] > DAMPING)])
        place = np.argmax(np.abs(found.shapes), axis=1)
        true = shapes / shapes[np.arange(3), place][:, None]
        sigma = np.sqrt(np.diagonal(found.shape_covariance, axis1=1, axis2=2))[:, :3]
        free = sigma > 1e-12
        shape_scores.append(((found.shapes.real - true)[free] / sigma[free]).ravel())
    spread = np.std(scores, axis=0)
    assert np.all((spread > 0.7) & (spread < 1.35)), spread
    assert 0.90 < np.mean(inside) < 0.99
    assert 0.8 < np.std(np.concatenate(shape_scores)) < 1.2


def test_same_poles_as_without():
    y = chain(np.random.default_rng(0), 12_000)
    plain = ssi_cov(y, RATE, block_rows=20, orders=[6])[0]
    found = ssi_cov_uncertain(y, RATE, block_rows=20, orders=[6], segments=20)[0]
    # the segments leave out what does not fill them, up to 19 samples
    np.testing.assert_allclose(found.poles.values, plain.values, rtol=1e-3)


def test_too_few_segments_or_samples():
    y = chain(np.random.default_rng(2), 2000)
    with pytest.raises(NotIdentifiableError, match="segments"):
        ssi_cov_uncertain(y, RATE, block_rows=20, orders=[6], segments=4)
    with pytest.raises(NotIdentifiableError, match="segments"):
        ssi_cov_uncertain(y, RATE, block_rows=20, orders=[6], segments=100)
