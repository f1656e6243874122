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
    ("name", "value", "kind", "parameter"),
    [
        ("payload:mass@tool", 60.0, "payload", "mass"),
    ],
)
def test_a_strong_cause_is_named(name, value, kind, parameter, tmp_path):
    run = Run(1, "single", "arm", (Injected(hidden_effects("arm")[name], value, 1e4),))
    found = diagnosis_of(files_of(run, tmp_path), tmp_path)
    assert found["verdict"] == "explained", found["sentence"]
    cause = found["causes"][0]
    assert cause["effect"] == kind, found["sentence"]
    (size,) = (p for p in cause["parameters"] if p["name"].endswith(f".{parameter}"))
    assert size["value"] == pytest.approx(value, rel=0.01)
    assert abs(size["value"] - value) < 4.0 * size["sigma"]
    assert "nan" not in json.dumps(found).lower()
