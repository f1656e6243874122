"""The table of thresholds: all have a unit and a reason, are used, and stand in the docs."""

import re
from dataclasses import FrozenInstanceError, fields
from pathlib import Path

import pytest

from smsid.diagnose.thresholds import BEGIN, END, THRESHOLDS, DetectionThresholds, thresholds_reference
from smsid.diagnose.torque.search import LEVELS

ROOT = Path(__file__).resolve().parents[2]


def test_every_threshold_is_told_and_used_once_at_least():
    files = (ROOT / "smsid" / "diagnose").rglob("*.py")
    text = "\n".join(path.read_text(encoding="utf-8") for path in files)
    names = {f.name for f in fields(DetectionThresholds)}
    assert names <= set(re.findall(r"(?:THRESHOLDS|LEVELS|levels|_asked|asked|self)\.(\w+)", text))
    assert set(re.findall(r"THRESHOLDS\.(\w+)", text)) <= {*names, "beside_a_cause"}
    for f in fields(DetectionThresholds):
        assert all(f.metadata[k] for k in ("unit", "reason", "calibrated")), f.name


def test_nobody_changes_them_on_the_way():
    with pytest.raises(FrozenInstanceError):
        THRESHOLDS.misfit = 3.0  # type: ignore[misc]


def test_levels_are_those_of_the_table():
    assert DetectionThresholds() == THRESHOLDS and THRESHOLDS.candidate == 0.003
    assert LEVELS.block == THRESHOLDS.torque_block == 0.001
    assert THRESHOLDS.beside_a_cause.candidate == THRESHOLDS.further < THRESHOLDS.candidate


def test_the_docs_have_the_table():
    text = (ROOT / "docs" / "diagnosis_steps.md").read_text(encoding="utf-8")
    assert text.split(BEGIN)[1].split(END)[0].strip() == thresholds_reference().strip(), (
        "write it anew with smsid.diagnose.thresholds.write_thresholds('docs/diagnosis_steps.md')"
    )
