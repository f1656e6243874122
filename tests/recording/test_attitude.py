from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from smsid.recording._attitude import slerp

seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_slerp_goes_at_constant_rate_and_keeps_the_sign_of_the_samples(seed):
    """Between neighbours by the formula sin((1 - f) a) / sin a, the shorter way round."""
    rng = np.random.default_rng(seed)
    q, t = rng.normal(size=(9, 4)), np.cumsum(rng.uniform(0.1, 2.0, size=9))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    at = np.sort(rng.uniform(t[0], t[-1], size=30))
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, 7)
    f = (at - t[k]) / (t[k + 1] - t[k])
    after = q[k + 1] * np.where(np.sum(q[k] * q[k + 1], axis=1) < 0.0, -1.0, 1.0)[:, None]
    a = np.arccos(np.clip(np.sum(q[k] * after, axis=1), -1.0, 1.0))
    exact = (np.sin((1.0 - f) * a) / np.sin(a))[:, None] * q[k] + (np.sin(f * a) / np.sin(a))[:, None] * after
    np.testing.assert_allclose(np.abs(np.sum(slerp(t, q, at) * exact, axis=1)), 1.0, atol=1e-12)
    np.testing.assert_allclose(slerp(t, q, t), q, atol=1e-14)
    np.testing.assert_allclose(slerp(t[:1], 2.0 * q[:1], at), np.tile(q[0], (30, 1)), atol=1e-14)
