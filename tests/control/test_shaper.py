"""Input shapers: what they leave in a mode, at its frequency and around it."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.control.trajectory import shaper

F, ZETA = 0.065, 0.02


@pytest.mark.parametrize("kind", ["zv", "zvd", "ei"])
def test_amplitudes_sum_to_one_and_start_now(kind):
    s = shaper(kind, [F, 0.3], [ZETA, 0.005])
    np.testing.assert_allclose(s.amplitudes.sum(), 1.0, rtol=1e-14)
    assert s.times[0] == 0.0 and (np.diff(s.times) >= 0.0).all() and (s.amplitudes > 0.0).all()


@pytest.mark.parametrize("kind", ["zv", "zvd"])
def test_nothing_is_left_at_the_modes(kind):
    s = shaper(kind, [F, 0.3], [ZETA, 0.005])
    assert s.residual(F, ZETA) < 1e-12 and s.residual(0.3, 0.005) < 1e-12


def test_zvd_is_flat_where_zv_is_not():
    off = F * 1.001
    assert shaper("zv", [F], ZETA).residual(off, ZETA) > 1e-3
    assert shaper("zvd", [F], ZETA).residual(off, ZETA) < 5e-6


def test_ei_leaves_its_tolerance_in_the_widest_band():
    band = F * np.linspace(0.81, 1.19, 201)
    s = shaper("ei", [F], 0.0, tolerance=0.05)
    np.testing.assert_allclose(s.residual(F), 0.05, rtol=1e-12)
    assert s.residual(band).max() < 0.0501
    assert shaper("zvd", [F]).residual(band).max() > 0.08
