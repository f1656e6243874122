"""A draft imports as it stands, whatever the reader, the names and the numbers."""

from __future__ import annotations

import tempfile
import tomllib
from pathlib import Path

import h5py
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from smsid.errors import RecordingError
from smsid.recording import import_recording
from smsid.recording.inspect import inspect_file
from smsid.recording.mapping import parse_mapping

N = 24
WORDS = ("q", "pos_", "joint_position_", "velocity", "quat_", "tau", "gyro_", "acc", "effort", "force_", "x",
         "seq", "angle", "current", "temp", "- arm_1_joint_", 'a "quoted" \\ name', "Größe ",
         "orientation.")  # fmt: skip
ENDINGS = (
    "",
    "x",
    "y",
    "z",
    "w",
    "0",
    "1",
    "2",
    "3",
    "_N",
    "_deg",
    " [deg/s]",
    " [mm]",
    "_rpm",
    " (furlong)",
)
TIMES = ("t", "time [ms]", "stamp", "timestamp", "imu/t", "elapsed_s")
SHAPES = st.sampled_from([(N,), (N, 3), (N, 4), (N, 6), (3, N), (N + 1,), (2, 2, N), (1,)])


def signal(seed, shape, kind):
    values = np.random.default_rng(seed).normal(size=shape)
    if kind == "nan" and values.size > 3:
        values.flat[2] = np.nan
    return {"steady": np.cumsum(np.ones(shape), axis=0), "unit": values / np.abs(values).max()}.get(
        kind, values
    )


columns_of_logs = st.dictionaries(
    st.tuples(st.sampled_from(WORDS), st.sampled_from(ENDINGS)).map("".join),
    st.tuples(st.integers(0, 99), SHAPES, st.sampled_from(["noise", "nan", "steady", "unit"])),
    min_size=1,
    max_size=9,
)
clocks_of_logs = st.lists(st.sampled_from(TIMES), max_size=2, unique=True)


def imports(path: Path) -> None:
    """Import the draft of a log, with all checks, or find nothing in it that can be imported."""
    report = inspect_file(path)
    tree = tomllib.loads(report.mapping)
    if not tree.get("channel"):
        assert "# Commented out: " in report.mapping or "Nothing" in report.mapping
        return
    recording = import_recording(path, parse_mapping(tree))
    assert set(recording.channels) == set(tree["channel"])


def written(folder: Path, suffix: str, arrays: dict[str, np.ndarray]) -> Path:
    path = folder / f"log{suffix}"
    if suffix == ".npz":
        np.savez(path, **{name.replace("/", "_"): values for name, values in arrays.items()})
    elif suffix == ".mat":
        # MATLAB takes no other names; the clocks keep theirs.
        tree = {f"v{k}": {"data": values} for k, values in enumerate(arrays.values())}
        savemat(path, tree | {"t": arrays["t"]} if "t" in arrays else tree)
    elif suffix == ".h5":
        with h5py.File(path, "w") as file:
            for k, (name, values) in enumerate(arrays.items()):
                file[f"group{k % 2}/{name.replace('/', '_').replace('.', '_')}"] = values
    return path


@settings(max_examples=30, deadline=None, derandomize=True)
@given(columns_of_logs, clocks_of_logs, st.sampled_from([".npz", ".mat", ".h5"]))
def test_the_draft_of_arrays_imports(columns, clocks, suffix):
    arrays = {name: signal(*how) for name, how in columns.items()}
    arrays |= {name: 0.01 * np.arange(N) for name in clocks}
    with tempfile.TemporaryDirectory() as folder:
        imports(written(Path(folder), suffix, arrays))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    columns_of_logs, clocks_of_logs, st.sampled_from([(",", "."), (";", ","), ("\t", ".")]), st.integers(0, 3)
)
def test_the_draft_of_a_csv_imports(columns, clocks, dialect, blank):
    delimiter, decimal = dialect
    arrays = {name: signal(seed, (N,), kind) for name, (seed, _, kind) in columns.items()}
    cells = {
        name: [f"{x:.9g}".replace(".", decimal) if blank == 0 or (k + seed) % (blank + 1) == 0 else ""
               for k, x in enumerate(values)]
        for (name, values), seed in zip(arrays.items(), (s % 2 for s, *_ in columns.values()), strict=True)
    }  # fmt: skip
    cells |= {name: [f"{0.01 * k:.9g}".replace(".", decimal) for k in range(N)] for name in clocks}
    quote = lambda name: '"' + name.replace('"', '""') + '"'  # noqa: E731
    lines = [delimiter.join(map(quote, cells)), *map(delimiter.join, zip(*cells.values(), strict=True))]
    if len(cells) == 1:
        lines = [line + delimiter for line in lines]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        try:
            imports(path)
        except RecordingError as error:
            assert "no samples" in str(error)  # every cell blank
