"""Causes that need a larger state, or a place, a phase or a time to be found, hidden in MuJoCo.

From strength 3 to 100: what is found must be right by name, and its parameter within three sigma.
"""

from __future__ import annotations

import numpy as np
import pytest

from .catalogue import hidden_effects
from .plan import Run, inject
from .study import run_and_judge

pytest.importorskip("smsid.diagnose")

RIGHT = ("right", "right_by_alias")
QUICK = [
    ("arm", "backlash:gap@joint1", 10.0, None),
    ("arm", "sensor_bias:bias@encoder.joint_velocity[joint2]", 30.0, 35.0),
]
SLOW = [
    ("arm", "gear_compliance:compliance@joint3", 10.0, None),
    *(("rigid", "gear_compliance:compliance@joint2", s, None) for s in (3.0, 10.0, 100.0)),
    ("arm", "gear_compliance:compliance@joint3", 1e4, None),  # the rotor swings
    *(("rigid", "gear_compliance:compliance@joint2", s, None) for s in (1e3, 1e5)),
    *(("rigid", "backlash:gap@joint3", s, None) for s in (3.0, 10.0, 100.0)),
    *(("sms", "slosh:second@tank2", s, None) for s in (3.0, 10.0, 100.0)),
    *(("panel", "extra_mode:mass@panel", s, None) for s in (3.0, 10.0, 100.0)),
    *(("panel", "beam_mode:factor@panel", s, None) for s in (3.0, 10.0, 25.0)),
    *(("rigid", "wheel_imbalance:static@wheel_z", s, None) for s in (3.0, 10.0, 100.0)),
    *(("rigid", "mass_loss:rate@bus", s, None) for s in (3.0, 10.0, 100.0)),
    *(("rigid", "sensor_bias:bias.x@pose.attitude", s, None) for s in (3.0, 10.0, 100.0)),
    *(("rigid", "sensor_delay:delay@imu.acceleration", s, None) for s in (3.0, 10.0)),
    ("rigid", "sensor_bias:bias@encoder.joint_velocity[joint2]", 30.0, 35.0),
    ("panel", "thruster_gain:gain.y@thruster", 100.0, None),
]


def case_id(case):
    world, name, strength, onset = case
    return f"{world}-{name}-{strength:g}" + ("" if onset is None else "-midway")


def check(case, folder):
    world, name, strength, onset = case
    rng = np.random.default_rng([40, 80])
    hidden = inject(world, hidden_effects(world)[name], strength, rng, onset)
    row = run_and_judge(Run(40, "single", world, (hidden,)), folder)
    assert row["outcome"] in RIGHT, f"{row['outcome']}: named {row['named']}; {row['sentence']}"
    if row["outcome"] == "right" and row["deviation"] is not None:
        assert abs(row["deviation"]) < 3.0


@pytest.mark.parametrize("case", QUICK, ids=case_id)
def test_found(case, tmp_path):
    check(case, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("case", SLOW, ids=case_id)
def test_found_slow(case, tmp_path):
    check(case, tmp_path)
