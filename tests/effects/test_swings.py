"""How a rotor may swing on its gear: as slowly as its spring and a rotor that the prior allows."""

import numpy as np
import pytest

from smsid.effects import GearCompliance


def gear(compliance, sigma=3.0, **more):
    return GearCompliance(
        name="g",
        joint="joint3",
        compliance=compliance,
        prior={"motor_inertia": sigma},
        quasistatic=True,
        **more,
    )


@pytest.mark.parametrize(("compliance", "swings"), [(1e-3, 2), (1e-4, 1), (2e-5, 1), (1e-6, 0)])
def test_rotors_that_are_tried_are_lighter_than_the_prior_has_them(compliance, swings):
    tried = gear(compliance).with_dynamics()
    assert len(tried) == swings
    for moving, step in tried:
        period = np.sqrt(moving.motor_inertia * compliance)
        assert 0.0 < moving.motor_inertia < 3.0 and not moving.quasistatic
        assert step < 0.3 * period, "of the fastest motion a step is 0.3 rad at most"
        assert moving.damping == pytest.approx(np.sqrt(moving.motor_inertia / compliance)), "half damped"


def test_a_stiff_gear_is_tried_with_a_rotor_that_swings_within_milliseconds():
    ((moving, step),) = gear(2e-5).with_dynamics()
    assert np.sqrt(moving.motor_inertia * 2e-5) == pytest.approx(0.003) and step < 1e-3


def test_what_swings_already_or_does_not_give_has_no_other_motion():
    assert gear(0.0).with_dynamics() == ()
    assert gear(1e-3).model_copy(update={"quasistatic": False, "motor_inertia": 0.1}).with_dynamics() == ()
