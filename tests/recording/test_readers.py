from __future__ import annotations

import gzip

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from smsid.errors import RecordingError
from smsid.recording import CsvFormat, read_columns
from smsid.recording.readers import READERS

TABLE = {"t": [0.0, 0.5, 1.0], "x": [1.25, -2.5, 3e-7]}


def write(tmp_path, text, name="log.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def agree(columns, expected=TABLE):
    assert list(columns) == list(expected)
    for name, values in expected.items():
        assert columns[name].dtype == np.float64
        np.testing.assert_array_equal(columns[name], values)


@pytest.mark.parametrize(
    "text",
    [
        "t,x\n0,1.25\n0.5,-2.5\n1.0,3e-7\n",
        "t,x\n0,1.25\n0.5,-2.5\n1.0,3e-7",
        "\ufefft,x\r\n0,1.25\r\n0.5,-2.5\r\n1.0,3e-7\r\n\r\n",
        "t;x\n0,0;1,25\n0,5;-2,5\n1,0;3e-7\n",
        "t\tx\n0\t1.25\n0.5\t-2.5\n1.0\t3e-7\n",
        "t|x\n0|1.25\n0.5|-2.5\n1.0|3e-7\n",
        "# made by a logger, v2\n\n t , x \n 0, 1.25\n0.5,-2.5 \n1.0,3e-7\n",
        '"t";"x"\n"0,0";"1,25"\n"0,5";"-2,5"\n"1,0";"3e-7"\n',
        "t,x,\n0,1.25,\n0.5,-2.5,\n1.0,3e-7,\n",
    ],
    ids=["comma", "no end", "bom", "decimal comma", "tab", "bar", "comment", "quoted", "trailing delimiter"],
)
def test_dialects_of_csv_are_found_out(text, tmp_path):
    agree(read_columns(write(tmp_path, text)))


def test_a_gzipped_csv_is_read(tmp_path):
    agree(read_columns(write(tmp_path, gzip.compress(b"t,x\n0,1.25\n0.5,-2.5\n1.0,3e-7\n"), "log.csv.gz")))


def test_what_is_stated_is_used(tmp_path):
    path = write(tmp_path, "ROCKET 7\n0 1,25\n0,5 -2,5\n1,0 3e-7\n")
    agree(read_columns(path, CsvFormat(delimiter=" ", decimal=",", skip_rows=1, names=("t", "x"))))


def test_a_column_of_text_keeps_its_text(tmp_path):
    columns = read_columns(write(tmp_path, "t,state\n0,idle\n1,run\n"))
    assert list(columns["state"]) == ["idle", "run"]
    np.testing.assert_array_equal(columns["t"], [0.0, 1.0])


def test_nan_and_infinity_are_numbers(tmp_path):
    columns = read_columns(write(tmp_path, "t,x\n0,nan\n1,-inf\n"))
    np.testing.assert_array_equal(columns["x"], [np.nan, -np.inf])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,x\n0,1\n0.5,2\n1.0", r"line 4: 1 cells, but there are 2 columns; the file is cut short"),
        ("t,x\n0,1\n0.5\n1.0,3\n", r"line 3: 1 cells, but there are 2 columns\."),
        ("t,x\n0,1\n0.5,2,3\n1.0,3\n", r"line 3: 3 cells"),
        ("t,x\n0,1\n\n1.0,3\n", r"line 3: 0 cells"),
        ("t,x\n", "has no samples"),
        ("", "no lines"),
        ("\n\n", "no lines"),
        ("t x y\n0 1\n", "no delimiter found"),
        ("t,x\n0,000,1,000\n0,100,2,000\n", r"line 2: 4 cells.*decimals look like commas"),
        (b"t,x\n\xff\x00\x01,1\n", "no text in UTF-8, UTF-16 or Windows-1252"),
    ],
)
def test_what_is_wrong_with_a_csv_is_named(text, message, tmp_path):
    with pytest.raises(RecordingError, match=message) as caught:
        read_columns(write(tmp_path, text))
    assert "log.csv" in str(caught.value)
    assert caught.value.advice


def test_line_numbers_count_what_is_skipped(tmp_path):
    with pytest.raises(RecordingError, match="line 6: 1 cells"):
        read_columns(write(tmp_path, "# a\n# b\nt,x\n0,1\n1,2\n3\n4,5\n"))


@pytest.mark.parametrize("share", [0.5, 0.98])
def test_a_gzipped_csv_cut_short_is_named(share, tmp_path):
    data = gzip.compress(b"t,x\n" + b"".join(b"%d,%d\n" % (k, k * k) for k in range(500)))
    with pytest.raises(RecordingError, match="cut short"):
        read_columns(write(tmp_path, data[: int(share * len(data))], "log.csv.gz"))


def test_npz_arrays_come_by_name(tmp_path):
    np.savez(tmp_path / "log.npz", t=np.arange(3), acc=np.ones((3, 2, 3), dtype=np.float32))
    columns = read_columns(tmp_path / "log.npz")
    assert {name: array.shape for name, array in columns.items()} == {"t": (3,), "acc": (3, 2, 3)}


def test_mat_vectors_are_flat_and_fields_have_dotted_names(tmp_path):
    tree = {"t": np.arange(3.0)[:, None], "data": {"imu": {"acc": np.ones((3, 3))}, "name": "exp"}}
    savemat(tmp_path / "log.mat", tree)
    columns = read_columns(tmp_path / "log.mat")
    assert columns["t"].shape == (3,)
    assert columns["data.imu.acc"].shape == (3, 3)


def test_mat_7_3_has_the_axes_of_matlab(tmp_path):
    path = tmp_path / "log.mat"
    acc = np.arange(12.0).reshape(4, 3)
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"] = np.arange(4.0)[None, :]
        file["data/acc"] = acc.T
    header = b"MATLAB 7.3 MAT-file, made for a test".ljust(124) + b"\x00\x02IM"
    with path.open("rb+") as stream:
        stream.write(header)
    columns = read_columns(path)
    assert columns["t"].shape == (4,)
    np.testing.assert_array_equal(columns["data.acc"], acc)


def test_hdf5_arrays_come_by_path_and_packed_ones_are_unpacked(tmp_path):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["imu/acc"] = np.ones((3, 3))
        packed = file.create_dataset("temperature", data=np.array([10, 20, -999], dtype=np.int16))
        packed.attrs.update({"scale_factor": 0.5, "add_offset": 273.0, "_FillValue": np.int16(-999)})
        file["comment"] = "hello"
    columns = read_columns(tmp_path / "log.h5")
    assert sorted(columns) == ["imu/acc", "temperature"]
    np.testing.assert_array_equal(columns["temperature"], [278.0, 283.0, np.nan])


def binaries(tmp_path):
    arrays = {"t": np.arange(4000.0), "x": np.random.default_rng(0).normal(size=(4000, 3))}
    np.savez_compressed(tmp_path / "log.npz", **arrays)
    savemat(tmp_path / "log.mat", arrays, do_compression=True)
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, array in arrays.items():
            file[name] = array


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".h5"])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.4, 0.9, 0.999])
def test_binary_files_cut_short_are_named(suffix, share, tmp_path):
    binaries(tmp_path)
    path = tmp_path / f"log{suffix}"
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(RecordingError, match="cut short") as caught:
        read_columns(path)
    assert path.name in str(caught.value)


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".h5", ".csv.gz"])
def test_a_wrong_suffix_is_named(suffix, tmp_path):
    path = write(tmp_path, "t,x\n0,1\n" * 50, f"log{suffix}")
    with pytest.raises(RecordingError, match=f"log{suffix}"):
        read_columns(path)


def test_pickled_objects_are_not_opened(tmp_path):
    np.savez(tmp_path / "log.npz", t=np.array([{"a": 1}], dtype=object))
    with pytest.raises(RecordingError, match="cannot be read as NPZ"):
        read_columns(tmp_path / "log.npz")


def test_unknown_suffix_and_missing_file_are_named(tmp_path):
    with pytest.raises(RecordingError, match="No reader") as caught:
        read_columns(write(tmp_path, "x", "log.xyz"))
    assert all(suffix in str(caught.value) for suffix in READERS)
    with pytest.raises(RecordingError, match="no file"):
        read_columns(tmp_path / "gone.csv")
