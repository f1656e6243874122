"""Causes beyond those of the studies, each hidden in a MuJoCo world: named, with the values they have."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.diagnose import diagnose
from tests.estimation.effect_cases import by_name, fly

NAMED = {
    "joint_friction stiction wheel_z": ("wheel_z", "stiction"),
    "scale_by_rate": ("tachometer.wheel_rate[wheel_x]", "scale by rate"),
    "slosh_wall": ("tank", "wall"),
    "joint_cable": ("joint2", "cable"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMED)
def test_it_is_named(name, tmp_path):
    case, (location, shape) = by_name()[name], NAMED[name]
    flight = fly(case, 0, tmp_path)
    kept = tuple(e for e in flight.description.effect if e.name != "cause")
    found = diagnose(flight.description.model_copy(update={"effect": kept}), [flight.recording]).diagnosis
    assert found.verdict == "explained", found.sentence
    (cause,) = found.causes
    assert (cause.effect, cause.location, cause.fitted) == (case.kind, location, shape), found.sentence
    first = cause.parameters[0]
    truth = case.truth[first.name.partition(".")[2]]
    assert abs(first.value - truth) < max(4.0 * first.sigma, 0.02 * truth), (first.value, first.sigma)
    assert np.isfinite(first.sigma) and first.sigma < 0.3 * truth
