"""The command: from a description and recordings to a history, a saved tracker and a report."""

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import smsid
from smsid.cli.app import app
from smsid.cli.track import rates_of
from smsid.description import load_description, save_description
from smsid.errors import RecordingError, SmsidError
from smsid.recording import load_recording, save_recording
from smsid.tracking import load_history, load_tracker, save_history
from tests.screen import fits, shows

from .craft import INERTIA, craft, flight, true_inertia


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("track")
    save_description(craft(found), found / "craft.toml")
    for k, name in enumerate(("first", "second")):
        save_recording(flight(6.0, seed=k, name=name), found / f"{name}.nc")
    return found


def test_a_history_a_tracker_and_a_report_are_written(folder):
    paths = [str(folder / f) for f in ("craft.toml", "first.nc", "second.nc")]
    files = {"-o": "track.nc", "--save": "state.npz", "--report": "track.html"}
    more = [x for k, v in files.items() for x in (k, str(folder / v))]
    options = ["--follow", "bus.I*=0.001", "--gap", "50", "--warm-up", "0", "--json"]
    run = CliRunner().invoke(app, ["track", *paths, *more, *options], catch_exceptions=False)
    assert run.exit_code == 0
    history = xr.load_dataset(folder / "track.nc", engine="h5netcdf")
    assert list(history.parameter.values) == INERTIA
    assert (np.diff(history.time) > 0.0).all()
    assert history.time[-1] - history.time[0] == pytest.approx(62.0, abs=0.2)
    last = history.isel(time=-1)
    off = np.abs(last.value.values - true_inertia()) / last.sigma.values
    assert off.max() < 6.0
    assert "bus.Izz" in (folder / "track.html").read_text(encoding="utf-8")
    restored = load_tracker(folder / "state.npz", load_description(folder / "craft.toml"))
    np.testing.assert_array_equal(restored.filter.values, last.value.values)


def test_what_is_written_is_read_back_and_shown(folder):
    paths = [str(folder / f) for f in ("craft.toml", "first.nc")]
    out = str(folder / "one.nc")
    run = CliRunner().invoke(app, ["track", *paths, "-o", out, "--warm-up", "0", "--changes"])
    assert run.exit_code == 0, run.output
    fits(run.stdout)
    assert "bus.Izz" in shows(folder / "one.nc")
    history = load_history(out)
    again = folder / "again.nc"
    save_history(history, again)
    assert xr.load_dataset(again, engine="h5netcdf").identical(xr.load_dataset(out, engine="h5netcdf"))
    estimate = history.estimate()
    assert estimate.names == history.names and estimate.covariance is not None
    np.testing.assert_array_equal(estimate.values, history.values[-1])
    craft_, recording = load_description(folder / "craft.toml"), load_recording(folder / "first.nc")
    direct = smsid.track(craft_, recording, changes=True)
    assert direct.names == history.names and len(repr(direct).splitlines()) <= 30
    with pytest.raises(RecordingError, match=r"first\.nc' is no track"):
        load_history(folder / "first.nc")


def test_rates_are_read_and_refused():
    assert rates_of(["tank.*=0.5", "bus.m"]) == {"tank.*": 0.5, "bus.m": None}
    with pytest.raises(SmsidError, match="'fast' is no number"):
        rates_of(["bus.m=fast"])
