"""Samples as lines of JSON: of a recording and back, what is refused, and a file that grows."""

import json

import numpy as np
import pytest

from smsid.errors import RecordingError
from smsid.tracking.json_lines import growing_lines, lines_of, parse_sample

from .craft import flight


def test_a_recording_as_lines_and_back():
    flown = flight(1.0)
    (_, labels), *lines = lines_of(flown)
    assert json.loads(labels) == {"labels": {"wheel": list(flown.labels["wheel"])}}
    samples = [parse_sample(line) for _, line in lines]
    np.testing.assert_array_equal([s.time for s in samples], flown.time())
    for channel in flown.channels:
        np.testing.assert_array_equal([s.channels[channel] for s in samples], flown[channel])


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
