"""What may be brought to ``smsid diagnose``: a verdict or a reason, no traceback, no nan in any sentence."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.description import Description, load_description
from smsid.experiments import fly, named_experiment
from smsid.model import build_model
from smsid.recording import Recording, save_recording
from smsid.sensing import add_noise
from tests.diagnose import test_small_craft
from tests.diagnose.torque_world import RATE, motion

CODES = {"adequate": 0, "explained": 0, "unexplained": 3, "not_evaluated": 4}

ONE_JOINT = """
<robot name="lever">
  <link name="base"><inertial><mass value="5"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="bar"><inertial><origin xyz="0.5 0 0"/><mass value="4"/>
    <inertia ixx="0.02" iyy="0.35" izz="0.35" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="100" velocity="3"/></joint>
</robot>
"""
LEVER = 'schema = 1\nname = "lever"\nurdf = "lever.urdf"\nroot = "fixed"\ngravity = [0.0, 0.0, -9.81]\n'


@pytest.fixture
def judged(tmp_path, monkeypatch):
    """Save recordings, run the command and return its document; all that was printed is looked through."""
    monkeypatch.chdir(tmp_path)

    def run(toml: str, *recordings: Recording, validate: Recording | None = None, more: tuple[str, ...] = ()):
        names = []
        for k, recording in enumerate(recordings):
            save_recording(recording, f"r{k}.nc")
            names.append(f"r{k}.nc")
        held = []
        if validate is not None:
            save_recording(validate, "held.nc")
            held = ["--validate", "held.nc"]
        shown = CliRunner().invoke(app, ["diagnose", toml, *names, *held, "-o", "d.json", *more])
        assert shown.exception is None or isinstance(shown.exception, SystemExit), shown.exception
        assert "Traceback" not in shown.output
        assert not re.search(r"\b(nan|inf)\b", shown.output, re.IGNORECASE), shown.output
        found = json.loads(Path("d.json").read_text())
        assert shown.exit_code == CODES[found["verdict"]]
        told = [found["sentence"], *found["notes"], found["gain"].get("reason", "")]
        assert found["sentence"] and not any(re.search(r"\b(nan|inf)\b", x) for x in told)
        return found

    return run


def rebuilt(recording: Recording, channels: dict[str, np.ndarray], times: np.ndarray) -> Recording:
    return Recording.from_arrays(times, channels, labels=recording.labels, role="estimation", name="changed")


def toml_of(description: Description) -> str:
    return str(description.folder / "paper_sms.toml")


def test_a_single_channel(judged, description, recording):
    kept = {c: recording[c] for c in recording.channels if c.startswith("command.")}
    kept["encoder.joint_position"] = recording["encoder.joint_position"]
    found = judged(toml_of(description), rebuilt(recording, kept, recording.time()))
    assert found["gain"]["reason"] == "no validation recording was given"
    assert found["verdict"] in ("adequate", "unexplained", "not_evaluated")


def test_a_validation_flight_of_another_craft(judged, description, recording, tmp_path):
    """Its gain is not evaluated, with the reason; the recording itself is judged."""
    (tmp_path / "small.urdf").write_text(test_small_craft.URDF)
    (tmp_path / "small.toml").write_text(test_small_craft.TOML)
    small = build_model(load_description("small.toml"))
    plan = named_experiment("exp2", small).model_copy(update={"duration": 6.0})
    other = fly(small, plan, np.random.default_rng(0)).recording
    found = judged(toml_of(description), recording, validate=other)
    assert found["verdict"] in ("adequate", "explained", "unexplained")
    assert found["gain"]["status"] == "not_evaluated" and "not on" in found["gain"]["reason"]


def test_nothing_in_it(judged, description, recording):
    """Nothing is commanded, nothing moves, nothing is noisy."""
    still = {c: np.zeros_like(recording[c]) for c in recording.channels}
    for c in still:
        if c.endswith(".attitude"):
            still[c][:, 3] = 1.0
    found = judged(toml_of(description), rebuilt(recording, still, recording.time()), more=("--unchecked",))
    assert found["verdict"] == "not_evaluated" and "nothing in 'changed'" in found["sentence"]


def test_a_craft_that_rests(judged, description, recording):
    """Nothing is commanded and nothing moves; all that is read is noise: no cause is made of it."""
    still = {c: np.zeros_like(recording[c]) for c in recording.channels if not c.startswith("truth.")}
    for c in (c for c in still if c.endswith(".attitude")):
        still[c][:, 3] = 1.0
    resting = rebuilt(recording, still, recording.time())
    noisy = add_noise(resting, description.sensor, np.random.default_rng(3))
    found = judged(toml_of(description), noisy, validate=noisy.with_name("held"), more=("--unchecked",))
    assert not found["causes"], found["sentence"]
    assert found["verdict"] in ("adequate", "not_evaluated"), found["sentence"]


@pytest.mark.parametrize("change", ["one sample", "no commands", "no sensors"])
def test_a_validation_flight_that_says_nothing(judged, description, recording, change):
    """The recording is judged; why the gain is not evaluated is said."""
    other = {
        "one sample": lambda r: r.window(0.0, 0.005),
        "no commands": lambda r: r.without(*_named(r, "command.")),
        "no sensors": lambda r: r.without(*_named(r, "", "command.")),
    }[change](recording)
    found = judged(toml_of(description), recording, validate=other, more=("--unchecked",))
    assert found["verdict"] in ("adequate", "explained", "unexplained")
    assert found["gain"]["status"] == "not_evaluated" and "not on" in found["gain"]["reason"]


def test_an_arm_of_one_joint_that_rests(judged, tmp_path):
    """Torques and angles are noise: a reason, and no cause."""
    (tmp_path / "lever.urdf").write_text(ONE_JOINT)
    (tmp_path / "lever.toml").write_text(LEVER)
    rng, t = np.random.default_rng(2), np.arange(0.0, 20.0, 0.01)
    log = Recording.from_arrays(
        t,
        {
            "encoder.joint_position": 1e-5 * rng.standard_normal((len(t), 1)),
            "encoder.joint_torque": -19.6 + 0.05 * rng.standard_normal((len(t), 1)),
        },
        labels={"joint": ("hinge",)},
        role="estimation",
        name="rest",
    )
    found = judged("lever.toml", log, more=("--unchecked",))
    assert not found["causes"], found["sentence"]


def test_an_arm_of_one_joint(judged, tmp_path):
    """From measured torques; a torque of the joint's own is named, or said to be left."""
    (tmp_path / "lever.urdf").write_text(ONE_JOINT)
    (tmp_path / "lever.toml").write_text(LEVER)
    rng = np.random.default_rng(1)
    t, q, v, a = (x if x.ndim == 1 else x[:, :1] for x in motion(20.0, rng))
    torque = (0.35 + 4.0 * 0.25) * a - 4.0 * 9.81 * 0.5 * np.cos(q) + 3.0 * v
    torque = torque + 0.05 * rng.standard_normal(torque.shape)
    log = Recording.from_arrays(
        t,
        {"encoder.joint_position": q, "encoder.joint_torque": torque},
        labels={"joint": ("hinge",)},
        role="estimation",
        name="lever",
    )
    assert len(t) == round(20.0 * RATE)
    found = judged("lever.toml", log)
    (cause,) = found["causes"]
    assert (cause["effect"], cause["location"]) == ("joint_friction", "hinge")
    (value,) = cause["parameters"]
    assert value["name"].endswith(".viscous") and abs(value["value"] - 3.0) < 0.1


def test_a_short_log_of_one_joint(judged, tmp_path):
    (tmp_path / "lever.urdf").write_text(ONE_JOINT)
    (tmp_path / "lever.toml").write_text(LEVER)
    t = np.arange(0.0, 1.0, 0.01)
    log = Recording.from_arrays(
        t,
        {"encoder.joint_position": np.zeros((100, 1)), "encoder.joint_torque": np.zeros((100, 1))},
        labels={"joint": ("hinge",)},
        role="estimation",
        name="short",
    )
    assert judged("lever.toml", log, more=("--unchecked",))["verdict"] == "not_evaluated"


def _flown_at(hertz: float, seconds: float) -> Recording:
    """Fly a small craft, described in ``small.toml``, whose sensors and commands have so many samples."""
    stated = f'preset = "reference"\nrate = {hertz}\n'
    Path("small.urdf").write_text(test_small_craft.URDF)
    Path("small.toml").write_text(test_small_craft.TOML.replace('preset = "reference"\n', stated))
    small = build_model(load_description("small.toml"))
    plan = named_experiment("exp2", small).model_copy(update={"duration": seconds})
    flown = fly(small, plan, np.random.default_rng(0)).recording
    assert np.median(np.diff(flown.time("imu.angular_rate"))) == pytest.approx(1.0 / hertz)
    return flown


def test_fast_data(judged):
    """Of 1 kHz: nothing is hidden, and that is said."""
    found = judged("small.toml", _flown_at(1000.0, 6.0))
    assert found["verdict"] == "adequate" and not found["causes"], found["sentence"]
    assert all(0.5 < x["value"] < 2.0 for x in found["whitened_rms"].values())


@pytest.mark.slow
def test_slow_data(judged):
    """Of 1 Hz, between whose samples commands are not known: a verdict or a reason."""
    judged("small.toml", _flown_at(1.0, 110.0))


def test_too_few_slow_samples(judged):
    found = judged("small.toml", _flown_at(1.0, 60.0))
    assert found["verdict"] == "not_evaluated" and "needs 100" in found["sentence"]


@pytest.mark.parametrize("hertz", [1000.0, 1.0])
def test_fast_and_slow_torques(judged, tmp_path, hertz):
    """What is hidden is named at 1 kHz; at 1 Hz there is nothing to differentiate, and a reason."""
    (tmp_path / "lever.urdf").write_text(ONE_JOINT)
    (tmp_path / "lever.toml").write_text(LEVER)
    t = np.arange(0.0, 12.0 if hertz > 1.0 else 150.0, 1.0 / hertz)
    rng = np.random.default_rng(1)
    omega = 2.0 * np.pi * np.array([0.21, 0.5, 0.83])
    q = (0.3 * np.sin(omega * t[:, None])).sum(axis=1)
    v = (0.3 * omega * np.cos(omega * t[:, None])).sum(axis=1)
    a = -(0.3 * omega**2 * np.sin(omega * t[:, None])).sum(axis=1)
    torque = (0.35 + 4.0 * 0.25) * a - 4.0 * 9.81 * 0.5 * np.cos(q) + 3.0 * v
    torque = torque + 0.05 * rng.standard_normal(torque.shape)
    log = Recording.from_arrays(
        t,
        {"encoder.joint_position": q[:, None], "encoder.joint_torque": torque[:, None]},
        labels={"joint": ("hinge",)},
        role="estimation",
        name="lever",
    )
    found = judged("lever.toml", log)
    if hertz > 1.0:
        (cause,) = found["causes"]
        assert (cause["effect"], cause["shape"]) == ("joint_friction", "viscous"), found["sentence"]
    else:
        assert not found["causes"], found["sentence"]


BAD = {
    "nothing is commanded": (lambda r: r.without(*_named(r, "command.")), "command"),
    "nothing is measured": (lambda r: r.without(*_named(r, "", "command.")), "sensors"),
    "a few samples": (lambda r: r.window(0.0, 0.5), "samples"),
}


def _named(recording: Recording, start: str, but: str = "\0") -> list[str]:
    return [c for c in recording.channels if c.startswith(start) and not c.startswith(but)]


@pytest.mark.parametrize("what", BAD)
def test_what_cannot_be_judged_says_why(judged, description, recording, what):
    change, why = BAD[what]
    found = judged(toml_of(description), change(recording), more=("--unchecked",))
    assert found["verdict"] == "not_evaluated" and why in found["sentence"]
    assert found["gain"]["status"] == "not_evaluated" and not found["causes"]
