"""The whole way on short recordings: what is refused, what is written."""

import json
import sys

import numpy as np
import pytest

from smsid.cli import main
from smsid.diagnose import diagnose, load_diagnosis, save_diagnosis
from smsid.diagnose._sensor_faults import Fault
from smsid.diagnose.stepwise import search
from smsid.errors import SmsidError
from smsid.identify.estimate import Estimate, classify
from smsid.recording import Recording, save_recording


def part(recording, keep, channels=None):
    return Recording.from_arrays(
        recording.time()[keep],
        {c: np.asarray(recording[c])[keep] for c in channels or recording.channels},
        labels=recording.labels,
        role="estimation",
        name="part",
    )


def test_no_recording_is_an_error(description):
    with pytest.raises(SmsidError, match="No recording"):
        diagnose(description, [])


@pytest.mark.parametrize(
    ("keep", "without", "reason"),
    [
        (slice(0, 50), (), "50 samples"),
        (slice(None), ("command.",), "no command"),
        (slice(None), ("pose.", "imu.", "encoder.", "tachometer.", "panel."), "nothing the sensors"),
    ],
)
def test_what_cannot_be_judged_is_not_evaluated_with_the_reason(
    description, recording, keep, without, reason
):
    channels = [c for c in recording.channels if not c.startswith(without or ("none",))]
    found = diagnose(description, [part(recording, keep, channels)]).diagnosis
    assert found.verdict == "not_evaluated"
    assert reason in found.sentence
    assert found.causes == ()


def test_an_estimate_of_another_spacecraft_is_not_used(description, recording):
    other = Estimate("other", "paper", (classify("left_panel.gain", 1.0, "1", 0.1, "exp1"),))
    found = diagnose(description, [recording], estimate=other).diagnosis
    assert found.verdict == "not_evaluated"
    assert "another spacecraft" in found.sentence


def test_the_command_writes_the_reason_and_its_exit_code(
    description, recording, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    save_recording(part(recording, slice(0, 50)), "short.nc")
    toml = description.folder / "paper_sms.toml"
    monkeypatch.setattr("sys.argv", ["smsid", "diagnose", str(toml), "short.nc", "-o", "d.json"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 4
    assert load_diagnosis(tmp_path / "d.json").verdict == "not_evaluated"
    assert not (tmp_path / "extended.toml").exists()


def test_json_holds_no_bare_infinity(tmp_path, description, recording):
    found = diagnose(description, [part(recording, slice(0, 50))]).diagnosis
    save_diagnosis(found, tmp_path / "d.json")
    json.loads((tmp_path / "d.json").read_text(), parse_constant=lambda x: pytest.fail(x))


@pytest.mark.parametrize(("likelier", "searches"), [(False, 2), (True, 3)])
def test_outliers_that_are_none_cost_a_search_only_where_that_led_further(
    monkeypatch, description, recording, likelier, searches
):
    """They were a motion that was not followed yet: without them the search saw what had been seen."""
    module = sys.modules["smsid.diagnose.diagnose"]
    seen = []

    def counted(point, problem, *args):
        seen.append(int(np.isfinite(problem.data.values).sum()))
        return search(point, problem, *args)

    def one(data, run):
        marked = np.zeros(data.values.shape, dtype=bool)
        marked[20, 0] = True
        return [Fault("outliers", data.blocks[0].channel, data.names[0], 0.1, 0.1, marked)]

    monkeypatch.setattr(module, "search", counted)
    monkeypatch.setattr(module, "outliers", one)
    monkeypatch.setattr(module, "recount_outliers", lambda *_: [])
    monkeypatch.setattr(module, "_is_likelier", lambda other, found: likelier)
    found = diagnose(description, [recording]).diagnosis
    assert found.verdict == "adequate" and not found.causes
    assert len(seen) == searches and seen[1] == seen[0] - 1 and seen[-1] == seen[0] - (not likelier)
