"""Rows that a logger wrote twice lose nothing by being left out; two values of one time are an error."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from smsid.errors import RecordingError
from smsid.recording import Recording, import_recording
from smsid.recording._repeats import without_repeats
from smsid.recording.mapping import parse_mapping

T = 0.1 * np.arange(80)
A = np.sin(T)
MAPPING = parse_mapping(
    {
        "time": {"column": "t", "unit": "s"},
        "channel": {"enc.joint_position": {"columns": ["q1"], "unit": "rad"}},
    }
)


def _write(path, rows):
    path.write_text("\n".join(["t,q1", *(f"{a},{b}" for a, b in rows)]))


@pytest.mark.parametrize("check", [True, False])
def test_repeated_rows_are_left_out_and_counted(tmp_path, caplog, check):
    rows = list(zip(T, A, strict=True))
    _write(tmp_path / "once.csv", rows)
    _write(tmp_path / "log.csv", [*rows[:9], rows[8], rows[8], *rows[9:40], rows[39], *rows[40:]])
    with caplog.at_level(logging.WARNING):
        found = import_recording(tmp_path / "log.csv", MAPPING, check=check)
    once = import_recording(tmp_path / "once.csv", MAPPING)
    np.testing.assert_array_equal(found.time(), once.time())
    np.testing.assert_array_equal(found["enc.joint_position"], once["enc.joint_position"])
    assert "3 rows of clock 'time' left out" in caplog.text
    assert found.provenance["imported"]["repeated_rows"] == {"time": 3}
    assert "repeated_rows" not in once.provenance["imported"]


def test_two_values_of_one_time_are_an_error_that_says_what_to_do(tmp_path):
    rows = list(zip(T, A, strict=True))
    _write(tmp_path / "log.csv", [*rows[:9], (T[8], 0.5), *rows[9:]])
    with pytest.raises(RecordingError, match="stands still at index 9") as caught:
        import_recording(tmp_path / "log.csv", MAPPING)
    assert "delete the wrong row" in caught.value.advice


def test_a_row_is_repeated_where_all_channels_of_its_clock_are():
    again = np.insert(np.arange(80), 20, 20)
    gyro = np.stack([A, 2.0 * A, np.full(80, np.nan)], axis=1)[again]
    channels = {"gyro.angular_rate": gyro, "enc.joint_position": A[again, None]}
    assert without_repeats(Recording.from_arrays(T[again], channels))[1] == {"time": 1}
    channels["enc.joint_position"] = channels["enc.joint_position"] + 1e-9 * np.arange(81)[:, None]
    kept = Recording.from_arrays(T[again], channels)
    assert without_repeats(kept) == (kept, {})


def test_sensors_may_miss_samples_and_commands_may_not():
    command = np.ones((80, 1))
    q = np.tile([0.0, 0.0, 0.0, 1.0], (80, 1))
    q[7] = np.nan
    made = Recording.from_arrays(T, {"st.attitude": q, "command.joint_torque": command})
    made.check(sensors_may_pause=True)
    with pytest.raises(RecordingError, match="not finite"):
        made.check()
    command[3] = np.nan
    with pytest.raises(RecordingError, match=r"'command.joint_torque' is nan"):
        made.with_channels({"command.joint_torque": command}).check(sensors_may_pause=True)
    q[9] *= 1.01
    with pytest.raises(RecordingError, match="quaternion at index 9"):
        Recording.from_arrays(T, {"st.attitude": q}).check(sensors_may_pause=True)
