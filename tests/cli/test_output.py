"""What commands print can be read, and every command takes what the others write, by default options."""

from __future__ import annotations

import json
import logging
import re
import shutil
import sys
from collections.abc import Callable
from importlib import import_module
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from smsid.cli.app import main
from smsid.cli.file_kind import SHOWN, kind_of
from smsid.cli.output import WIDTH, clip_line, note_lines
from smsid.cli.tables import plain_text, report_table
from smsid.description.robots import robot_urdf
from smsid.errors import SmsidError
from smsid.identify.estimate import load_estimate
from smsid.recording import load_recording, save_recording
from smsid.report.model import Table, cells
from tests.screen import COLUMNS, fits

URDF = Path(__file__).parents[2] / "urdf"
SHORT = {"exp1": 70.0, "exp2": 30.0}  # [s]

Called = tuple[int, str, str]


def smsid(*words: str | Path) -> Called:
    """Run the command line in this process: exit code, stdout and stderr."""
    out, err, root = StringIO(), StringIO(), logging.getLogger()
    before = sys.argv, sys.stdout, sys.stderr, root.handlers[:], root.level
    sys.argv, sys.stdout, sys.stderr = ["smsid", *map(str, words)], out, err
    root.handlers = []
    try:
        main()
        code = 0
    except SystemExit as left:
        code = int(left.code or 0)
    finally:
        sys.argv, sys.stdout, sys.stderr, root.handlers, root.level = before
    return code, out.getvalue(), err.getvalue()


def panda(folder: Path) -> None:
    try:
        robot_urdf("panda")
    except SmsidError as error:
        pytest.skip(str(error))
    shutil.copy(URDF / "bus.urdf", folder)
    whole = (URDF / "paper_sms.toml").read_text()
    (folder / "craft.toml").write_text(
        'schema = 1\nname = "panda_sms"\nurdf = "bus.urdf"\n'
        '[[arm]]\nname = "panda"\nrobot = "panda"\nmount = { frame = "left_base" }\n'
        'fixed = ["panda_finger_joint1", "panda_finger_joint2"]\n'
        "home = { panda_joint2 = -0.5, panda_joint4 = -1.5, panda_joint6 = 1.0 }\n"
        "[thrust]\npoint = [0.0, 0.0, 0.0]\nmax_force = 40.0\n" + whole[whole.index("[[wheel]]") :]
    )


def paper(folder: Path) -> None:
    for name in ("paper_sms.urdf", "paper_sms.toml"):
        shutil.copy(URDF / name, folder)
    (folder / "paper_sms.toml").rename(folder / "craft.toml")


@pytest.fixture(
    scope="module", params=[paper, pytest.param(panda, marks=pytest.mark.slow)], ids=["paper", "panda"]
)
def flown(request, tmp_path_factory) -> tuple[Path, dict[str, Called]]:
    """A folder with what the commands write of a craft, and what they printed."""
    folder = tmp_path_factory.mktemp("made")
    request.param(folder)
    said: dict[str, Called] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for name, seconds in SHORT.items():
            said[name] = smsid(
                "simulate", "craft.toml", name, "-o", f"{name}.nc", "--save-experiment", "x.toml"
            )
            whole = load_recording(f"{name}.nc")
            save_recording(whole.window(0.0, seconds), f"{name}.nc")
        said["identify"] = smsid("identify", "craft.toml", "exp1.nc", "exp2.nc", "-o", "e.json")
        said["short"] = smsid("cut", "exp2.nc", "--to", "8", "-o", "short.nc")
        said["diagnose"] = smsid("diagnose", "craft.toml", "short.nc", "--estimate", "e.json", "-o", "d.json")
        stated = ["control", "craft.toml", "--uncertainty", "0.05", "--samples", "50"]
        said["control"] = smsid(*stated, "-o", "c.json")
        said["inspect"] = smsid("inspect", "exp2.nc")
        said["draft"] = smsid("inspect", "exp2.nc", "--map", "map.toml")
        said["export"] = smsid("export", "craft.toml", "e.json", "-o", "there")
        said["linear"] = smsid("export", "craft.toml", "e.json", "--linear", "plant.json")
        said["check"] = smsid("check", "craft.toml")
        said["regressor"] = smsid("regressor", "craft.toml", "--states", "5")
        said["compare"] = smsid("compare", "e.json", "e.json")
        said["cut"] = smsid("cut", "exp2.nc", "--from", "2", "--to", "4")
        said["resample"] = smsid("resample", "cut.nc", "--rate", "10")
        said["convert"] = smsid("convert", "cut.nc", "-o", "cut.csv")
        followed = ["--estimate", "e.json", "--follow", "tank.mass", "--changes"]
        said["track"] = smsid("track", "craft.toml", "resampled.nc", *followed)
    return folder, said


MADE = (
    *("exp1", "exp2", "identify", "diagnose", "control", "inspect", "draft", "export", "linear", "check"),
    *("regressor", "compare", "cut", "resample", "convert", "track"),
)


@pytest.mark.parametrize("name", MADE)
def test_output_fits_a_screen(flown, name):
    code, out, err = flown[1][name]
    assert code in ((0, 3) if name == "diagnose" else (0,)), err
    fits(out)


FILES = {
    "exp2.nc": ("recording", "encoder.joint_position"),
    "e.json": ("estimate", "total.mass"),
    "d.json": ("diagnosis", "standard deviations of the nominal parameters"),
    "c.json": ("controller", "Poles of the loop"),
    "craft.toml": ("description", "slosh mass"),
    "x.toml": ("experiment", "duration"),
    "map.toml": ("mapping", "imu.acceleration"),
    "comparison.json": ("comparison", "No change beyond chance"),
    "plant.json": ("linear_plant", "oscillates at"),
    "track.nc": ("track", "tank.mass"),
}


@pytest.mark.parametrize("name", FILES)
def test_show_shows_what_the_others_wrote(flown, name, monkeypatch):
    monkeypatch.chdir(flown[0])
    kind, told_of = FILES[name]
    code, out, err = smsid("show", name)
    assert code == 0, err
    fits(out)
    assert told_of in out
    found = json.loads(smsid("show", name, "--json")[1])
    assert found["kind"] == kind and found[kind]


def test_the_default_methods_parameters_are_shown(flown, monkeypatch):
    """All of those asked for, or how many more; with --all every one by its full name."""
    monkeypatch.chdir(flown[0])
    estimate = load_estimate("e.json")
    for name in ("total.mass", "tank.mass", "tank.stiffness.x", "panel.mode1.frequency"):
        assert f"{estimate[name].value:.6g}" in smsid("show", "e.json")[1]
    everything = "".join(smsid("show", "e.json", "--all")[1].split())
    for p in estimate.parameters:
        assert f"{p.value:.6g}" in everything
    assert estimate.covariance is not None and len(estimate.covariance) == len(estimate)


def calls() -> dict[str, Callable[[str], list[str]]]:
    return {
        "view": lambda f: ["view", "craft.toml", f, "-o", "v.html"],
        "identify": lambda f: ["identify", "craft.toml", f, "-o", "out.json"],
        "diagnose": lambda f: ["diagnose", "craft.toml", f, "-o", "out.json"],
        "simulate": lambda f: ["simulate", "craft.toml", f, "-o", "out.nc"],
        "control": lambda f: ["control", "craft.toml", f, "-o", "out.json"],
        "export": lambda f: ["export", "craft.toml", f, "-o", "out"],
        "inspect": lambda f: ["inspect", f],
        "check": lambda f: ["check", f],
        "regressor": lambda f: ["regressor", f, "--states", "2"],
        "compare": lambda f: ["compare", "e.json", f, "-o", "again.json"],
        "track": lambda f: ["track", "craft.toml", f, "-o", "out.nc"],
        "cut": lambda f: ["cut", f, "--to", "3", "-o", "out.nc"],
        "resample": lambda f: ["resample", f, "--rate", "10", "-o", "out.nc"],
        "convert": lambda f: ["convert", f, "-o", "out.csv"],
        "design": lambda f: ["design", f, "--for", "mass", "-o", "out.toml"],
        "import": lambda f: ["import", "cut.csv", "--map", f, "-o", "out.nc"],
        "plot recording": lambda f: ["plot", "recording", f, "-o", "p.png"],
        "plot estimate": lambda f: ["plot", "estimate", f, "-o", "p.png"],
        "plot diagnosis": lambda f: ["plot", "diagnosis", f, "-o", "p.png"],
    }


TAKES = {
    "view": {"exp2.nc", "track.nc"},
    "inspect": {"exp2.nc", "track.nc"},
    "check": {"craft.toml"},
    "regressor": {"craft.toml"},
    "compare": {"e.json"},
    "track": {"exp2.nc"},
    "cut": {"exp2.nc"},
    "resample": {"exp2.nc"},
    "convert": {"exp2.nc"},
    "design": {"craft.toml"},
    "import": {"map.toml"},
    "export": {"e.json"},
    "plot recording": {"exp2.nc"},
    "plot estimate": {"e.json"},
    "plot diagnosis": {"d.json"},
    "identify": {"exp2.nc"},
    "diagnose": {"exp2.nc"},
    "simulate": {"x.toml"},
    "control": {"e.json"},
}
HEAVY = {
    "identify",
    "diagnose",
    "simulate",
    "control",
    "track",
    "design",
    "regressor",
    "import",
}  # made by the fixture
EXTRAS = {
    "view": "meshcat",
    "plot recording": "matplotlib",
    "plot estimate": "matplotlib",
    "plot diagnosis": "matplotlib",
}


@pytest.mark.parametrize("command", TAKES)
def test_every_command_takes_what_is_meant_for_it_and_refuses_the_rest_in_a_line(flown, command, monkeypatch):
    monkeypatch.chdir(flown[0])
    if command in EXTRAS:
        pytest.importorskip(EXTRAS[command])
    for name in FILES:
        right = name in TAKES[command]
        if right and command in HEAVY:
            continue
        code, out, err = smsid(*calls()[command](name))
        if right:
            assert code == 0, err
            fits(out)
        else:
            assert code == 1 and out == "", (command, name, err)
            assert re.search("^error: ", err, re.MULTILINE) and "fault of smsid" not in err and name in err


@pytest.mark.parametrize(
    "words",
    [
        ("show", "e.json"),
        ("inspect", "exp2.nc"),
        ("export", "craft.toml", "-o", "q"),
        ("check", "craft.toml"),
        ("compare", "e.json", "e.json", "-o", "quiet.json"),
        ("cut", "cut.nc", "--to", "3", "-o", "quiet.nc"),
        ("resample", "cut.nc", "--rate", "5", "-o", "quiet_5.nc"),
        ("convert", "cut.nc", "-o", "quiet.csv"),
        ("new", "another"),
        (
            "track",
            "craft.toml",
            "resampled.nc",
            "--estimate",
            "e.json",
            "--follow",
            "tank.mass",
            "-o",
            "quiet_t.nc",
        ),
    ],
)
def test_quiet_is_quiet(flown, words, monkeypatch):
    monkeypatch.chdir(flown[0])
    assert smsid(*words, "-q") == (0, "", "")


def test_every_kind_of_file_has_something_that_shows_it():
    for target in (target for targets in SHOWN.values() for target in targets):
        module, _, name = target.partition(":")
        assert callable(getattr(import_module(module), name)), target


def test_what_is_a_page_or_a_log_is_told(tmp_path):
    for name, message in (
        ("a.html", "a page for a browser"),
        ("a.csv", "smsid inspect"),
        ("a.zip", "nothing"),
    ):
        (tmp_path / name).write_text("x")
        with pytest.raises(Exception, match=message):
            kind_of(tmp_path / name)


def test_notes_of_one_kind_are_one_line():
    notes = [f"exp{k}: noise of imu.rate{n} as its residuals show it: 0.1" for k in (1, 2) for n in range(9)]
    sets = [f"only in combination: link{k}.m, bus.m (changing link{k}.m by +1 kg)" for k in range(9)]
    lines = note_lines([*notes, *sets, "something else", "something else"])
    assert len(lines) == 3 and max(map(len, lines)) <= COLUMNS
    assert "18 channels of exp1, exp2" in lines[0] and "9 sets" in lines[1] and "link1.m" in lines[1]
    assert lines[2] == "note: something else"
    assert len(note_lines([*notes, *sets], everything=True)) == 27
    both = [f"'exp{k}' contradicts the other recordings (p = 1e-9): bus.m 1 against 2" for k in (1, 2)]
    assert note_lines(both)[0].startswith("note: exp1, exp2 contradict each other")
    assert note_lines(both[:1])[0] == f"note: {both[0]}"
    many = note_lines(f"note {k}" for k in range(30))
    assert len(many) == 6 and many[-1] == "note: 25 more with --all"
    assert len(clip_line("x" * 500)) <= COLUMNS


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("−1.25·10⁻⁵", "-1.25e-05"),
        ("± 1.6·10⁻⁴", "± 0.00016"),
        ("kg m²/s³", "kg m^2/s^3"),
        ("run1e-3", "run1e-3"),
        ("–", "-"),
    ],
)
def test_numbers_of_a_page_are_those_a_program_reads(text, plain):
    assert plain_text(text) == plain


def test_names_stay_whole_beside_many_columns():
    """The last table of `smsid demo` had two characters a line for them."""
    columns = ("parameter", "#truth", "#paper", *(f"#column {k}" for k in range(5)))
    texts = ("clamped f2 [Hz]", "0.287", "16.567 (2761.17 kg/m^3)", *(5 * ("0.123456789",)))
    out = StringIO()
    Console(file=out, width=WIDTH).print(report_table(Table("", columns, [cells(*texts)])))
    lines = out.getvalue().splitlines()
    assert max(map(len, lines)) <= WIDTH
    assert any("clamped f2 [Hz]" in line for line in lines)
    assert all(word in out.getvalue() for word in ("16.567", "(2761.17", "kg/m^3)", "0.123456789"))
    assert "…" not in out.getvalue()
