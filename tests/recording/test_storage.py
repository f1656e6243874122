from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from smsid.errors import RecordingError
from smsid.recording import Recording, load_recording, save_recording
from smsid.recording.storage import SEAL, SUM_SIZE, file_attribute

from .samples import recording

anything = st.floats(allow_nan=True, allow_infinity=True, width=64)
json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**60), 2**60)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
label = st.text(
    st.characters(blacklist_categories=("Cs", "Cc"), blacklist_characters="\x00"), min_size=1, max_size=6
)


@st.composite
def recordings(draw):
    samples, joints, stations = (draw(st.integers(1, 6)) for _ in range(3))
    own = draw(st.integers(1, 6))

    def array(*shape):
        return draw(hnp.arrays(np.float64, shape, elements=anything))

    channels = {
        "imu.acceleration": (array(own), array(own, 3)),
        "encoder.joint_position": array(samples, joints),
        "panel.acceleration": array(samples, stations, 3),
        "pose.attitude": array(samples, 4),
        "extra.a.b c": array(samples, 2),
    }
    return Recording.from_arrays(
        array(samples),
        channels,
        units={"extra.a.b c": "K"},
        labels={"joint": draw(st.lists(label, min_size=joints, max_size=joints, unique=True))},
        provenance=draw(st.dictionaries(st.text(max_size=5), json_values, max_size=3)),
        role=draw(st.sampled_from(["estimation", "validation", "unspecified"])),
        name=draw(label | st.just("")),
    )


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rec=recordings())
def test_what_is_saved_comes_back_bit_for_bit(rec, tmp_path):
    path = save_recording(rec, tmp_path / "rec.nc")
    back = load_recording(path)
    assert back.equals(rec)
    for name in rec.channels:
        assert back[name].tobytes() == rec[name].tobytes()


def test_the_file_explains_itself_to_other_readers(tmp_path):
    path = save_recording(recording(name="exp", role="validation"), tmp_path / "rec.nc")
    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        assert dataset.attrs["schema"] == "smsid.recording"
        assert dataset.attrs["schema_version"] == 1
        assert dataset["imu.acceleration"].attrs == {"unit": "m/s^2", "frame": "body"}
        assert dataset["pose.attitude"].attrs["quaternion_order"] == "x y z w"
        assert list(dataset["joint"].values) == ["shoulder", "elbow"]
    with h5py.File(path) as file:
        assert "imu.acceleration" in file


def test_saving_replaces_the_old_file_and_leaves_nothing_beside_it(tmp_path):
    path = tmp_path / "rec.nc"
    save_recording(recording(), path)
    save_recording(recording(name="second"), path)
    assert load_recording(path).name == "second"
    assert os.listdir(tmp_path) == ["rec.nc"]


def test_a_failed_save_keeps_the_old_file(tmp_path, monkeypatch):
    path = save_recording(recording(name="first"), tmp_path / "rec.nc")

    whole = Path.write_bytes

    def broken(self, data):
        whole(self, bytes(data)[: len(data) // 2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", broken)
    with pytest.raises(RecordingError, match="disk is full"):
        save_recording(recording(name="second"), path)
    assert load_recording(path).name == "first"
    assert os.listdir(tmp_path) == ["rec.nc"]


def test_saving_into_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="does not exist"):
        save_recording(recording(), tmp_path / "gone" / "rec.nc")


@pytest.mark.parametrize("share", [0.0, 0.0001, 0.01, 0.3, 0.7, 0.99, 0.9999])
def test_a_file_cut_short_is_named(share, tmp_path):
    path = save_recording(recording(), tmp_path / "rec.nc")
    data = path.read_bytes()
    path.write_bytes(data[: int(share * (len(data) - len(SEAL) - SUM_SIZE))])
    with pytest.raises(RecordingError, match=r"rec\.nc .*cut short") as caught:
        load_recording(path)
    assert caught.value.advice


@pytest.mark.parametrize("left", [0, 2, 16, 31])
def test_a_file_that_lost_its_sum_alone_is_read_or_refused(left, tmp_path):
    path = save_recording(recording(), tmp_path / "rec.nc")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) - len(SEAL) - SUM_SIZE + left])
    if left < 6:
        assert load_recording(path).equals(recording())
    else:
        with pytest.raises(RecordingError, match="cut short or damaged"):
            load_recording(path)


def test_damage_inside_the_samples_is_found(tmp_path):
    rec = recording()
    path = save_recording(rec, tmp_path / "rec.nc")
    data = bytearray(path.read_bytes())
    place = data.find(rec["imu.acceleration"][50:60].tobytes())
    assert place > 0
    data[place + 3] ^= 0xFF
    path.write_bytes(bytes(data))
    with pytest.raises(RecordingError, match="damaged"):
        load_recording(path)


def test_damage_anywhere_is_found_before_hdf5_reads_it(tmp_path, monkeypatch):
    """HDF5 itself never comes back from some damaged files, so none may reach it."""
    path = save_recording(recording(), tmp_path / "rec.nc")
    whole = path.read_bytes()
    monkeypatch.setattr(h5py, "File", lambda *_: pytest.fail("HDF5 was given a damaged file"))
    for place in range(8, len(whole), len(whole) // 199):
        data = bytearray(whole)
        data[place] ^= 0x10
        path.write_bytes(data)
        with pytest.raises(RecordingError, match="damaged"):
            load_recording(path)
        assert file_attribute(path, "schema") == ""


def test_a_file_that_another_program_changed_is_read(tmp_path):
    path = save_recording(recording(), tmp_path / "rec.nc")
    with h5py.File(path, "r+") as file:
        file.attrs["name"] = "renamed"
    assert load_recording(path).name == "renamed"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"t,x\n0,1\n", "not an HDF5 file"),
        (b"CDF\x01" + bytes(40), "classic netCDF"),
        (b"PK\x03\x04" + bytes(40), "import_recording"),
    ],
)
def test_another_kind_of_file_is_named(content, message, tmp_path):
    path = tmp_path / "rec.nc"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=message) as caught:
        load_recording(path)
    assert caught.value.evidence["path"] == str(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(RecordingError, match="no file"):
        load_recording(tmp_path / "gone.nc")
    with pytest.raises(RecordingError, match="no file"):
        load_recording(tmp_path)


def altered(tmp_path, change):
    path = save_recording(recording(), tmp_path / "rec.nc")
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def test_an_unknown_schema_version_is_refused(tmp_path):
    path = altered(tmp_path, lambda file: file.attrs.modify("schema_version", 2))
    with pytest.raises(RecordingError, match="schema version 2; this smsid reads version 1"):
        load_recording(path)


def test_hdf5_of_another_kind_is_sent_to_the_importer(tmp_path):
    path = altered(tmp_path, lambda file: file.attrs.__delitem__("schema"))
    with pytest.raises(RecordingError, match="not a recording of smsid"):
        load_recording(path)


@pytest.mark.parametrize(
    ("channel", "key", "value", "message"),
    [
        ("imu.acceleration", "unit", "g_0", "not in 'g_0'"),
        ("imu.acceleration", "frame", "inertial", "in frame 'inertial'"),
        ("pose.attitude", "quaternion_order", "w x y z", "order w x y z"),
    ],
)
def test_a_file_with_other_conventions_is_refused(channel, key, value, message, tmp_path):
    path = altered(tmp_path, lambda file: file[channel].attrs.__setitem__(key, value))
    with pytest.raises(RecordingError, match=message) as caught:
        load_recording(path)
    assert "rec.nc" in str(caught.value)


def test_reading_and_writing_do_without_xarray(tmp_path):
    path = save_recording(recording(), tmp_path / "r.nc")
    code = f"""
import sys
from smsid.recording import load_recording, save_recording
again = load_recording({str(path)!r})
save_recording(again.window(1.0, 2.0).without("imu.acceleration"), {str(tmp_path / "s.nc")!r})
assert again.check().labels["joint"] == ("shoulder", "elbow")
print(sorted({{"xarray", "pandas", "dask"}} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
