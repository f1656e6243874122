"""Clamped and coupled modes of a panel, on the equations of motion and on MuJoCo recordings."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import scipy.signal
from scipy.optimize import brentq

from smsid.errors import NotIdentifiableError, RecordingError, SmsidError
from smsid.identify.appendage_modes import panel_modes
from smsid.identify.modes import mac

ORACLE = os.environ.get("SMSID_ORACLE", "")
oracle = pytest.mark.skipif(
    not (ORACLE and Path(ORACLE).is_dir()),
    reason="SMSID_ORACLE does not name the folder of MuJoCo recordings",
)
LENGTH, THICKNESS, YOUNG, DENSITY = 6.0, 0.002, 70e9, 2700.0
PARTICIPATION = np.array([7.7195, 4.2782, 2.5084])
TOTAL, SLOSH_MASS, SLOSH_STIFFNESS = 2256.8, 49.6, 0.41


def cantilever_frequencies(count=3):
    """Euler-Bernoulli: cos(x) cosh(x) = -1, f = x^2 / (2 pi L^2) sqrt(EI / rho A) [Hz]."""
    roots = [
        brentq(lambda x: np.cos(x) + 1 / np.cosh(x), np.pi * (k + 0.25), np.pi * (k + 0.75))
        for k in range(count)
    ]
    return np.array(roots) ** 2 / (2 * np.pi * LENGTH**2) * np.sqrt(YOUNG * THICKNESS**2 / 12 / DENSITY)


def coupled_frequencies():
    """Undamped, attitude held: base, slosh mass and three panel modes along one axis [Hz]."""
    M = np.diag([TOTAL, SLOSH_MASS, 1.0, 1.0, 1.0])
    M[0, 1] = M[1, 0] = SLOSH_MASS
    M[0, 2:] = M[2:, 0] = PARTICIPATION
    K = np.diag([0.0, SLOSH_STIFFNESS, *(2 * np.pi * cantilever_frequencies()) ** 2])
    return np.sqrt(np.sort(scipy.linalg.eigvalsh(K, M))[1:]) / 2 / np.pi


SHAPES = np.array([[0.1655, 0.547, 1.0], [-0.59, -0.423, 1.0], [0.722, -0.644, 1.0]])


def experiment_one(rate=20.0, seed=None):
    """Exp. 1 along one axis by exact discretisation: time, panel and base accelerations."""
    w = 2 * np.pi * cantilever_frequencies()
    M = np.diag([TOTAL, SLOSH_MASS, 1.0, 1.0, 1.0])
    M[0, 1] = M[1, 0] = SLOSH_MASS
    M[0, 2:] = M[2:, 0] = PARTICIPATION
    K, D = np.diag([0, SLOSH_STIFFNESS, *w**2]), np.diag([0, 0.02, *(0.01 * w)])
    inverse = np.linalg.inv(M)
    A = np.block([[np.zeros((5, 5)), np.eye(5)], [-inverse @ K, -inverse @ D]])
    B = np.r_[np.zeros(5), inverse[:, 0]][:, None]
    system = scipy.signal.StateSpace(A, B, np.hstack([-inverse @ K, -inverse @ D]), inverse[:, :1])
    t = np.arange(round(120 * rate) + 1) / rate
    force = np.where(t < 20, 40.0, np.where(t < 40, -40.0, 0.0))
    acceleration = scipy.signal.dlsim(system.to_discrete(1 / rate), force)[1]
    # An anti-aliased accelerometer gives the mean of both sides of a jump, not its right limit.
    acceleration -= np.outer(np.diff(force, prepend=0.0) / 2, inverse[:, 0])
    base = acceleration[:, 0]
    panel = base[:, None] + acceleration[:, 2:] * 0.3 @ SHAPES
    if seed is not None:
        rng = np.random.default_rng(seed)
        base, panel = base + 5e-5 * rng.normal(size=base.shape), panel + 5e-5 * rng.normal(size=panel.shape)
    return t, panel, base


def test_cantilever_is_the_papers():
    np.testing.assert_allclose(cantilever_frequencies(), [0.045696, 0.286373, 0.801848], rtol=2e-5)


def test_clamped_and_coupled_without_noise():
    t, panel, base = experiment_one()
    modes = panel_modes(t, panel, base, free_from=40.0)
    np.testing.assert_allclose([m.frequency for m in modes.clamped], cantilever_frequencies(), rtol=2e-5)
    np.testing.assert_allclose([m.damping for m in modes.clamped], 0.005, rtol=0.02)
    np.testing.assert_allclose([m.frequency for m in modes.coupled], coupled_frequencies(), rtol=2e-4)
    for mode, shape in zip(modes.clamped, SHAPES, strict=True):
        assert mac(mode.shape, shape)[0, 0] > 0.9999
    assert "clamped" in modes.status and "after 40 s" in modes.status


def test_a_coupled_mode_is_named_after_its_clamped_one():
    """Whether the slosh, below all of them, was found or not."""
    modes = panel_modes(*experiment_one(), free_from=40.0)
    assert len(modes.coupled) == 4
    for seen in (modes, replace(modes, coupled=modes.coupled[1:])):
        found = [seen.coupled[i].frequency for i in map(seen.partners().get, range(3))]
        np.testing.assert_allclose(found, coupled_frequencies()[1:], rtol=2e-4)


def test_slosh_between_two_bending_modes_is_no_mode_of_the_panel():
    modes = panel_modes(*experiment_one(), free_from=40.0)
    slosh, first = modes.coupled[:2]
    between = replace(slosh, frequency=1.02 * first.frequency)  # as if the tank were stiffer
    seen = replace(modes, coupled=(first, between, *modes.coupled[2:]))
    assert seen.partners() == {0: 0, 1: 2, 2: 3}


def test_noise_and_constant_bias():
    t, panel, base = experiment_one(seed=1)
    clean = panel_modes(t, panel, base, free_from=40.0)
    biased = panel_modes(t, panel + np.array([1e-3, -2e-3, 1e-3]), base + 1e-3, free_from=40.0)
    np.testing.assert_allclose([m.frequency for m in clean.clamped], cantilever_frequencies(), rtol=1e-3)
    np.testing.assert_allclose(
        [m.frequency for m in biased.clamped], [m.frequency for m in clean.clamped], rtol=1e-7
    )


def test_highest_frequency_bounds_the_search():
    t, panel, base = experiment_one()
    modes = panel_modes(t, panel, base, free_from=40.0, highest_frequency=0.5)
    np.testing.assert_allclose([m.frequency for m in modes.clamped], cantilever_frequencies(2), rtol=1e-4)


def test_refusals():
    t, panel, base = experiment_one()
    with pytest.raises(RecordingError, match="evenly") as caught:
        panel_modes(np.where(t > 50, t + 0.3, t), panel, base)
    assert caught.value.evidence["index"] == 1000
    with pytest.raises(NotIdentifiableError, match="too few"):
        panel_modes(t[:200], panel[:200], base[:200])
    with pytest.raises(NotIdentifiableError, match="too few"):
        panel_modes(t, panel, base, free_from=115.0)
    with pytest.raises(SmsidError, match="Lengths"):
        panel_modes(t, panel[1:], base)
    with pytest.raises(SmsidError, match="one direction"):
        panel_modes(t, panel, np.column_stack([base, base]))
    panel = panel.copy()
    panel[5, 1] = np.nan
    with pytest.raises(NotIdentifiableError, match="finite"):
        panel_modes(t, panel, base)


@oracle
@pytest.mark.parametrize("name", [pytest.param("exp1_z_modal3", marks=pytest.mark.slow), "exp1_xyz_modal3"])
def test_paper_frequencies_from_mujoco_recordings(name):
    """With noise of 1e-4 m/s^2 each clamped frequency is within 0.1 %, and there is no false mode."""
    data = np.load(Path(ORACLE) / f"{name}.npz")
    time = data["t"]
    clean = data["panel_acc_base"][:, :, 2].astype(float), data["acc_imu_body"][:, 2].astype(float)
    clamped, coupled = [], []
    for seed in range(4):
        rng = np.random.default_rng([seed, len(name)])
        panel, base = (x + 1e-4 * rng.standard_normal(x.shape) for x in clean)
        modes = panel_modes(time, panel, base, free_from=40.0)
        assert len(modes.clamped) == 3
        clamped.append([m.frequency for m in modes.clamped])
        coupled.append([m.frequency for m in modes.coupled[-3:]])
        np.testing.assert_allclose([m.damping for m in modes.clamped], 0.005, rtol=0.1)
    error = np.abs(np.array(clamped) / cantilever_frequencies() - 1)
    assert np.all(error.mean(axis=0) < 1e-3)
    assert np.all(error.mean(axis=0) < [3e-4, 1e-4, 3e-4])
    np.testing.assert_allclose(np.mean(coupled, axis=0), coupled_frequencies()[1:], rtol=1e-3)
