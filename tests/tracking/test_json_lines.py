"""Telemetry as lines: what is told, what is refused, and a file that grows."""

import json

import pytest

from smsid.errors import RecordingError
from smsid.tracking import Tracker
from smsid.tracking.json_lines import follow_lines, growing_lines, parse_sample
from smsid.tracking.sample import samples_of
from smsid.tracking.setting import Setting

from .craft import INERTIA, craft, flight

CHANNELS = ("st.attitude", "gyro.angular_rate", "tacho.wheel_rate")


@pytest.fixture
def tracker(tmp_path):
    description = craft(tmp_path / "craft")
    first = Tracker(description, follow={"bus.I*": 0.0})
    setting = Setting.of(first.description, first.origin.base, channels=CHANNELS, hold="linear")
    return Tracker(description, follow={"bus.I*": 0.0}, setting=setting)


def lines_of(seconds):
    return [
        json.dumps({"time": s.time, **{c: x.tolist() for c, x in s.channels.items()}}) + "\n"
        for s in samples_of(flight(seconds))
    ]


def test_results_come_line_by_line_and_bad_lines_are_told(tracker):
    lines = lines_of(3.0)
    lines[5:5] = ["no JSON\n", '{"gyro.angular_rate": [0, 0, 0]}\n', lines[2]]
    found = [json.loads(x) for x in follow_lines(tracker, lines, every=1.0)]
    rejected = [x["line"] for x in found if x.get("event") == "rejected"]
    assert rejected == [6, 7]
    assert sum(x.get("event") == "late" for x in found) > 0
    results = [x for x in found if "parameters" in x]
    assert [round(x["time"], 6) for x in results] == [0.0, 1.0, 2.0, 3.0]
    assert list(results[-1]["parameters"]) == INERTIA
    assert results[-1]["sigmas"]["bus.Izz"] < results[0]["sigmas"]["bus.Izz"]


def test_a_growing_file_is_read_in_whole_lines(tmp_path):
    path = tmp_path / "telemetry.jsonl"
    path.write_text('{"time": 0}\n{"ti', encoding="utf-8")
    asked = []

    def ended():
        asked.append(1)
        if len(asked) == 3:
            with path.open("a", encoding="utf-8") as stream:
                stream.write('me": 1}\n{"time": 2}')
        return len(asked) > 5

    found = [json.loads(x)["time"] for x in growing_lines(path, ended=ended, pause=0.0)]
    assert found == [0, 1, 2]
    with pytest.raises(RecordingError, match="Cannot read"):
        next(growing_lines(tmp_path / "none.jsonl", ended=lambda: True))


def test_a_line_that_is_no_sample_is_refused():
    for line in ("[1, 2]", '{"time": null}', '{"time": 1, "a.b": {"c": 1}}', "[" * 10000):
        with pytest.raises(RecordingError):
            parse_sample(line)
