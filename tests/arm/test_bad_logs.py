"""Logs with something plainly wrong, by command: named, or handled."""

from __future__ import annotations

import re

import numpy as np
import pytest
from typer.testing import CliRunner

from smsid.arm import with_joint_effects
from smsid.cli.app import app
from smsid.description import save_description
from smsid.identify.estimate import load_estimate
from smsid.recording import Recording, save_recording

from .mujoco_arm import DAMPING, JOINTS, described, motion, recorded
from .test_one_joint import axis, log


def identify(*arguments):
    return CliRunner().invoke(app, ["identify", *(str(a) for a in arguments)])


def said(shown) -> str:
    """What a user reads: the output, or the refusal."""
    return shown.output if shown.exit_code == 0 else f"{shown.output} {shown.exception}"


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    save_description(with_joint_effects(described(), JOINTS, "joint_friction"), folder / "arm.toml")
    t, q, _, torque = motion()
    return folder, t, q, torque


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("order", "'joint2' and 'joint3' fit the description with their torques exchanged"),
        ("currents", "torque signal of joint 'joint2' is 0.1 .* of joint 'joint3' is 0.1 "),
        ("current", "torque signal of joint 'joint2' is 0.02"),
        ("degrees", "'joint2' is from .* is it in degrees"),
        ("still", "No joint moves"),
    ],
)
def test_what_is_wrong_with_a_log_is_named(arm, tmp_path, fault, words):
    folder, t, q, torque = arm
    if fault == "order":
        torque = torque[:, [0, 2, 1]]
    if fault == "currents":  # all alike: links a tenth as heavy fit as well
        torque = 0.1 * torque
    if fault == "current":
        torque = torque * [1.0, 0.02, 1.0]
    if fault == "degrees":
        q = q * [1.0, 180.0 / np.pi, 1.0]
    if fault == "still":
        q = 0.0 * q
    save_recording(recorded(t, q, torque), tmp_path / "log.nc")
    shown = identify(folder / "arm.toml", tmp_path / "log.nc", "--cutoff", 20, "-o", tmp_path / "e.json")
    assert re.search(words, " ".join(said(shown).split())), said(shown)


def test_a_wrapped_encoder_is_named(arm, tmp_path):
    folder, t, q, torque = arm
    wrapped = q % (2.0 * np.pi)
    assert np.abs(np.diff(wrapped, axis=0)).max() > 3.0
    save_recording(recorded(t, wrapped, torque), tmp_path / "log.nc")
    shown = identify(folder / "arm.toml", tmp_path / "log.nc", "--cutoff", 20, "-o", tmp_path / "e.json")
    assert shown.exit_code != 0 and "jumps by a whole turn" in said(shown)


def test_a_sliding_joint_in_mm_is_named(tmp_path, rng):
    axis(tmp_path)
    right = log(rng)
    wrong = right.with_channels({"encoder.joint_position": 1000.0 * right["encoder.joint_position"]})
    save_recording(wrong, tmp_path / "log.nc")
    shown = identify(tmp_path / "axis.urdf", tmp_path / "log.nc", "-o", tmp_path / "e.json")
    assert shown.exit_code != 0 and "mm?" in said(shown) and "'slide'" in said(shown)


def test_one_unknown_gain_does_not_stop_the_others(arm, tmp_path, rng):
    """No gear is described; the first joint's signal shows nothing but friction, and takes no part."""
    folder, t, q, torque = arm
    friction = 30.0 * np.gradient(q[:, 0], t) + rng.normal(size=t.size)
    signal = np.column_stack([friction, -4.0 * torque[:, 1], torque[:, 2]])
    save_recording(recorded(t, q, signal), tmp_path / "log.nc")
    shown = identify(
        folder / "arm.toml", tmp_path / "log.nc", "--gain", "joint1", "--gain", "joint2", "--cutoff", 20,
        "-o", tmp_path / "e.json",
    )  # fmt: skip
    assert shown.exit_code == 0, said(shown)
    told = {line.split(":")[0]: line for line in shown.output.splitlines() if line.startswith("joint")}
    assert set(told) == {"joint1", "joint2"}
    assert "gain not told" in told["joint1"]
    assert float(told["joint2"].split()[1]) == pytest.approx(-0.25, rel=0.02)
    judged = next(line for line in shown.output.splitlines() if "all joints" in line)
    assert "joint1" not in judged and "joint2" in judged
    estimate = load_estimate(tmp_path / "e.json")
    viscous = estimate["friction_joint2.viscous"]
    assert viscous.value == pytest.approx(DAMPING[1], rel=0.05)
    assert estimate["friction_joint1.viscous"].status == "not_identifiable"


def test_fingers_nobody_measured_are_named(arm, tmp_path):
    folder, t, q, torque = arm
    channels = {"e.joint_position": q[:, :2], "e.joint_torque": torque[:, :2]}
    save_recording(Recording.from_arrays(t, channels, labels={"joint": JOINTS[:2]}), tmp_path / "log.nc")
    shown = identify(folder / "arm.toml", tmp_path / "log.nc", "-o", tmp_path / "e.json")
    assert shown.exit_code != 0 and "missing 'joint3'" in said(shown)
