"""`smsid lab`."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.datasets import have
from smsid.description import load_description
from smsid.errors import RecordingError
from smsid.identify.estimate import load_estimate
from smsid.recording import Recording, load_recording, save_recording
from tests.screen import fits, shows

from . import test_modal, test_oscillator, test_tank


def run(*args):
    done = CliRunner().invoke(app, ["lab", *map(str, args)])
    if done.exit_code == 0:
        fits(done.stdout)
    return done


def tank_log(path):
    (t1, force), (t2, place) = test_tank.simulated(0.0)
    none = np.zeros_like(force)
    channels = {
        "hand.force": (t1, np.stack([none, force, none], axis=1)),
        "pose.position": (t2, np.stack([place, 0 * place, 0 * place], axis=1)),
    }
    save_recording(Recording.from_arrays(None, channels, name="tank"), path)


def test_a_tank(tmp_path):
    tank_log(tmp_path / "t.nc")
    shown = run(
        "tank", tmp_path / "t.nc", "--force", "hand.force.y", "--position", "pose.position.x",
        "--models", "rigid,slosh", "-o", tmp_path / "e.json",
    )  # fmt: skip
    assert shown.exit_code == 0, shown.output
    assert "tank.slosh_mass" in shows(tmp_path / "e.json")
    found = load_estimate(tmp_path / "e.json")
    assert found["tank.frequency"].value == pytest.approx(test_tank.FREQUENCY, rel=0.01)
    assert found["tank.slosh_mass"].value == pytest.approx(test_tank.MASS, rel=0.05)
    assert "force behind motion by cross-correlation: 0.0" in shown.output and "named" in shown.output


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--force", "hand.force.y"), "motion of the container is not stated"),
        (("--force", "hand.force", "--position", "pose.position.x"), "no axis of a channel"),
        (("--force", "hand.push.y", "--position", "pose.position.x"), "no axis of a channel"),
    ],
)
def test_what_a_tank_test_lacks_is_named(tmp_path, arguments, text):
    tank_log(tmp_path / "t.nc")
    shown = run("tank", tmp_path / "t.nc", *arguments)
    assert isinstance(shown.exception, RecordingError) and text in str(shown.exception)


def test_modes(tmp_path):
    y = test_modal.structure(test_modal.CLOSE[:1], sine=9.0)
    times = np.arange(len(y)) / test_modal.RATE
    save_recording(Recording.from_arrays(times, {"phone.acceleration": y}, name="beam"), tmp_path / "m.nc")
    shown = run("modal", tmp_path / "m.nc", "--highest", 10, "-o", tmp_path / "e.json")
    assert shown.exit_code == 0, shown.output
    assert "mode1.frequency" in shows(tmp_path / "e.json")
    found = load_estimate(tmp_path / "e.json")
    assert found["mode1.frequency"].value == pytest.approx(7.0, rel=0.01) and "mode2.frequency" not in found
    assert "9 Hz is a harmonic of the excitation" in shown.output


def test_an_oscillator_is_judged_on_another_record(tmp_path):
    for seed, name in ((1, "train"), (4, "held")):
        drive = test_oscillator.multisine(seed)
        times = np.arange(test_oscillator.N) / test_oscillator.RATE
        channels = {
            "extra.input": drive(times),
            "extra.output": test_oscillator.TRUTH.simulate(drive(times), test_oscillator.RATE),
        }
        units = {"extra.input": "V", "extra.output": "V"}
        save_recording(
            Recording.from_arrays(times, channels, units=units, name=name), tmp_path / f"{name}.nc"
        )
    shown = run(
        "oscillator", tmp_path / "train.nc", "--frequency", 8, "--damping", 0.1, "--terms", "quadratic,cubic",
        "--validate", tmp_path / "held.nc", "-o", tmp_path / "e.json",
    )  # fmt: skip
    assert shown.exit_code == 0, shown.output
    assert "oscillator.cubic" in shows(tmp_path / "e.json")
    assert load_estimate(tmp_path / "e.json")["oscillator.cubic"].value == pytest.approx(0.4, rel=0.05)
    size = np.std(load_recording(tmp_path / "held.nc")["extra.output"])
    error = float(shown.output.split("free-running error ")[1].split()[0])
    assert error < 0.02 * size


def test_a_data_set_becomes_recordings(tmp_path):
    if not have("silverbox"):
        pytest.skip("SMSID_DATA has no copy of silverbox")
    shown = run("fetch", "silverbox", "-o", tmp_path / "d")
    assert shown.exit_code == 0, shown.output
    assert load_recording(tmp_path / "d" / "silverbox_validation.nc").role == "validation"
    if have("staubli_tx40"):
        shown = run("fetch", "staubli_tx40", "-o", tmp_path / "d")
        assert shown.exit_code == 0, shown.output
        description = load_description(tmp_path / "d" / "tx40.toml")
        assert description.root == "fixed" and description.get_effect("wrist")
        assert load_recording(tmp_path / "d" / "tx40_validation.nc").role == "validation"
    unknown = run("fetch", "silverbux", "-o", tmp_path / "d")
    assert isinstance(unknown.exception, RecordingError) and "silverbox" in str(unknown.exception)
