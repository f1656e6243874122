"""The command line: the main path works, and bad input gives one line that names the place and the mend."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from smsid.recording import load_recording, save_recording

from .test_output import smsid


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the command line in this process, which spares importing everything anew."""
    return subprocess.CompletedProcess([*map(str, arguments)], *smsid(*arguments))


def run_alone(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the command line as a user does, in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", "from smsid.cli import main; main()", *map(str, arguments)],
        capture_output=True,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        timeout=300,
    )


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, urdf: Path) -> Path:
    """A folder with recordings of both experiments, made by the command line."""
    folder = tmp_path_factory.mktemp("flown")
    for name in ("exp1", "exp2"):
        done = run("simulate", urdf / "paper_sms.toml", name, "-o", folder / f"{name}.nc", "--seed", "3")
        assert done.returncode == 0, done.stderr
        assert "momentum drift" in done.stdout
    return folder


def test_help_explains_itself() -> None:
    done = run_alone("--help")
    assert done.returncode == 0
    for command in ("demo", "simulate", "import", "identify", "show", "view"):
        assert command in done.stdout


def test_simulate_then_identify_gives_value_unit_sigma_and_status(flown: Path, urdf: Path) -> None:
    done = run(
        "identify",
        urdf / "paper_sms.toml",
        flown / "exp1.nc",
        flown / "exp2.nc",
        "-o",
        flown / "e.json",
        "--method",
        "paper",
    )
    assert done.returncode == 0, done.stderr
    document = json.loads((flown / "e.json").read_text())
    parameters = {p["name"]: p for p in document["parameters"]}
    assert {"total.mass", "tank.mass", "panel.linear_density", "link3.mx"} <= set(parameters)
    for p in document["parameters"]:
        assert {"name", "value", "unit", "sigma", "status", "interval"} <= set(p)
    mass = parameters["total.mass"]
    assert abs(mass["value"] - 2256.8) < 5 * mass["sigma"]
    shown = run("show", flown / "e.json")
    assert shown.returncode == 0
    assert "tank.mass" in shown.stdout


def test_identify_refines_by_default_and_prints_both_side_by_side(flown: Path, urdf: Path) -> None:
    done = run("identify", urdf / "paper_sms.toml", flown / "exp1.nc", "-o", flown / "ml.json")
    assert done.returncode == 0, done.stderr
    assert "by maximum likelihood" in done.stdout
    document = json.loads((flown / "ml.json").read_text())
    assert document["method"] == "maximum_likelihood"
    damping = next(p for p in document["parameters"] if p["name"] == "tank.damping.x")
    assert damping["status"] == "identifiable"  # the linear method cannot say
    assert abs(damping["value"] - 0.02) < 5 * damping["sigma"]
    fails(run("identify", urdf / "paper_sms.toml", flown / "exp1.nc", "--method", "guess"), "guess")


def test_same_seed_gives_the_same_recording(flown: Path, urdf: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.nc"
    assert run("simulate", urdf / "paper_sms.toml", "exp1", "-o", again, "--seed", "3").returncode == 0
    first, second = load_recording(flown / "exp1.nc"), load_recording(again)
    for channel in first.channels:
        np.testing.assert_array_equal(first[channel], second[channel])


def test_show_describes_recordings_descriptions_and_experiments(
    flown: Path, urdf: Path, tmp_path: Path
) -> None:
    assert "imu.acceleration" in run("show", flown / "exp1.nc").stdout
    assert "bending mode" in run("show", urdf / "two_arm_sms.toml").stdout
    plan = tmp_path / "plan.toml"
    target = tmp_path / "r.nc"
    done = run("simulate", urdf / "paper_sms.toml", "exp1_x", "-o", target, "--save-experiment", plan)
    assert done.returncode == 0, done.stderr
    assert "hold_attitude" in run("show", plan).stdout
    assert run("simulate", urdf / "paper_sms.toml", plan, "-o", target).returncode == 0


def test_import_reads_the_recordings_of_another_engine(oracle: Path, tmp_path: Path) -> None:
    target = tmp_path / "rec.nc"
    done = run("import", oracle / "exp2_modal3.npz", "--map", "oracle_exp2", "-o", target)
    assert done.returncode == 0, done.stderr
    assert "encoder.joint_position" in load_recording(target).channels


def fails(done: subprocess.CompletedProcess[str], *words: str) -> None:
    """One error, no traceback, naming what the words say."""
    assert done.returncode in (1, 2), done.stdout
    assert "Traceback" not in done.stderr
    assert "Traceback" not in done.stdout
    assert done.stderr.startswith("error: "), done.stderr
    for word in words:
        assert word in done.stderr, done.stderr


def test_missing_files_are_named(urdf: Path, tmp_path: Path) -> None:
    fails(run("identify", urdf / "paper_sms.toml", tmp_path / "no.nc"), "no.nc")
    fails(run_alone("simulate", tmp_path / "no.toml", "exp1"), "no.toml")
    fails(run("show", tmp_path / "no.json"), "no.json")


def test_unknown_experiment_and_command_are_told(urdf: Path) -> None:
    fails(run("simulate", urdf / "paper_sms.toml", "exp7"), "exp7", "exp2")
    fails(run_alone("frobnicate"), "frobnicate")


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda text: text.replace("mass = 49.6", "mas = 49.6"), ("mas", "did you mean 'mass'")),
        (lambda text: text.replace('urdf = "paper_sms.urdf"', 'urdf = "gone.urdf"'), ("gone.urdf",)),
        (lambda text: text.replace("mass = 49.6", "mass = -49.6"), ("tank", "mass")),
        (
            lambda text: text + "\n[[arm]]\nname = 'two'\nurdf = 'arm3.urdf'\nmount = {frame = 'nowhere'}\n",
            ("nowhere",),
        ),
        (lambda text: text[: len(text) // 2] + "\n[[", ("TOML",)),
    ],
)
def test_a_bad_description_is_told_with_place_and_mend(urdf: Path, tmp_path: Path, edit, words) -> None:  # type: ignore[no-untyped-def]
    for file in urdf.glob("*.urdf"):
        shutil.copy(file, tmp_path)
    bad = tmp_path / "bad.toml"
    bad.write_text(edit((urdf / "paper_sms.toml").read_text()))
    target = tmp_path / "rec.nc"
    fails(run("simulate", bad, "exp1", "-o", target), *words)
    assert not target.exists()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('<mass value="50"/>', '<mass value="-50"/>', ("link2", "mass")),
        ('ixx="0.05" iyy="16.69"', 'ixx="90.05" iyy="16.69"', ("link2", "inertia")),
        ("</robot>", "", ("XML",)),
        (
            "<geometry><box",
            '<geometry><mesh filename="gone.stl"/></geometry></visual><visual><geometry><box',
            ("gone.stl",),
        ),
    ],
)
def test_a_bad_urdf_is_told_with_place_and_mend(
    urdf: Path, tmp_path: Path, old: str, new: str, words
) -> None:  # type: ignore[no-untyped-def]
    text = (urdf / "paper_sms.urdf").read_text()
    assert old in text
    (tmp_path / "paper_sms.urdf").write_text(text.replace(old, new, 1))
    shutil.copy(urdf / "paper_sms.toml", tmp_path)
    fails(run("show", tmp_path / "paper_sms.toml"), *words)


def spoiled(flown: Path, tmp_path: Path, channel: str, change) -> Path:  # type: ignore[no-untyped-def]
    """Exp. 2 with one channel changed."""
    recording = load_recording(flown / "exp2.nc")
    values = np.array(recording[channel])
    target = tmp_path / "spoiled.nc"
    save_recording(recording.with_channels({channel: change(values)}), target)
    return target


@pytest.mark.parametrize(
    ("channel", "change", "words"),
    [
        ("encoder.joint_position", lambda x: np.rad2deg(x), ("encoder.joint_position", "deg")),
        ("imu.angular_rate", lambda x: np.rad2deg(x), ("imu.angular_rate", "deg")),
        ("encoder.joint_velocity", lambda x: 0.0 * x, ("is stuck at 0",)),
    ],
)
def test_a_bad_recording_is_refused_by_name(
    flown: Path, urdf: Path, tmp_path: Path, channel, change, words
) -> None:  # type: ignore[no-untyped-def]
    target = tmp_path / "e.json"
    done = run("identify", urdf / "paper_sms.toml", spoiled(flown, tmp_path, channel, change), "-o", target)
    fails(done, *words)
    assert not target.exists()


def test_the_papers_method_refuses_a_recording_without_a_channel_it_needs(
    flown: Path, urdf: Path, tmp_path: Path
) -> None:
    recording = load_recording(flown / "exp2.nc")
    save_recording(recording.without("encoder.joint_velocity"), tmp_path / "less.nc")
    words = ("identify", urdf / "paper_sms.toml", tmp_path / "less.nc", "--method", "paper")
    fails(run(*words), "encoder.joint_velocity")


def test_a_file_cut_short_is_refused(flown: Path, urdf: Path, tmp_path: Path) -> None:
    whole = (flown / "exp2.nc").read_bytes()
    short = tmp_path / "short.nc"
    short.write_bytes(whole[: len(whole) // 2])
    fails(run("identify", urdf / "paper_sms.toml", short), "short.nc")


def test_time_going_back_is_refused(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,wx,wy,wz\n0,0,0,0\n0.1,0,0,0\n0.05,0,0,0\n0.2,0,0,0\n")
    (tmp_path / "map.toml").write_text(
        '[time]\ncolumn = "t"\nunit = "s"\n'
        '[channel."imu.angular_rate"]\ncolumns = ["wx", "wy", "wz"]\nunit = "rad/s"\n'
    )
    target = tmp_path / "rec.nc"
    fails(run("import", tmp_path / "log.csv", "--map", tmp_path / "map.toml", "-o", target), "time")
    assert not target.exists()


def test_a_gap_is_refused_with_its_place(tmp_path: Path) -> None:
    rows = "".join(f"{k / 10},0,0,0\n" for k in range(100) if not 40 < k < 60)
    (tmp_path / "log.csv").write_text("t,wx,wy,wz\n" + rows)
    (tmp_path / "map.toml").write_text(
        '[time]\ncolumn = "t"\nunit = "s"\n'
        '[channel."imu.angular_rate"]\ncolumns = ["wx", "wy", "wz"]\nunit = "rad/s"\n'
    )
    target = tmp_path / "rec.nc"
    done = run("import", tmp_path / "log.csv", "--map", tmp_path / "map.toml", "-o", target)
    fails(done, "log.csv", "gap of 2 s from t = 4 s", "window(t0, t1)")
    assert not target.exists()
    done = run("import", tmp_path / "log.csv", "--map", tmp_path / "map.toml", "-o", target, "--unchecked")
    assert done.returncode == 0, done.stderr
    (gap,) = load_recording(target).gaps()
    assert (gap.start, gap.end) == pytest.approx((4.0, 6.0))


def test_only_a_recording_with_thrust_and_one_without_are_both_used(
    flown: Path, urdf: Path, tmp_path: Path
) -> None:
    done = run(
        "identify", urdf / "paper_sms.toml", flown / "exp2.nc", "-o", tmp_path / "e.json", "--method", "paper"
    )
    assert done.returncode == 0, done.stderr
    assert "no Exp. 1 was given" in done.stdout
