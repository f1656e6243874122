"""Recordings and tracks with bytes flipped are read as they are, or refused; nothing else comes out of it."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.cli.file_kind import kind_of
from smsid.errors import RecordingError, SmsidError
from smsid.recording import Recording, load_recording, save_recording
from smsid.tracking import TrackHistory, load_history, save_history

FLIPS = 150


def recording(path):
    rates = {"imu.angular_rate": np.random.default_rng(1).normal(size=(40, 3))}
    return save_recording(Recording.from_arrays(0.1 * np.arange(40), rates), path)


def track(path):
    n, m = 5, 2
    history = TrackHistory(
        description="d",
        recordings=("r",),
        names=("bus.m", "bus.Izz"),
        units=("kg", "kg m^2"),
        time=np.arange(n, dtype=float),
        own_time=np.arange(n, dtype=float),
        recording=np.zeros(n, dtype=int),
        described=np.ones(m),
        values=np.ones((n, m)),
        sigmas=np.ones((n, m)),
        dofs=("x",),
        position=np.zeros((n, 1)),
        position_sigma=np.ones((n, 1)),
        velocity=np.zeros((n, 1)),
        velocity_sigma=np.ones((n, 1)),
        channels=("imu.angular_rate",),
        fit=np.ones((n, 1)),
        covariance=np.eye(m),
        events=(),
        notes=(),
    )
    return save_history(history, path)


@pytest.mark.parametrize(
    ("make", "load", "kind"), [(recording, load_recording, "recording"), (track, load_history, "track")]
)
def test_flipped_bytes_are_refused_in_our_own_words(make, load, kind, tmp_path):
    whole = make(tmp_path / "whole.nc").read_bytes()
    assert kind_of(tmp_path / "whole.nc") == kind
    rng = np.random.default_rng(7)
    seen: Counter[str] = Counter()
    path = tmp_path / "damaged.nc"
    for _ in range(FLIPS):
        data = bytearray(whole)
        for at in rng.integers(8, len(data), int(rng.choice([1, 20]))):
            data[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        try:
            kind_of(path)
            load(path)
            seen["read"] += 1
        except SmsidError:
            seen["refused"] += 1
    assert seen["refused"] > FLIPS / 10


def test_a_track_that_lacks_something_is_no_whole_track(tmp_path):
    track(tmp_path / "t.nc")
    part = xr.load_dataset(tmp_path / "t.nc", engine="h5netcdf").drop_vars("fit")
    part.to_netcdf(tmp_path / "part.nc", engine="h5netcdf")
    with pytest.raises(RecordingError, match="is no whole track"):
        load_history(tmp_path / "part.nc")


@pytest.mark.parametrize("words", [["cut", "--from", "0.5", "-o", "o.nc"], ["convert", "-o", "o.csv"]])
def test_what_no_sensor_reads_is_not_passed_on_and_missing_samples_are_told(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    t, rates = 0.1 * np.arange(40), np.random.default_rng(1).normal(size=(40, 3))
    line = [words[0], "r.nc", *words[1:]]
    rates[7, 1] = np.inf
    save_recording(Recording.from_arrays(t, {"imu.angular_rate": rates}), "r.nc")
    refused = CliRunner().invoke(app, line)
    assert refused.exit_code and "'imu.angular_rate' is inf at index 7" in str(refused.exception)
    rates[7, 1] = np.nan
    save_recording(Recording.from_arrays(t, {"imu.angular_rate": rates}), "r.nc")
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 0 and "'imu.angular_rate': 1 of 40 samples are missing" in done.output
    t[3] = np.inf
    save_recording(Recording.from_arrays(t, {"imu.angular_rate": rates}), "r.nc")
    assert "inf at index 3" in str(CliRunner().invoke(app, line).exception)
