from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
import xarray as xr

from smsid.errors import RecordingError
from smsid.recording import Recording, load_recording, save_recording

from .samples import LABELS, motion, recording

T = np.arange(5) / 10.0
RATE = np.arange(15.0).reshape(5, 3)


def test_channels_come_back_as_read_only_float64_in_the_order_given():
    rec = Recording.from_arrays(T, {"imu.angular_rate": RATE.astype(np.float32), "pose.position": RATE})
    assert rec.channels == ("imu.angular_rate", "pose.position")
    assert rec["imu.angular_rate"].dtype == np.float64
    np.testing.assert_array_equal(rec["imu.angular_rate"], RATE)
    for array in (rec["imu.angular_rate"], rec.time(), rec.channel("imu.angular_rate").values):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_inputs_are_neither_changed_nor_shared():
    rate, time = RATE.copy(), T.copy()
    rec = Recording.from_arrays(time, {"imu.angular_rate": rate})
    rate[:], time[:] = -1.0, -1.0
    np.testing.assert_array_equal(rec["imu.angular_rate"], RATE)
    np.testing.assert_array_equal(rec.time(), T)


def test_nothing_about_a_recording_can_be_set():
    rec = recording()
    with pytest.raises(AttributeError, match="frozen"):
        rec.role = "validation"  # type: ignore[misc]
    rec.dataset.attrs["role"] = "validation"
    rec.dataset["imu.acceleration"] = 0.0
    rec.channel("imu.acceleration").attrs["unit"] = "g"
    rec.provenance["x"] = 1
    assert rec.equals(recording())


def test_unit_frame_and_labels_stand_with_the_channel():
    rec = recording()
    array = rec.channel("panel.acceleration")
    assert array.dims == ("time", "panel.station", "axis")
    assert (array.attrs["unit"], array.attrs["frame"]) == ("m/s^2", "body")
    assert rec.channel("pose.attitude").attrs["quaternion_order"] == "x y z w"
    assert rec.labels == {"joint": ("shoulder", "elbow"), "panel.station": ("2 m", "4 m")}
    assert float(rec.channel("encoder.joint_position").sel(joint="elbow")[0]) == 0.0


def test_a_source_may_have_its_own_clock():
    rec = Recording.from_arrays(
        T, {"pose.position": RATE, "imu.angular_rate": (T[:4] + 0.01, RATE[:4])}, name="two clocks"
    )
    assert rec.clocks == ("time", "imu.time")
    np.testing.assert_array_equal(rec.time("imu.angular_rate"), T[:4] + 0.01)
    np.testing.assert_array_equal(rec.time("imu"), T[:4] + 0.01)
    np.testing.assert_array_equal(rec.time("pose"), T)


def test_an_own_clock_equal_to_the_shared_one_is_the_shared_one():
    rec = Recording.from_arrays(T, {"pose.position": RATE, "imu.angular_rate": (T.copy(), RATE)})
    assert rec.clocks == ("time",)


def test_without_shared_clock_time_names_the_clocks_there_are():
    rec = Recording.from_arrays(None, {"imu.angular_rate": (T, RATE)})
    with pytest.raises(RecordingError, match=r"imu\.time"):
        rec.time()


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        ({}, "no channels"),
        ({"imu.angular_rate": RATE[:, :2]}, r"has shape \(5, 2\); expected \(N, 3\)"),
        ({"imu.angular_rate": RATE[:4]}, "has 4 samples, its clock 'time' has 5"),
        ({"imu.angular_rate": RATE[:, 0]}, r"expected \(N, 3\)"),
        ({"imu.angular_rate": 3.0}, r"has shape \(\)"),
        ({"encoder.joint_position": RATE[:, :0]}, r"has shape \(5, 0\)"),
        ({"imu.angular_rate": RATE.astype(complex)}, "complex128, not real"),
        ({"imu.angular_rate": RATE > 3}, "bool, not real"),
        ({"imu.angular_rate": [["a"] * 3] * 5}, "not real numbers"),
        ({"imu.angular_rate": [[1.0], [1.0, 2.0]]}, "is not an array"),
        ({"imu.nonsense": RATE}, "unknown quantity"),
        ({"imu.angular_rate": (T, RATE, 1)}, "is a tuple of 3"),
        ({"imu.angular_rate": (T + 1, RATE), "imu.acceleration": (T + 2, RATE)}, "another clock"),
        ({"imu.angular_rate": (T + 1, RATE), "imu.acceleration": RATE}, "on two clocks"),
        ({"imu.angular_rate": (RATE, RATE)}, r"Clock 'imu.time' has shape \(5, 3\)"),
        ({"encoder.joint_position": RATE, "command.joint_torque": RATE[:, :2]}, "has 2 of 'joint'"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(channels, message):
    with pytest.raises(RecordingError, match=message) as caught:
        Recording.from_arrays(T, channels)
    assert caught.value.advice


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"role": "training"}, "no role 'training'"),
        ({"provenance": {"x": object()}}, "cannot be written as JSON"),
        ({"provenance": {"x": float("nan")}}, "cannot be written as JSON"),
        ({"units": {"imu.angular_rate": "deg/s"}}, "not in 'deg/s'"),
        ({"units": {"extra.gone": "K"}}, "channels that are not there"),
        ({"labels": {"axle": ["a"]}}, "no dimension 'axle'"),
        ({"labels": {"joint": ["a"]}}, "1 labels, but 'encoder.joint_position' has 3"),
        ({"labels": {"joint": ["a", "a", "b"]}}, "repeat"),
    ],
)
def test_options_that_do_not_fit_are_refused(options, message):
    channels = {"imu.angular_rate": RATE, "encoder.joint_position": RATE}
    with pytest.raises(RecordingError, match=message):
        Recording.from_arrays(T, channels, **options)


def test_labels_of_what_is_not_recorded_are_no_error():
    rec = Recording.from_arrays(T, {"imu.angular_rate": RATE}, labels={"wheel": ["a", "b"]})
    assert rec.labels == {}


def test_a_source_with_other_joints_labels_them_for_itself():
    rec = Recording.from_arrays(
        T,
        {"command.joint_torque": RATE, "encoder.joint_position": RATE[:, :2]},
        labels={"joint": ["a", "b", "c"], "encoder.joint": ["a", "c"]},
    )
    assert rec.channel("encoder.joint_position").dims == ("time", "encoder.joint")
    assert Recording(rec.dataset).equals(rec)


def test_extra_channels_have_any_shape_and_their_unit():
    rec = Recording.from_arrays(
        T,
        {"extra.temperature": T, "extra.image": np.zeros((5, 2, 7))},
        units={"extra.temperature": "K", "extra.image": "1"},
    )
    assert rec.unit("extra.temperature") == "K"
    assert rec["extra.image"].shape == (5, 2, 7)


def test_numpy_values_in_the_provenance_become_plain():
    rec = recording(provenance={"seed": np.int64(3), "gains": np.ones(2), "pair": (1, 2)})
    assert rec.provenance == {"seed": 3, "gains": [1.0, 1.0], "pair": [1, 2]}


def test_require_names_what_is_missing_and_what_is_there():
    rec = recording()
    rec.require("imu.acceleration")
    assert "imu.acceleration" in rec
    assert "imu.accelaration" not in rec
    with pytest.raises(RecordingError, match=r"Did you mean 'imu\.acceleration'") as caught:
        rec.require("imu.accelaration", "pose.position")
    assert caught.value.evidence["missing"] == ("imu.accelaration",)
    assert caught.value.evidence["present"] == rec.channels
    for call in (rec.__getitem__, rec.channel, rec.unit, rec.time):
        with pytest.raises(RecordingError):
            call("imu.accelaration")


def test_the_constructor_refuses_a_dataset_that_contradicts_the_catalogue():
    good = recording().dataset
    with pytest.raises(RecordingError, match="no unit attribute"):
        Recording(xr.Dataset({"imu.angular_rate": (("time", "axis"), RATE)}, coords={"time": T}))
    wrong = good.copy()
    wrong["imu.acceleration"] = wrong["imu.acceleration"].assign_attrs(unit="g_0")
    with pytest.raises(RecordingError, match="not in 'g_0'"):
        Recording(wrong)
    with pytest.raises(RecordingError, match="first must be its clock"):
        Recording(good.transpose("axis", ...))


def test_window_cuts_every_clock_with_both_ends():
    rec = Recording.from_arrays(T, {"pose.position": RATE, "imu.angular_rate": (T[:4] + 0.01, RATE[:4])})
    cut = rec.window(0.1, 0.3)
    np.testing.assert_array_equal(cut.time(), T[1:4])
    np.testing.assert_array_equal(cut["imu.angular_rate"], RATE[1:3])
    assert cut.provenance["steps"] == [{"window": [0.1, 0.3]}]


def test_a_window_without_samples_is_refused_with_the_span():
    with pytest.raises(RecordingError, match="runs from 0 to 20 s"):
        recording().window(30.0, 40.0)


def test_a_window_with_one_end_can_be_saved(tmp_path):
    cut = recording().window(0.1, float("inf"))
    save_recording(cut, tmp_path / "cut.nc")
    assert load_recording(tmp_path / "cut.nc").provenance["steps"] == [{"window": [0.1, None]}]


def test_with_channels_replaces_on_the_clock_the_source_has():
    rec = Recording.from_arrays(T, {"pose.position": RATE, "imu.angular_rate": (T[:4] + 0.01, RATE[:4])})
    new = rec.with_channels({"imu.angular_rate": 2 * RATE[:4], "extra.flag": T}, units={"extra.flag": "1"})
    np.testing.assert_array_equal(new["imu.angular_rate"], 2 * RATE[:4])
    np.testing.assert_array_equal(new.time("imu"), rec.time("imu"))
    assert new.unit("extra.flag") == "1"
    assert "extra.flag" not in rec
    np.testing.assert_array_equal(rec["imu.angular_rate"], RATE[:4])
    assert new.with_channels({"extra.flag": 2 * T}, units={"extra.flag": "K"}).unit("extra.flag") == "K"


def test_a_source_can_move_to_another_clock_when_all_its_channels_do():
    rec = Recording.from_arrays(T, {"pose.position": RATE, "imu.angular_rate": (T[:4] + 0.01, RATE[:4])})
    new = rec.with_channels({"imu.angular_rate": (T[:3] + 0.02, RATE[:3])})
    assert new.time("imu").size == 3
    two = rec.with_channels({"imu.acceleration": RATE[:4]})
    with pytest.raises(RecordingError, match="another clock"):
        two.with_channels({"imu.angular_rate": (T[:3] + 0.02, RATE[:3])})


def test_without_drops_channels_and_the_clocks_and_labels_only_they_used():
    rec = recording().without("panel.acceleration")
    assert "panel.acceleration" not in rec
    assert rec.labels == {"joint": ("shoulder", "elbow")}


def test_role_name_and_provenance_change_in_a_copy():
    rec = recording(provenance={"a": 1})
    new = rec.with_role("validation").with_name("second").with_provenance({"b": 2})
    assert (new.role, new.name, new.provenance) == ("validation", "second", {"a": 1, "b": 2})
    assert (rec.role, rec.name, rec.provenance) == ("unspecified", "", {"a": 1})
    with pytest.raises(RecordingError, match="no role"):
        rec.with_role("test")


def test_equals_sees_every_difference():
    rec = recording(provenance={"a": 1, "b": 2})
    assert rec.equals(recording(provenance={"b": 2, "a": 1}))
    bumped = rec["pose.position"].copy()
    bumped[3, 1] = np.nextafter(bumped[3, 1], np.inf)
    others = [
        rec.with_channels({"pose.position": bumped}),
        rec.with_role("validation"),
        rec.with_name("x"),
        rec.with_provenance({"a": 2}),
        rec.without("pose.position"),
        recording(labels={**LABELS, "joint": ["a", "b"]}, provenance={"a": 1, "b": 2}),
        "no recording",
    ]
    assert not any(rec.equals(other) for other in others)


def test_nan_equals_nan():
    holes = np.where(RATE == 4.0, np.nan, RATE)
    first, second = (Recording.from_arrays(T, {"imu.angular_rate": holes}) for _ in range(2))
    assert first.equals(second)


def test_copies_and_pickles_are_equal_and_still_read_only():
    rec = recording(provenance={"a": 1})
    for twin in (pickle.loads(pickle.dumps(rec)), copy.deepcopy(rec), copy.copy(rec), Recording(rec.dataset)):
        assert twin.equals(rec)
        assert not twin["pose.position"].flags.writeable


def test_motion_of_the_samples_is_what_it_says():
    t = np.linspace(0.0, 5.0, 20001)
    channels = motion(t)
    slope = np.gradient(channels["pose.velocity"], t, axis=0)
    np.testing.assert_allclose(
        np.linalg.norm(slope, axis=1)[5:-5],
        np.linalg.norm(channels["imu.acceleration"], axis=1)[5:-5],
        atol=1e-6,
    )


def test_a_recording_is_gone_through_by_its_channels():
    """`list(recording)` and `dict(recording)` ended in an error of difflib's."""
    rec = recording()
    assert list(rec) == list(rec.channels) and set(rec) == {c for c in rec.channels if c in rec}
    assert {c: x.shape for c, x in dict(rec).items()} == {c: rec[c].shape for c in rec.channels}
