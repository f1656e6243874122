"""`smsid identify` of a welded arm."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
from typer.testing import CliRunner

from smsid.arm import with_joint_effects
from smsid.cli.app import app
from smsid.description import save_description
from smsid.diagnose import load_diagnosis
from smsid.effects import ActuatorDelay, Gear
from smsid.errors import RecordingError
from smsid.identify.estimate import load_estimate
from smsid.recording import Recording, save_recording
from tests.hidden.catalogue import hidden_effects
from tests.hidden.flight import write_run
from tests.screen import fits, shows

from .mujoco_arm import DAMPING, JOINTS, described, motion, recorded


def run(*args):
    done = CliRunner().invoke(app, [str(a) for a in args])
    if done.exit_code == 0:
        fits(done.stdout)
    return done


def test_an_arm_is_identified_and_judged(tmp_path):
    save_description(with_joint_effects(described(), JOINTS, "joint_friction"), tmp_path / "arm.toml")
    for name, seed, role in (("train", 2, "estimation"), ("held", 7, "validation")):
        t, q, _, torque = motion(seed=seed)
        save_recording(recorded(t, q, torque).with_role(role).with_name(name), tmp_path / f"{name}.nc")
    shown = run(
        "identify",
        tmp_path / "arm.toml",
        tmp_path / "train.nc",
        tmp_path / "held.nc",
        "--cutoff",
        20,
        "-o",
        tmp_path / "e.json",
    )
    assert shown.exit_code == 0, shown.output
    assert f"friction_{JOINTS[0]}.viscous" in shows(tmp_path / "e.json")
    estimate = load_estimate(tmp_path / "e.json")
    for joint, value in zip(JOINTS, DAMPING, strict=True):
        found = estimate[f"friction_{joint}.viscous"]
        assert abs(found.value - value) < 4.0 * found.sigma and found.sigma < 0.05 * value
    held = next(line for line in shown.output.splitlines() if "validation" in line)
    assert float(held.split()[2]) < 0.02
    only = run("identify", tmp_path / "arm.toml", tmp_path / "held.nc", "-o", tmp_path / "f.json")
    assert isinstance(only.exception, RecordingError) and not (tmp_path / "f.json").exists()


def test_a_turned_angle_is_named_though_links_found_from_it_fit_well(tmp_path):
    save_description(described(), tmp_path / "arm.toml")
    t, q, _, torque = motion()
    save_recording(recorded(t, q * [1.0, 1.0, -1.0], torque), tmp_path / "log.nc")
    shown = run("identify", tmp_path / "arm.toml", tmp_path / "log.nc", "-o", tmp_path / "e.json")
    assert shown.exit_code == 0, shown.output
    doubts = [line for line in shown.output.splitlines() if line.startswith("doubt:")]
    assert len(doubts) == 1 and "'joint3' fits the description with its angle turned round" in doubts[0]


def test_a_current_of_unknown_gain(tmp_path):
    gears = [Gear(name=f"gear{k}", joint=n, ratio=40.0) for k, n in enumerate(JOINTS)]
    arm = with_joint_effects(described(), JOINTS, "joint_friction").with_effects(*gears)
    save_description(arm, tmp_path / "arm.toml")
    t, q, _, torque = motion()
    current = torque / 40.0 / [0.2, 0.3, 0.4]
    save_recording(recorded(t, 40.0 * q, current, source="motor"), tmp_path / "train.nc")
    shown = run(
        "identify", tmp_path / "arm.toml", tmp_path / "train.nc", "--gains", "--cutoff", 20,
        "-o", tmp_path / "e.json",
    )  # fmt: skip
    assert shown.exit_code == 0, shown.output
    told = [float(line.split()[1]) for line in shown.output.splitlines() if line.startswith("joint")]
    np.testing.assert_allclose(told, [0.2, 0.3, 0.4], rtol=0.01)
    found = load_estimate(tmp_path / "e.json")
    for joint, value in zip(JOINTS, DAMPING, strict=True):
        assert abs(found[f"friction_{joint}.viscous"].value / value - 1.0) < 0.05


def test_cutoff_is_for_arms(tmp_path, urdf):
    t = np.arange(0.0, 1.0, 0.005)
    save_recording(recorded(t, np.zeros((200, 3)), np.zeros((200, 3))), tmp_path / "r.nc")
    shown = run("identify", urdf / "paper_sms.toml", tmp_path / "r.nc", "--cutoff", "5")
    assert "--cutoff is for welded arms" in str(shown.exception)


def test_joints_stand_in_the_table_without_what_their_names_share(tmp_path):
    t, q, _, torque = motion()
    urdf = (described().folder / described().urdf).read_text()
    for given, shared, left in (
        (JOINTS, "", JOINTS),
        (("a_x_joint", "a_y_joint", "a_z_joint"), ", joints 'a_..._joint'", ("x", "y", "z")),
    ):
        text = urdf
        for old, new in zip(JOINTS, given, strict=True):
            text = text.replace(f'"{old}"', f'"{new}"')
        (tmp_path / "arm.urdf").write_text(text)
        channels = {"encoder.joint_position": q, "encoder.joint_torque": torque}
        log = Recording.from_arrays(t, channels, labels={"joint": given}, role="estimation")
        save_recording(log, tmp_path / "named.nc")
        shown = run("identify", tmp_path / "arm.urdf", tmp_path / "named.nc", "-o", tmp_path / "e.json")
        lines = shown.output.splitlines()
        title = next(k for k, line in enumerate(lines) if line.startswith("torques: |predicted"))
        told = " ".join(x.strip() for x in lines[title : title + 2]).rstrip()
        assert told == f"torques: |predicted - measured| / |measured|{shared}"
        assert next(line for line in lines[title:] if "all joints" in line).split()[-3:] == list(left)


def test_a_warning_about_a_file_is_told_once(tmp_path):
    """The command loads the URDF several times; a process of its own, as tests have handlers of theirs."""
    t, q, _, torque = motion()
    save_recording(recorded(t, q, torque), tmp_path / "log.nc")
    text = (described().folder / described().urdf).read_text()
    odd = text.replace("</joint>", '<dynamics damping="1" dampng="2"/></joint>', 1)
    (tmp_path / "arm.urdf").write_text(odd)
    done = subprocess.run(
        [sys.executable, "-m", "smsid", "identify", "arm.urdf", "log.nc", "-o", "e.json"],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stderr.count("dampng") == 1


def test_what_a_diagnosis_names_of_an_arm_is_identified_exported_and_diagnosed_again(tmp_path):
    """A joint that acts 20 ms late: nothing that equations of torques know."""
    rng = np.random.default_rng(5)
    hidden = hidden_effects("arm")["actuator_delay:delay@joint2"].make(0.02, None, rng)
    files = write_run("arm", tmp_path, [1, 79], [hidden], duration=30.0)
    out, extended, found = tmp_path / "d.json", tmp_path / "ext.toml", tmp_path / "e.json"
    how = ("--estimate", files.estimate, "-o", out, "--extended", extended)
    assert run("diagnose", files.description, files.recording, *how).exit_code == 0
    shown = run("identify", extended, files.recording, "-o", found, "--report", tmp_path / "e.html")
    assert shown.exit_code == 0, shown.output
    estimate = load_estimate(found)
    (delay,) = (p for p in estimate.parameters if p.name.endswith(".delay"))
    assert delay.status == "identifiable" and abs(delay.value - 0.02) < 4.0 * delay.sigma < 1e-5
    assert any("does not enter torques linearly" in note for note in estimate.notes)
    exported = run("export", extended, found, "-o", tmp_path / "exported")
    assert exported.exit_code == 0, exported.output
    assert "17 identified combinations to 0.00" in " ".join(exported.output.split())
    held = run("identify", extended, files.recording, files.validation, "-o", tmp_path / "e2.json")
    assert "'arm-validation', in the role validation, took no part" in " ".join(held.output.split())
    again = run("diagnose", extended, files.recording, "--estimate", found, "-o", tmp_path / "d2.json")
    assert again.exit_code == 0, again.output
    assert load_diagnosis(tmp_path / "d2.json").verdict == "adequate"


def test_options_of_one_way_are_none_of_the_other(tmp_path):
    listed = described().with_effects(ActuatorDelay(name="late", actuator=JOINTS[0], delay=0.01))
    save_description(listed, tmp_path / "late.toml")
    save_description(described(), tmp_path / "arm.toml")
    t, q, _, torque = motion()
    save_recording(recorded(t, q, torque), tmp_path / "log.nc")

    def refused(name: str, *options: str) -> str:
        return str(run("identify", tmp_path / name, tmp_path / "log.nc", *options).exception)

    assert "identified by its motion: late does not enter torques" in refused("late.toml", "--cutoff", "5")
    assert "identified by its motion: asked for" in refused("arm.toml", "--method", "filter", "--gains")
    assert "--cad is for maximum likelihood of motion" in refused("arm.toml", "--cad", "0.1")
    assert "--method paper is for free-flying" in refused("arm.toml", "--method", "paper")
    measured = ("--drive", "measured")
    assert "--drive is for maximum likelihood of motion" in refused("arm.toml", *measured)
    assert "--drive measured is for spacecraft" in refused("late.toml", *measured)
    assert "--at-rest is for maximum likelihood of motion" in refused("arm.toml", "--at-rest")
    assert "no commanded torques" in refused("late.toml")
    assert "bare URDF says nothing" in refused(described().urdf, "--method", "filter")
