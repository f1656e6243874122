"""The slosh state from the base's motion against the truth of another engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from smsid.errors import NotIdentifiableError
from smsid.identify.paper.motion import MeasuredMotion, prepare
from smsid.identify.paper.slosh_state import estimate_slosh

from ..support import TANK, noisy, oracle, paper, reference

CENTRE = np.array([0.03, -0.04, 0.05])


def errors(
    motion: MeasuredMotion, recording, mass=TANK[0], stiffness=TANK[1], damping=TANK[2]
) -> tuple[float, float]:
    """Largest error of rho and rho' relative to their largest values."""
    found = estimate_slosh(motion, CENTRE, mass, np.full(3, stiffness), np.full(3, damping))
    at = np.searchsorted(recording.time(), motion.time)
    true = [recording[f"truth.slosh_{q}"][at] for q in ("position", "velocity")]
    return tuple(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(found, true, strict=True))


def test_twin_with_exact_samples(model, twin_flight):
    """Rates of 0.08 rad/s: rotating axes and the damper's gyroscopic part count; 10 ms steps leave 1e-7."""
    assert np.abs(twin_flight["imu.angular_rate"]).max() > 0.08
    motion = prepare(model, twin_flight, cutoff=None, rate=None)
    assert max(errors(motion, twin_flight)) < 1e-6


def test_the_step_is_of_second_order(model, twin_flight):
    motion = prepare(model, twin_flight, cutoff=None, rate=None)
    coarse, fine = (errors(motion.thinned(k), twin_flight)[0] for k in (20, 10))
    assert 3.0 < coarse / fine < 12.0


def test_turning_axes_count(model, twin_flight):
    """Without the body rate the displacement in bus axes comes out wrong by far more than the above."""
    motion = prepare(model, twin_flight, cutoff=None, rate=None)
    blind = replace(motion, rate=np.zeros_like(motion.rate))
    assert errors(blind, twin_flight)[1] > 0.01


def test_wrong_parameters_show(model, twin_flight):
    motion = prepare(model, twin_flight, cutoff=None, rate=None)
    assert errors(motion, twin_flight, stiffness=0.5)[0] > 0.005
    assert errors(motion, twin_flight, damping=0.2)[0] > 0.005
    assert errors(motion, twin_flight, mass=60.0)[0] > 0.005


@oracle
def test_reference_recording(model):
    """80 s, stored in single precision: 1e-6; filtered at 2 Hz and thinned to 20 Hz: 1.2e-4 at the ends."""
    recording = reference("exp2_modal3")
    assert max(errors(prepare(model, recording, cutoff=None, rate=None), recording)) < 5e-6
    assert max(errors(prepare(model, recording), recording)) < 5e-4


@oracle
def test_it_does_not_drift_with_noise(model):
    """1 mm and 1 mm/s at 100 Hz, 0.1 m of slosh: rho errs by 2 mm at most, late as early."""
    recording = reference("exp2_modal3")
    motion = prepare(model, noisy(recording, paper(), 0))
    rho, _ = estimate_slosh(motion, CENTRE, TANK[0], np.full(3, TANK[1]), np.full(3, TANK[2]))
    error = rho - recording["truth.slosh_position"][np.searchsorted(recording.time(), motion.time)]
    quarter = len(motion) // 4
    late, early = (np.sqrt(np.mean(e**2)) for e in (error[-quarter:], error[quarter : 2 * quarter]))
    assert late < 2e-3
    assert late < 3 * early


def test_at_rest_it_stays(model, twin_flight):
    motion = prepare(model, twin_flight, cutoff=None, rate=None).thinned(100)
    n = len(motion)
    still = replace(
        motion,
        position=np.tile(motion.position[:1], (n, 1)),
        rotation=np.tile(motion.rotation[:1], (n, 1, 1)),
        velocity=np.zeros((n, 3)),
        rate=np.zeros((n, 3)),
    )
    rho, rate = estimate_slosh(still, CENTRE, *TANK[:1], np.full(3, TANK[1]), np.full(3, TANK[2]))
    assert np.abs(rho).max() == pytest.approx(0.0, abs=1e-12)
    assert np.abs(rate).max() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": 1e-3}, r"0\.001 kg swings at 3\.22 Hz and is damped by 20 1/s: too fast .* at 20 Hz"),
        ({"mass": -3.0}, "slosh mass of -3 kg cannot be followed"),
        ({"mass": np.nan}, "slosh mass of nan kg cannot be followed"),
        ({"stiffness": 1e6}, "too fast to be followed"),
        ({"damping": 1e4}, "too fast to be followed"),
    ],
)
def test_slosh_that_cannot_be_followed_is_refused(model, twin_flight, change, message: str):
    """What an Exp. 1 that saw no slosh leaves: no overflow later on."""
    motion = prepare(model, twin_flight)
    with pytest.raises(NotIdentifiableError, match=message):
        errors(motion, twin_flight, **change)
