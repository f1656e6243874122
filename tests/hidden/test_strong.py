"""Strong, plain causes in MuJoCo: far beyond what the nominal model can follow, they are named."""

import json

import pytest

from .catalogue import hidden_effects
from .judge import Injected
from .plan import Run
from .study import diagnosis_of, files_of

pytest.importorskip("smsid.diagnose")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("world", "name", "value", "kind", "parameter"),
    [
        ("arm", "payload:mass@tool", 60.0, "payload", "mass"),
        ("sms", "slosh_nonlinearity:cubic@tank", 7000.0, "slosh_nonlinearity", "cubic"),
        ("arm", "joint_friction:load@joint3", 0.0065, "joint_friction", "load"),
        ("sms", "joint_friction:coulomb@joint3", 1.0, "joint_friction", "coulomb"),
        ("sms", "sensor_misalignment:angles.z@imu.angular_rate", -0.4, "sensor_misalignment", "angles.z"),
    ],
)
def test_a_strong_cause_is_named(world, name, value, kind, parameter, tmp_path):
    run = Run(1, "single", world, (Injected(hidden_effects(world)[name], value, 1e4),))
    found = diagnosis_of(files_of(run, tmp_path), tmp_path)
    assert found["verdict"] == "explained", found["sentence"]
    cause = found["causes"][0]
    assert cause["effect"] == kind, found["sentence"]
    (size,) = (p for p in cause["parameters"] if p["name"].endswith(f".{parameter}"))
    assert size["value"] == pytest.approx(value, rel=0.01)
    assert abs(size["value"] - value) < 4.0 * size["sigma"]
    assert "nan" not in json.dumps(found).lower()
