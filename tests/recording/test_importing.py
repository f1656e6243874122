from __future__ import annotations

import gzip
import hashlib
from typing import Any

import h5py
import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from smsid.errors import RecordingError
from smsid.recording import import_recording
from smsid.recording.mapping import parse_mapping

from .samples import motion

N = 301
T = np.arange(N) / 50.0
MOTION = motion(T)
TIME = {"column": "t", "unit": "s"}
ATTITUDE = {"columns": ["q"], "quaternion": "xyzw", "direction": "body_to_inertial"}


def bring(tmp_path, arrays: dict[str, Any], channel: dict[str, Any], **tables: Any):
    """Import arrays through an NPZ file; ``check`` among the tables goes to `import_recording`."""
    check = tables.pop("check", True)
    np.savez(tmp_path / "log.npz", **{"t": T, **arrays})
    (tmp_path / "map.toml").write_text(tomli_w.dumps({"time": TIME, **tables, "channel": channel}))
    return import_recording(tmp_path / "log.npz", tmp_path / "map.toml", check=check)


def csv_text(arrays: dict[str, np.ndarray], delimiter=",", decimal=".") -> str:
    columns: dict[str, np.ndarray] = {}
    for name, array in arrays.items():
        for k, column in enumerate(array.reshape(N, -1).T):
            columns[name if array.ndim == 1 else f"{name}{k}"] = column
    rows = [delimiter.join(columns)]
    rows += [
        delimiter.join(repr(float(x)).replace(".", decimal) for x in row)
        for row in zip(*columns.values(), strict=True)
    ]
    return "\n".join(rows) + "\n"


LOG = {
    "t": 1000.0 * T,
    "rate": np.degrees(MOTION["imu.angular_rate"]),
    "q": np.roll(MOTION["pose.attitude"], 1, axis=1),
}


def log_mapping(separate: bool) -> dict[str, Any]:
    def columns(name: str, size: int) -> list[str]:
        return [f"{name}{k}" for k in range(size)] if separate else [name]

    return {
        "time": {"column": "t", "unit": "ms"},
        "recording": {"name": "lab", "role": "validation", "note": "run 7"},
        "channel": {
            "pose.attitude": {**ATTITUDE, "columns": columns("q", 4), "quaternion": "wxyz"},
            "imu.angular_rate": {"columns": columns("rate", 3), "unit": "deg/s"},
        },
    }


def write_log(tmp_path, suffix):
    path = tmp_path / f"log{suffix}"
    if suffix == ".csv":
        path.write_text(csv_text(LOG))
    elif suffix == ".csv.gz":
        path.write_bytes(gzip.compress(csv_text(LOG, ";", ",").encode()))
    elif suffix == ".npz":
        np.savez(path, **LOG)
    elif suffix == ".mat":
        savemat(path, LOG)
    else:
        with h5py.File(path, "w") as file:
            for name, array in LOG.items():
                file[name] = array
    return path


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".npz", ".mat", ".h5", ".nc"])
def test_every_format_gives_the_same_recording(suffix, tmp_path):
    path = write_log(tmp_path, suffix)
    rec = import_recording(path, parse_mapping(log_mapping(suffix.startswith(".csv"))))
    assert (rec.name, rec.role, rec.provenance["note"]) == ("lab", "validation", "run 7")
    np.testing.assert_allclose(rec.time(), T, rtol=1e-15)
    np.testing.assert_array_equal(rec["pose.attitude"], MOTION["pose.attitude"])
    np.testing.assert_allclose(rec["imu.angular_rate"], MOTION["imu.angular_rate"], rtol=1e-14)


def test_the_provenance_tells_file_sum_and_mapping(tmp_path):
    rec = bring(tmp_path, {"p": MOTION["pose.position"]}, {"pose.position": {"columns": ["p"], "unit": "m"}})
    imported = rec.provenance["imported"]
    assert imported["file"] == "log.npz"
    assert imported["sha256"] == hashlib.sha256((tmp_path / "log.npz").read_bytes()).hexdigest()
    assert imported["mapping_file"] == "map.toml"
    assert imported["mapping"]["channel"]["pose.position"] == {"columns": ["p"], "unit": "m"}


@settings(deadline=None)
@given(
    order=st.sampled_from(["wxyz", "xyzw"]),
    direction=st.sampled_from(["body_to_inertial", "inertial_to_body"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_quaternion_conventions_describe_one_rotation(order, direction, seed, tmp_path_factory):
    truth = Rotation.random(5, random_state=seed)
    written = truth if direction == "body_to_inertial" else truth.inv()
    q = written.as_quat(scalar_first=order == "wxyz")
    folder = tmp_path_factory.mktemp("quaternion")
    table = {"columns": ["q"], "quaternion": order, "direction": direction}
    rec = bring(folder, {"q": q}, {"pose.attitude": table}, time={"rate": 10.0})
    np.testing.assert_allclose(
        Rotation.from_quat(rec["pose.attitude"]).as_matrix(), truth.as_matrix(), atol=1e-14
    )


def turned(name: str, back: bool) -> np.ndarray:
    rotation = Rotation.from_quat(MOTION["pose.attitude"])
    return (rotation.inv() if back else rotation).apply(MOTION[name])


@pytest.mark.parametrize(
    ("name", "unit", "frame", "back"),
    [
        ("imu.acceleration", "m/s^2", "inertial", False),
        ("imu.angular_rate", "rad/s", "inertial", False),
        ("pose.velocity", "m/s", "body", True),
    ],
)
def test_vectors_in_the_other_frame_are_turned_by_the_attitude(name, unit, frame, back, tmp_path):
    table = {"columns": ["x"], "unit": unit, "frame": frame, "attitude": "pose.attitude"}
    arrays = {"x": turned(name, back), "q": MOTION["pose.attitude"]}
    rec = bring(tmp_path, arrays, {name: table, "pose.attitude": ATTITUDE})
    np.testing.assert_allclose(rec[name], MOTION[name], atol=1e-14)


def test_the_attitude_that_turns_may_have_another_clock_and_convention(tmp_path):
    own = np.arange(1201) / 200.0
    q = np.roll(motion(own)["pose.attitude"] * [-1, -1, -1, 1], 1, axis=1)
    channel = {
        "imu.acceleration": {
            "columns": ["x"],
            "unit": "m/s^2",
            "frame": "inertial",
            "attitude": "pose.attitude",
        },
        "pose.attitude": {"columns": ["q"], "quaternion": "wxyz", "direction": "inertial_to_body"},
    }
    arrays = {"x": turned("imu.acceleration", False), "q": q}
    rec = bring(tmp_path, arrays, channel, clock={"pose": {"rate": 200.0}})
    np.testing.assert_allclose(rec["imu.acceleration"], MOTION["imu.acceleration"], atol=1e-6)
    assert rec.clocks == ("time", "pose.time")
    with pytest.raises(RecordingError, match=r"does not cover 'imu\.acceleration'"):
        bring(tmp_path, arrays, channel, clock={"pose": {"rate": 201.0}})


def test_signs_are_applied_to_all_or_by_component(tmp_path):
    arrays = {"p": MOTION["pose.position"], "v": MOTION["pose.velocity"]}
    channel = {
        "pose.position": {"columns": ["p"], "unit": "m", "sign": -1},
        "pose.velocity": {"columns": ["v"], "unit": "m/s", "sign": [-1, 1, -1]},
    }
    rec = bring(tmp_path, arrays, channel, check=False)
    np.testing.assert_array_equal(rec["pose.position"], -MOTION["pose.position"])
    np.testing.assert_array_equal(rec["pose.velocity"], MOTION["pose.velocity"] * [-1, 1, -1])
    channel["pose.velocity"]["sign"] = [1, 1]
    with pytest.raises(RecordingError, match="2 signs"):
        bring(tmp_path, arrays, channel)


def test_index_time_axis_and_labels_shape_an_array(tmp_path):
    q = np.column_stack([MOTION["encoder.joint_position"], np.zeros(N)])
    acc = np.concatenate([MOTION["imu.acceleration"], 2 * MOTION["imu.acceleration"]], axis=1)
    channel = {
        "encoder.joint_position": {
            "columns": ["q"],
            "unit": "rad",
            "time_axis": 1,
            "index": [1, 0],
            "labels": ["elbow", "shoulder"],
        },
        "panel.acceleration": {"columns": ["acc"], "unit": "m/s^2", "labels": ["2 m", "4 m"]},
        "extra.temperature": {"columns": ["k"], "unit": "degC"},
    }
    rec = bring(tmp_path, {"q": q.T, "acc": acc, "k": T}, channel)
    np.testing.assert_array_equal(rec["encoder.joint_position"], MOTION["encoder.joint_position"][:, ::-1])
    np.testing.assert_array_equal(rec["panel.acceleration"][:, 1], 2 * MOTION["imu.acceleration"])
    assert rec.labels == {"joint": ("elbow", "shoulder"), "panel.station": ("2 m", "4 m")}
    assert rec.unit("extra.temperature") == "degC"


def test_optional_channels_may_be_absent_and_the_provenance_says_so(tmp_path):
    channel = {
        "pose.position": {"columns": ["p"], "unit": "m"},
        "pose.velocity": {"columns": ["v"], "unit": "m/s", "optional": True},
    }
    rec = bring(tmp_path, {"p": MOTION["pose.position"]}, channel)
    assert rec.channels == ("pose.position",)
    assert rec.provenance["imported"]["absent"] == ["pose.velocity"]


def test_an_optional_channel_with_half_its_columns_is_an_error(tmp_path):
    channel = {
        "pose.position": {"columns": ["p"], "unit": "m"},
        "pose.velocity": {"columns": ["vx", "vy", "vz"], "unit": "m/s", "optional": True},
    }
    with pytest.raises(RecordingError, match="has no 'vz'"):
        bring(tmp_path, {"p": MOTION["pose.position"], "vx": T, "vy": T}, channel)


RATE = {"imu.angular_rate": {"columns": ["rate"], "unit": "rad/s"}}
MAYBE = {"imu.angular_rate": {**RATE["imu.angular_rate"], "optional": True}}
ZEROS = {"rate": np.zeros((N, 3))}


def clock(column: str, unit: str) -> dict[str, Any]:
    return {"time": {"column": column, "unit": unit}}


@pytest.mark.parametrize(
    ("arrays", "channel", "tables", "message"),
    [
        ({"rates": T}, RATE, {}, r"has no 'rate', asked for by .*; it has t, rates.*Did you mean 'rates'"),
        (ZEROS, RATE, clock("time", "s"), r"asked for by \[time\]"),
        (ZEROS, RATE, clock("t", "m"), r"\[time\].*cannot become 's'"),
        (ZEROS, RATE, clock("rate", "s"), r"'rate' has shape \(301, 3\)"),
        ({"rate": np.zeros((N - 1, 3))}, RATE, {}, "has 300 samples, its clock has 301"),
        ({"rate": np.zeros((N, 2))}, RATE, {}, r"make \(301, 2\); expected \(N, 3\)"),
        ({"rate": np.zeros((3, N))}, RATE, {}, "time_axis"),
        ({"rate": np.array(["a"] * N)}, RATE, {}, "'a' is not a number"),
        ({"rate": np.ones((N, 3), dtype=complex)}, RATE, {}, "holds complex128"),
        (
            {"a": T, "b": T[:-1], "c": T},
            {"imu.angular_rate": {"columns": ["a", "b", "c"], "unit": "rad/s"}},
            {},
            "different lengths: a 301, b 300, c 301",
        ),
        (
            {"a": T, "b": np.zeros((N, 2))},
            {"imu.angular_rate": {"columns": ["a", "b"], "unit": "rad/s"}},
            {},
            "'b' is not a single column",
        ),
        (
            ZEROS,
            {"imu.angular_rate": {"columns": ["rate"], "unit": "rad/s", "index": [0, 1, 3]}},
            {},
            r"index \[0, 1, 3\] does not fit 'rate'",
        ),
        (
            ZEROS,
            {"imu.angular_rate": {"columns": ["rate"], "unit": "rad/s", "time_axis": 2}},
            {},
            "time_axis = 2",
        ),
        (
            ZEROS,
            {"imu.angular_rate": {"columns": ["rate"], "unit": "rad/s", "labels": ["a", "b", "c"]}},
            {},
            "nothing to label",
        ),
        ({}, MAYBE, {}, "none of the mapped channels"),
    ],
)
def test_what_does_not_fit_is_named(arrays, channel, tables, message, tmp_path):
    with pytest.raises(RecordingError, match=message) as caught:
        bring(tmp_path, arrays, channel, **tables)
    assert "log.npz" in str(caught.value) or "Channel" in str(caught.value)
    assert caught.value.advice


def csv_import(tmp_path, text):
    (tmp_path / "log.csv").write_text(text)
    table = {"imu.angular_rate": {"columns": ["x", "y", "z"], "unit": "rad/s"}}
    return import_recording(tmp_path / "log.csv", parse_mapping({"time": TIME, "channel": table}))


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ("oops", "column 'y', row 2 after the header: 'oops' is not a number"),
        ("", "'imu.angular_rate' is nan at index 1"),
        ("1_000", "'1_000' is not a number"),
        ("nan", "'imu.angular_rate' is nan at index 1"),
    ],
)
def test_a_cell_that_is_no_number_is_named_by_row_and_column(cell, message, tmp_path):
    with pytest.raises(RecordingError, match=message) as caught:
        csv_import(tmp_path, f"t,x,y,z,state\n0,1,2,3,on\n1,1,{cell},3,on\n2,1,2,3,off\n")
    assert "log.csv" in str(caught.value)


def test_text_in_a_column_nobody_maps_does_no_harm(tmp_path):
    rec = csv_import(tmp_path, "t,x,y,z,state\n0,1,2,3,on\n1,1,2,3,on\n2,1,2,3,\n")
    assert rec["imu.angular_rate"].shape == (3, 3)


def test_a_unit_that_the_data_contradict_is_refused_unless_unchecked(tmp_path):
    t = np.arange(3001) / 50.0
    exact = motion(t)
    arrays = {"t": t, "q": np.degrees(exact["encoder.joint_position"]), "qd": exact["encoder.joint_velocity"]}
    channel = {
        "encoder.joint_position": {"columns": ["q"], "unit": "rad"},
        "encoder.joint_velocity": {"columns": ["qd"], "unit": "rad/s"},
    }
    with pytest.raises(RecordingError, match=r"log.npz: .*probably in degrees.*check=False"):
        bring(tmp_path, arrays, channel)
    assert bring(tmp_path, arrays, channel, check=False).suspicious()
    channel["encoder.joint_position"]["unit"] = "deg"
    assert bring(tmp_path, arrays, channel).suspicious() == []


def test_an_attitude_of_zeros_cannot_turn_a_vector(tmp_path):
    channel = {
        "imu.acceleration": {
            "columns": ["x"],
            "unit": "m/s^2",
            "frame": "inertial",
            "attitude": "pose.attitude",
        },
        "pose.attitude": ATTITUDE,
    }
    with pytest.raises(RecordingError, match="no attitude at index 0"):
        bring(tmp_path, {"x": np.ones((N, 3)), "q": np.zeros((N, 4))}, channel, check=False)


def test_channels_that_share_joints_must_label_them_alike(tmp_path):
    arrays = {"q": MOTION["encoder.joint_position"], "qd": MOTION["encoder.joint_velocity"]}
    channel = {
        "encoder.joint_position": {"columns": ["q"], "unit": "rad", "labels": ["a", "b"]},
        "encoder.joint_velocity": {"columns": ["qd"], "unit": "rad/s", "labels": ["b", "a"]},
    }
    with pytest.raises(RecordingError, match="labels 'joint'"):
        bring(tmp_path, arrays, channel)


def test_all_faults_of_a_mapping_are_told_at_once(tmp_path):
    arrays = {"rate": np.zeros((N, 3)), "angle": np.zeros((N, 3))}
    channel = {
        "imu.angular_rate": {"columns": ["rates"], "unit": "rad/s"},
        "imu.acceleration": {"columns": ["rate"], "unit": "m/s^2", "sign": [1, -1]},
        "encoder.joint_position": {"columns": ["angle"], "unit": "deg", "labels": ["a", "b", "c"]},
    }
    with pytest.raises(RecordingError) as raised:
        bring(tmp_path, arrays, channel)
    assert len(raised.value.evidence["faults"]) == 2
    for said in ("2 faults", "'rates'", "'imu.acceleration'", "2 signs"):
        assert said in str(raised.value)
