"""Diagnoses of a tank and of an oscillator, from other integrators' output."""

from __future__ import annotations

import json

import numpy as np
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.lab import Oscillator, compare_tank_models, tank_test
from smsid.lab.oscillator_diagnosis import diagnose_oscillator
from smsid.lab.tank_models import tank_diagnosis

from . import test_command, test_tank
from .test_oscillator import RATE, N, multisine, output

LINEAR = Oscillator(frequency=8.0, damping=0.1, gain=1.2)
START = Oscillator(frequency=7.8, damping=0.08, gain=1.0)


def told(truth: Oscillator, noise: float, validate: bool = False):
    drive, other = multisine(1), multisine(5)
    u, w = (d(np.arange(N) / RATE) for d in (drive, other))
    rng = np.random.default_rng(2)
    y = output(truth, drive) + noise * rng.normal(size=N)
    held = ("held", w, output(truth, other) + noise * rng.normal(size=N)) if validate else None
    return diagnose_oscillator(u, y, RATE, START, pieces=2, validation=held)


def test_a_linear_oscillator_is_adequate():
    found = told(LINEAR, 0.004).diagnosis
    assert found.verdict == "adequate" and found.causes == (), found.sentence


def test_a_hardening_spring_is_named_with_its_strength():
    truth = Oscillator(frequency=8.0, damping=0.1, gain=1.2, cubic=0.8)
    found = told(truth, 0.004, validate=True)
    first = found.diagnosis.causes[0]
    assert (first.effect, first.family, first.shape) == ("oscillator", "spring", "hardening spring")
    assert [c.shape for c in found.diagnosis.causes] == ["hardening spring"]
    assert abs(first.parameters[0].value - 0.8) < max(4.0 * first.parameters[0].sigma, 0.04)
    gain = found.diagnosis.gain
    assert gain is not None and gain.channels[0].extended < 0.5 * gain.channels[0].given


def test_slosh_and_lag_are_named_from_the_rigid_container():
    test = tank_test(*test_tank.simulated(0.0))
    found = tank_diagnosis(test, compare_tank_models(test, ("rigid", "slosh")), "tank")
    assert [(c.effect, c.shape) for c in found.causes] == [("slosh", "slosh mass"), ("sensor_delay", "delay")]
    values = {p.name: p for c in found.causes for p in c.parameters}
    for name, truth in (("slosh_mass", test_tank.MASS), ("lag", test_tank.LAG)):
        p = values[f"tank.{name}"]
        assert abs(p.value - truth) < max(4.0 * p.sigma, 0.003 * truth)


def test_the_command_writes_a_diagnosis(tmp_path):
    test_command.tank_log(tmp_path / "t.nc")
    args = ["lab", "tank", str(tmp_path / "t.nc"), "--force", "hand.force.y", "--position", "pose.position.x"]
    args += [
        "--models",
        "rigid,slosh",
        "--diagnose",
        str(tmp_path / "d.json"),
        "-o",
        str(tmp_path / "e.json"),
    ]
    shown = CliRunner().invoke(app, args)
    assert shown.exit_code == 0, shown.output
    document = json.loads((tmp_path / "d.json").read_text())
    assert document["kind"] == "diagnosis" and document["causes"][0]["effect"] == "slosh"
