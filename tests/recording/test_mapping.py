from __future__ import annotations

import numpy as np
import pytest

from smsid.errors import RecordingError
from smsid.recording import ImportMapping, bundled_mappings, import_recording, load_mapping
from smsid.recording.mapping import parse_mapping

GOOD = """
[time]
column = "t"
unit = "s"

[channel."imu.acceleration"]
columns = ["ax", "ay", "az"]
unit = "g_0"
"""
ATTITUDE = """
[channel."pose.attitude"]
columns = ["q"]
quaternion = "wxyz"
direction = "body_to_inertial"
"""


def load(tmp_path, text):
    path = tmp_path / "map.toml"
    path.write_text(text, encoding="utf-8")
    return load_mapping(path)


def test_a_mapping_is_read_and_frozen(tmp_path):
    mapping = load(tmp_path, GOOD)
    assert isinstance(mapping, ImportMapping)
    assert mapping.channel["imu.acceleration"].columns == ("ax", "ay", "az")
    assert load_mapping(mapping) is mapping
    with pytest.raises(ValueError, match="frozen"):
        mapping.time = None  # type: ignore[misc]


def test_bundled_mappings_load_by_name():
    assert {"oracle_exp1", "oracle_exp2", "px4", "ur_rtde"} <= set(bundled_mappings())
    for name in bundled_mappings():
        assert load_mapping(name).channel
    with pytest.raises(RecordingError, match="no mapping 'oracle_exp3'") as caught:
        load_mapping("oracle_exp3")
    assert "oracle_exp1" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[time\n", "map.toml' is not valid TOML: .*line 1"),
        (GOOD + 'units = "m"\n', r"imu.acceleration, units: unknown key \(did you mean 'unit'\?\)"),
        (GOOD + "[extra]\na = 1\n", "extra: unknown key"),
        (GOOD + "[channels]\n", r"channels: unknown key \(did you mean 'channel'\?\)"),
        (GOOD + '[recording]\nrole = "training"\n', "recording, role: Input should be"),
        (GOOD + "optional = 3\n", "channel, imu.acceleration, optional"),
        (GOOD + "sign = 2\n", "channel, imu.acceleration, sign"),
        (GOOD + "sign = [1, 0, 1]\n", "channel, imu.acceleration, sign"),
        (GOOD + "index = [-1]\n", "channel, imu.acceleration, index"),
        (GOOD + "index = [1]\n", "index takes components from one array"),
        (GOOD.replace('"ay"', '"ax"'), "a column is named twice"),
        (GOOD.replace('columns = ["ax", "ay", "az"]', "columns = []"), "channel, imu.acceleration, columns"),
        (GOOD.replace('unit = "s"', ""), "state the unit of the times"),
        (GOOD + "[clock.imu]\n", "state either column"),
        (GOOD + '[clock.imu]\ncolumn = "t"\nrate = 3.0\n', "state either column"),
        (GOOD + "[clock.imu]\nrate = 0.0\n", "clock, imu, rate"),
        (GOOD + "[clock.imu]\nrate = inf\n", "clock, imu, rate"),
        (GOOD + "[clock.gps]\nrate = 1.0\n", "belongs to no channel"),
        ("[time]\nrate = 1.0\n[channel]\n", "channel"),
        ("[time]\nrate = 1.0\n", "no channel is mapped"),
        (GOOD.split("[channel")[1].join(["[channel", ""]), r"no \[time\], and no \[clock.imu\]"),
        (GOOD + '[csv]\ndelimiter = ",,"\n', "csv, delimiter"),
    ],
)
def test_malformed_mappings_are_named(text, message, tmp_path):
    with pytest.raises(RecordingError, match=message) as caught:
        load(tmp_path, text)
    assert "map.toml" in str(caught.value)
    assert caught.value.advice


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[channel."imu.acc"]\ncolumns = ["a"]\nunit = "m"\n', "unknown quantity 'acc'"),
        ('[channel.imu]\ncolumns = ["a"]\nunit = "m"\n', r'\[channel."imu.<quantity>"\], with the quotes'),
        (GOOD.replace('unit = "g_0"', ""), "the unit is not stated.*unit = 'm/s\\^2'"),
        (GOOD.replace("g_0", "deg"), "'deg' .*cannot become 'm/s\\^2'"),
        (GOOD.replace("g_0", "warp factors"), "is not a unit"),
        (GOOD.replace("g_0", "Nm"), "cannot become 'm/s\\^2'.*'N m'"),
        ('[channel."imu.angular_rate"]\ncolumns = ["a"]\nunit = "Hz"\n', "'Hz'.*cannot become 'rad/s'"),
        ('[channel."encoder.joint_position"]\ncolumns = ["a"]\nunit = "1"\n', "'1'.*cannot become 'rad'"),
        ('[channel."command.torque"]\ncolumns = ["a"]\nunit = "N rad m"\n', "cannot become 'N m'"),
        (ATTITUDE.replace('quaternion = "wxyz"', ""), "convention of the quaternion is not stated"),
        (ATTITUDE.replace('direction = "body_to_inertial"', ""), "convention of the quaternion"),
        (ATTITUDE + 'unit = "deg"\n', "an attitude has no unit"),
        (ATTITUDE + "sign = -1\n", "an attitude has no unit"),
        (GOOD + 'quaternion = "wxyz"\n', "belong to attitudes"),
        (GOOD + 'frame = "inertial"\n', "it is given in the inertial frame"),
        (GOOD + 'frame = "inertial"\nattitude = "pose.attitude"\n', "'pose.attitude' is not mapped"),
        (GOOD + 'frame = "body"\nattitude = "pose.attitude"\n' + ATTITUDE, "nothing to turn"),
        (GOOD + 'frame = "inertial"\nattitude = "imu.acceleration"\n', "is not an attitude"),
        (
            '[channel."encoder.joint_position"]\ncolumns = ["a"]\nunit = "rad"\nframe = "body"\n',
            "cannot be turned",
        ),
        ('[channel."extra.temperature"]\ncolumns = ["a"]\n', "has no unit"),
        ('[channel."extra.temperature"]\ncolumns = ["a"]\nunit = "warm"\n', "is not a unit"),
    ],
)
def test_channels_that_contradict_the_catalogue_are_named(text, message, tmp_path):
    text = text if text.lstrip().startswith("[time]") else f"[time]\nrate = 10.0\n{text}"
    with pytest.raises(RecordingError, match=message) as caught:
        load(tmp_path, text)
    assert "map.toml" in str(caught.value)


def test_a_missing_mapping_is_named(tmp_path):
    with pytest.raises(RecordingError, match="does not exist"):
        load_mapping(tmp_path / "gone.toml")


def test_joints_have_a_unit_for_each_column(tmp_path):
    (tmp_path / "log.csv").write_text(
        "t,rail,swing,force,torque\n" + "".join(f"{0.01 * k},{k},{90 + k},{k},{k}\n" for k in range(20))
    )
    tree = {
        "time": {"column": "t", "unit": "s"},
        "channel": {
            "encoder.joint_position": {
                "columns": ["rail", "swing"],
                "unit": ["mm", "degree"],
                "labels": ["rail", "swing"],
            },
            "drive.joint_torque": {
                "columns": ["force", "torque"],
                "unit": ["N", "N m"],
                "labels": ["rail", "swing"],
            },
        },
    }
    found = import_recording(tmp_path / "log.csv", parse_mapping(tree), check=False)
    np.testing.assert_allclose(found["encoder.joint_position"][5], [0.005, np.radians(95.0)])
    np.testing.assert_allclose(found["drive.joint_torque"][5], [5.0, 5.0])
    assert found.provenance["imported"]["sliding"] == ["rail"]
    tree["channel"]["encoder.joint_position"]["unit"] = ["mm"]
    with pytest.raises(RecordingError, match="1 units for 2 columns"):
        parse_mapping(tree)
    tree["channel"]["encoder.joint_position"]["unit"] = ["kg", "degree"]
    with pytest.raises(RecordingError, match="cannot become"):
        parse_mapping(tree)
