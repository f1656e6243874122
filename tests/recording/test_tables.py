"""Recordings as tables come back as they were; pieces are without gaps."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.errors import RecordingError
from smsid.recording import Recording, complete_pieces, import_recording, load_recording, save_recording
from smsid.recording.mapping import parse_mapping
from smsid.recording.tables import save_table, table_mapping

from .samples import recording


def two_rates() -> Recording:
    slow = recording(101)
    t = np.arange(0.0, 2.0, 0.005)
    return slow.with_channels(
        {"hand.force": (t, np.column_stack([t, t**2, -t])), "extra.temperature": np.arange(101.0)},
        units={"extra.temperature": "K"},
    )


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_comes_back_as_it_was(suffix, tmp_path):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow", reason="needs the extra parquet")
    before = two_rates().with_provenance({"inputs": "held"})
    save_table(before, tmp_path / f"a{suffix}")
    after = import_recording(tmp_path / f"a{suffix}", parse_mapping(tomllib.loads(table_mapping(before))))
    assert set(after.channels) == set(before.channels)
    assert after.labels["joint"] == before.labels["joint"]
    assert after.provenance["inputs"] == "held"
    for name in before.channels:
        np.testing.assert_array_equal(after.time(name), before.time(name))
        np.testing.assert_array_equal(after[name].reshape(before[name].shape), before[name])


def with_holes() -> Recording:
    t = np.delete(np.arange(400) * 0.01, slice(100, 150))
    values = np.sin(t)[:, None] * np.ones(3)
    values[300, 1] = np.nan
    return Recording.from_arrays(t, {"imu.acceleration": values})


def test_pieces_are_complete_and_lose_nothing_else():
    pieces = complete_pieces(with_holes())
    assert [piece.time().size for piece in pieces] == [100, 200, 49]
    for piece in pieces:
        piece.check()


def test_without_a_complete_stretch_it_says_so():
    alone = Recording.from_arrays([0.0, 1.0, 2.0], {"imu.acceleration": np.full((3, 3), np.nan)})
    with pytest.raises(RecordingError, match="No stretch"):
        complete_pieces(alone)


def test_the_commands_cut_resample_and_convert(tmp_path):
    path = tmp_path / "a.nc"
    save_recording(with_holes(), path)
    run = lambda *words: CliRunner().invoke(app, [str(w) for w in words], catch_exceptions=False)  # noqa: E731
    assert run("cut", path, "--pieces", "-o", tmp_path / "p.nc").exit_code == 0
    assert sorted(p.name for p in tmp_path.glob("p_*.nc")) == ["p_1.nc", "p_2.nc", "p_3.nc"]
    assert run("cut", path, "--from", 0.2, "--to", 0.5, "-o", tmp_path / "w.nc").exit_code == 0
    times = load_recording(tmp_path / "w.nc").time()
    assert times[0] == pytest.approx(0.2) and times[-1] == pytest.approx(0.5)
    assert run("cut", path, "--role", "validation", "-o", tmp_path / "v.nc").exit_code == 0
    kept = load_recording(tmp_path / "v.nc")
    assert kept.role == "validation" and kept.channels == load_recording(path).channels
    refused = CliRunner().invoke(app, ["cut", str(path), "--role", "test", "-o", str(tmp_path / "x.nc")])
    assert refused.exit_code == 1 and "no role 'test'" in str(refused.exception)
    assert not (tmp_path / "x.nc").exists()
    assert run("resample", tmp_path / "p_1.nc", "--rate", 20, "-o", tmp_path / "r.nc").exit_code == 0
    assert load_recording(tmp_path / "r.nc").time().size == 20
    assert run("convert", path, "-o", tmp_path / "a.csv").exit_code == 0
    again = import_recording(tmp_path / "a.csv", tmp_path / "a.toml", check=False)
    np.testing.assert_array_equal(again["imu.acceleration"], with_holes()["imu.acceleration"])
