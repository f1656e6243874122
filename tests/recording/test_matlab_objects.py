"""Objects of MATLAB files (timeseries, Simulink's datasets), in the bytes that MATLAB writes of them."""

from __future__ import annotations

import struct

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from smsid.errors import RecordingError
from smsid.recording import read_columns


def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def matrix(class_number, *parts):
    return element(14, element(6, struct.pack("<II", class_number, 0)) + b"".join(parts))


def object_element(name, kind):
    """An object of MATLAB's own classes: name, system, class and a reference into what is not public."""
    reference = np.array([0xDD000000, 2, 1, 1, 1, 1], dtype="<u4")
    dims = element(5, struct.pack("<ii", 6, 1))
    inner = matrix(13, dims, element(1, b""), element(6, reference.tobytes()))
    return matrix(17, *(element(1, x.encode()) for x in (name, "MCOS", kind)), inner)


def version_5(path, objects, arrays):
    savemat(path, arrays)
    with path.open("ab") as stream:
        for name, kind in objects.items():
            stream.write(object_element(name, kind))


def version_7_3(path, objects, arrays):
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in arrays.items():
            file[name] = np.atleast_2d(values)
        for name, kind in objects.items():
            file[name] = np.array([[0xDD000000, 2, 1, 1, 1, 1]], dtype=np.uint32)
            file[name].attrs["MATLAB_class"] = np.bytes_(kind)
            file[name].attrs["MATLAB_object_decode"] = np.int32(3)
        file["#subsystem#/MCOS"] = np.zeros((1, 4), dtype=np.uint32)
    with path.open("rb+") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, made for a test".ljust(124) + b"\x00\x02IM")


@pytest.mark.parametrize("write", [version_5, version_7_3])
@pytest.mark.parametrize(
    ("kind", "line"),
    [
        ("timeseries", "struct('time', ts.Time, 'data', ts.Data); save('log.mat', 'log', '-v7')"),
        ("timetable", "seconds(ts.Properties.RowTimes)"),
        ("Simulink.SimulationData.Dataset", "ts.getElement(k)"),
        ("my.Log", "struct('time', t, 'data', x)"),
    ],
)
def test_an_object_alone_is_refused_with_the_line_that_writes_it(write, kind, line, tmp_path):
    write(tmp_path / "log.mat", {"ts": kind}, {})
    with pytest.raises(RecordingError) as caught:
        read_columns(tmp_path / "log.mat")
    assert f"'ts' ({kind})" in caught.value.message and line in caught.value.advice


@pytest.mark.parametrize("write", [version_5, version_7_3])
def test_objects_beside_arrays_are_named_and_left_out(write, tmp_path, caplog):
    t = np.arange(5.0)
    write(tmp_path / "log.mat", {"ts": "timeseries"}, {"t": t, "q": 2 * t})
    columns = read_columns(tmp_path / "log.mat")
    assert sorted(columns) == ["q", "t"]
    np.testing.assert_allclose(columns["q"], 2 * t)
    assert "'ts' (timeseries)" in caplog.text and "ts.Data" in caplog.text
