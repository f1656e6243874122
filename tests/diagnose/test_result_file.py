"""A diagnosis comes back from its file as it was."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from smsid.diagnose import Diagnosis, load_diagnosis, save_diagnosis
from smsid.diagnose.result import Alias, FoundCause, Limit, SignificantTest, Value
from smsid.diagnose.validation import ChannelGain, Gain
from smsid.errors import SmsidError

CAUSE = FoundCause(
    "joint_friction", "joint2", "friction", None,
    (Value("friction_joint2.viscous", 1.5, 2e-4, "N m s/rad"), Value("link1.m", 3.0, 0.1, "kg", 2.9),
     Value("load.mass", 0.5, 0.36, "kg", profile=(0.02, math.inf))),
    (Alias("delay", "joint2", "timing", "delay", 0.99, "a slower motion", ("joint3",)),),
    {"ratio": 1e4, "freedom": 1.0, "p_value": 0.0}, onset=3.0, onset_sigma=0.1, fitted="viscous",
    also_at=("joint1", "wheel"),
)  # fmt: skip
CHANNEL = ChannelGain("pose.position", "m", 1.0, 0.02, 0.001, float("nan"))
FULL = Diagnosis(
    "craft", ("one", "two"), "explained", "The simulation lacks friction.", "from the estimate",
    causes=(CAUSE,), partial=(replace(CAUSE, onset=None),),
    gain=Gain("two", 751, 247.0, 247.0, 1.1, 1e6, 1e6, 10.0, (CHANNEL,), 3),
    remaining=(SignificantTest("imu.angular_rate", "time", 99.0, 3, 1e-9),),
    limits=(Limit("backlash", "joint1", "gap", "width", 1e-4, "rad"),),
    noise={"imu": 1.02}, whitened_rms={"nominal": 1.0}, timing={"search": 3.0}, notes=("a note",),
    tests={"nominal": (SignificantTest("joint1", "rate", 5.0, 2, 0.2),), "extended": ()},
)  # fmt: skip


@pytest.mark.parametrize(
    "diagnosis",
    [FULL, Diagnosis("craft", (), "not_evaluated", "Too short.", gain_reason="no validation recording")],
)
def test_a_diagnosis_comes_back_from_its_file(diagnosis, tmp_path):
    save_diagnosis(diagnosis, tmp_path / "d.json")
    again = load_diagnosis(tmp_path / "d.json")
    assert again.to_json() == diagnosis.to_json()
    if diagnosis.gain is not None:
        assert again.gain is not None and math.isnan(again.gain.channels[0].refitted)
        assert again.causes == diagnosis.causes and again.gain.explained == diagnosis.gain.explained


def test_what_is_no_diagnosis_or_not_whole_is_told(tmp_path):
    (tmp_path / "e.json").write_text('{"kind": "estimate"}')
    with pytest.raises(SmsidError, match="is no diagnosis"):
        load_diagnosis(tmp_path / "e.json")
    document = json.loads(FULL.to_json())
    for key in ("gain", "causes", "noise", "verdict"):
        (tmp_path / "d.json").write_text(json.dumps({k: v for k, v in document.items() if k != key}))
        with pytest.raises(SmsidError, match="not whole"):
            load_diagnosis(tmp_path / "d.json")
