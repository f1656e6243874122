"""What ``inspect FILE --map`` writes, ``import FILE --map`` takes, whatever the reader and the file."""

from __future__ import annotations

import gzip
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.recording.readers import READERS

from .test_draft import N, columns_of_logs, imports, signal, written
from .test_public_formats import FORMATS, bag, imu, joints, odometry, temperature, vector, wrench
from .test_ready_maps import ulog

ONCE = settings(max_examples=10, deadline=None, derandomize=True)
FIELDS = ("q", "xyz", "vel", "current", "temperature", "pos", "count", "timestamp_sample")
COVERED = {".csv", ".npz", ".mat", ".h5"}  # by test_draft
HERE = {
    ".csv.gz",
    ".tsv",
    ".txt",
    ".dat",
    ".asc",
    ".log",
    ".hdf5",
    ".nc",
    ".parquet",
    ".bag",
    ".db3",
    ".mcap",
    ".ulg",
}


def twist(make, k):
    return {"twist": make["Twist"](linear=vector(make, (k, 0, 0)), angular=vector(make, (0, 0.1 * k, 0)))}


KINDS = {"sensor_msgs/msg/JointState": joints, "sensor_msgs/msg/Imu": imu, "nav_msgs/msg/Odometry": odometry,
         "geometry_msgs/msg/WrenchStamped": wrench, "sensor_msgs/msg/Temperature": temperature,
         "geometry_msgs/msg/TwistStamped": twist}  # fmt: skip


def test_every_reader_is_tried():
    assert set(READERS) == COVERED | HERE


@ONCE
@given(st.sampled_from(sorted(KINDS)), st.sampled_from(["/a", "/joint_states", "/arm/q", "/time"]),
       st.sampled_from([(1, "SQLITE3"), (2, "SQLITE3"), (2, "MCAP")]))  # fmt: skip
def test_the_draft_of_a_bag_imports(kind, topic, form):
    pytest.importorskip("rosbags", reason="needs the extra bags")
    with tempfile.TemporaryDirectory() as folder:
        path = bag(kind, topic, KINDS[kind], *form)(Path(folder))
        imports(path)
        for file in Path(folder).glob("log/*.mcap"):
            imports(file)
        for file in Path(folder).glob("log/*.db3"):
            imports(file)


@ONCE
@given(columns_of_logs, st.sampled_from([".hdf5", ".nc", ".parquet"]))
def test_the_draft_of_further_arrays_imports(columns, suffix):
    arrays = {name: signal(*how) for name, how in columns.items()} | {"t": 0.01 * np.arange(N)}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"log{suffix}"
        if suffix == ".parquet":
            pa = pytest.importorskip("pyarrow", reason="needs the extra parquet")
            plain = {k: list(v) for k, v in arrays.items() if v.shape[0] == N and v.ndim < 3}
            pytest.importorskip("pyarrow.parquet").write_table(pa.table(plain), path)
        else:
            written(Path(folder), ".h5", arrays).rename(path)
        imports(path)


@ONCE
@given(
    columns_of_logs,
    st.sampled_from(
        [(".tsv", "\t"), (".txt", " "), (".csv.gz", ","), (".dat", " "), (".asc", ";"), (".log", ",")]
    ),
)
def test_the_draft_of_further_text_imports(columns, form):
    suffix, delimiter = form
    arrays = {name: signal(seed, (N,), kind) for name, (seed, _, kind) in columns.items()}
    arrays = {"t": 0.01 * np.arange(N), **arrays}
    names = [
        name if delimiter != " " else "".join(c for c in name if c.isalnum() or c == "_") for name in arrays
    ]
    quoted = ['"' + n.replace('"', '""') + '"' if delimiter != " " else n for n in names]
    assume(len(set(names)) == len(names))
    rows = [delimiter.join(f"{x:.9g}" for x in row) for row in np.column_stack(list(arrays.values()))]
    text = "\n".join([delimiter.join(quoted), *rows]) + "\n"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"log{suffix}"
        path.write_bytes(gzip.compress(text.encode()) if suffix.endswith("gz") else text.encode())
        imports(path)


@ONCE
@given(st.dictionaries(st.sampled_from(FIELDS), st.integers(1, 4), min_size=1, max_size=4),
       st.sampled_from(["vehicle_attitude", "battery_status", "actuator_outputs"]))  # fmt: skip
def test_the_draft_of_a_ulog_imports(fields, topic):
    pytest.importorskip("pyulog", reason="needs the extra px4")
    times = np.arange(1_500_000, 1_500_000 + N * 5_000, 5_000)
    rng = np.random.default_rng(len(fields))
    rows = [(name, "float", n, rng.normal(size=(N, n) if n > 1 else N)) for name, n in fields.items()]
    with tempfile.TemporaryDirectory() as folder:
        imports(ulog(Path(folder) / "log.ulg", {topic: (times, rows)}))


@pytest.mark.parametrize(
    "kind", ["MAT of a structure", "HDF5 of two clocks", "JointState, ROS 2", "PoseStamped"]
)
def test_the_commands_agree(kind, tmp_path):
    path = FORMATS[kind][0](tmp_path)
    for line in (["inspect", str(path), "--map", str(tmp_path / "map.toml")],
                 ["import", str(path), "--map", str(tmp_path / "map.toml"), "-o", str(tmp_path / "x.nc")],
                 ["show", str(tmp_path / "x.nc")]):  # fmt: skip
        shown = CliRunner().invoke(app, line)
        assert shown.exit_code == 0, shown.output
