"""Manners of every command: JSON, quiet, help, errors with a mend, nothing written elsewhere."""

from __future__ import annotations

import json
import logging
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from smsid.cli.app import COMMANDS, app, main
from smsid.cli.errors import CommandResult, with_output_options
from smsid.cli.output import show_progress, show_spinner, warn
from smsid.errors import SmsidError


def leaves() -> list[tuple[str, Any]]:
    """Every command, those of groups too, with the words that call it."""
    found = []
    for name, entry in COMMANDS.items():
        command = entry.load(name)
        inner = getattr(command, "commands", None)
        found += [(f"{name} {k}", c) for k, c in inner.items()] if inner else [(name, command)]
    return found


LEAVES = leaves()
NUMBERS = ("highest", "frequency", "rate")
each = pytest.mark.parametrize(("words", "command"), LEAVES, ids=[w for w, _ in LEAVES])


@pytest.fixture
def call(monkeypatch, capsys):
    """Run the command line in this process: exit code, stdout and stderr."""

    def run(*words: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["smsid", *map(str, words)])
        root = logging.getLogger()
        before = root.handlers[:], root.level
        try:
            main()
            code: Any = 0
        except SystemExit as left:
            code = left.code or 0
        finally:
            root.handlers, root.level = before
        told = capsys.readouterr()
        return code, told.out, told.err

    return run


@each
def test_every_command_takes_json_and_quiet(words, command):
    options = {name for p in command.params for name in p.opts}
    assert {"--json", "--quiet", "-q"} <= options


@each
def test_help_fits_and_says_what_it_does(words, command):
    told = CliRunner().invoke(app, [*words.split(), "--help"])
    assert told.exit_code == 0
    assert max(map(len, told.output.splitlines())) <= 80
    assert f"Usage: smsid {words}" in told.output
    helps = [p.help for p in command.params if p.name != "help"]
    assert all(helps), "an option without help"


def test_the_list_of_commands_is_not_cut_short():
    told = CliRunner().invoke(app, ["--help"]).output
    assert "..." not in told.split("Commands:")[1]
    assert max(map(len, told.splitlines())) <= 80


@each
def test_paths_that_do_not_exist_are_told_in_a_line_with_a_mend(words, command, call, tmp_path, monkeypatch):
    required = [p for p in command.params if p.required]
    if not required:
        pytest.skip("needs nothing that could be wrong")
    monkeypatch.chdir(tmp_path)
    given: list[str] = []
    for p in required:
        value = "1" if p.name in NUMBERS else "missing.toml"
        given += [value] if p.param_type_name == "argument" else [p.opts[0], value]
    code, out, err = call(*words.split(), *given)
    assert code in (1, 2)
    assert err.startswith("error: ") and "Traceback" not in err
    assert out == ""
    assert err.count(".") >= 2 and len(err.split()) > 4  # what is wrong, and what to do
    code, out, err = call(*words.split(), *given, "--json", "--quiet")
    assert code in (1, 2) and err.startswith("error: ")
    found = json.loads(out)
    assert found["exit_code"] == code and found["error"]["message"]
    assert not list(tmp_path.iterdir())


def good(urdf: Path, out: Path) -> dict[str, tuple[list[Any], set[str]]]:
    """Calls that are quick and go well, and the files they write."""
    sms = urdf / "paper_sms.toml"
    (out / "log.csv").write_text("t,wx,wy,wz\n" + "".join(f"{k / 10},0,0,{k % 3}\n" for k in range(50)))
    (out / "map.toml").write_text(
        '[time]\ncolumn = "t"\nunit = "s"\n'
        '[channel."imu.angular_rate"]\ncolumns = ["wx", "wy", "wz"]\nunit = "rad/s"\n'
    )
    log, rules = out / "log.csv", out / "map.toml"
    return {
        "version": (["version"], set()),
        "show": (["show", sms], set()),
        "inspect": (["inspect", log, "--map", out / "draft.toml"], {"draft.toml"}),
        "import": (["import", log, "--map", rules, "-o", out / "rec.nc"], {"rec.nc"}),
        "export": (["export", sms, "-o", out / "there"], {"there"}),
    }


@pytest.mark.parametrize("name", ["version", "show", "inspect", "import", "export"])
def test_json_is_all_there_is_on_stdout_and_quiet_is_silent(name, urdf, call, tmp_path, monkeypatch):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    out = tmp_path / "out"
    out.mkdir()
    words, expected = good(urdf, out)[name]
    before = {p.name for p in out.iterdir()}
    code, told, err = call(*words, "--json")
    assert (code, err) == (0, "")
    document = json.loads(told)
    assert document["exit_code"] == 0
    assert set(document) > {"exit_code", "written"} and "text" not in document
    assert {p.name for p in out.iterdir()} - before == expected
    for path in document["written"]:
        assert Path(path).is_relative_to(out) and Path(path).exists()
    assert not list(elsewhere.iterdir())
    if name == "export":
        words[-1] = out / "again"
    code, told, err = call(*words, "--quiet")
    assert (code, told, err) == (0, "", "")


def test_show_tells_the_same_as_json(urdf, call, oracle, tmp_path):
    assert call("import", oracle / "exp2.npz", "--map", "oracle_exp2", "-o", tmp_path / "r.nc")[0] == 0
    found = json.loads(call("show", tmp_path / "r.nc", "--json")[1])
    assert found["kind"] == "recording"
    channels = {c["name"]: c for c in found["recording"]["channels"]}
    assert channels["encoder.joint_position"]["unit"] == "rad"
    assert channels["encoder.joint_position"]["shape"][1] == 3


def test_output_folder_is_looked_at_before_the_work_is_done(urdf, call, tmp_path, monkeypatch):
    def never(*_: Any, **__: Any) -> None:
        raise AssertionError("worked before looking")

    monkeypatch.setattr("smsid.description.load_description", never)
    code, _, err = call("simulate", urdf / "paper_sms.toml", "exp1", "-o", tmp_path / "no" / "rec.nc")
    assert code == 1 and "does not exist" in err and "Create it first" in err
    code, _, err = call("identify", urdf / "paper_sms.toml", "r.nc", "-o", tmp_path)
    assert code == 1 and "it is a folder" in err


def test_no_right_to_read_is_told_without_a_traceback(call, monkeypatch, urdf):
    def refuse(*_: Any, **__: Any) -> None:
        raise PermissionError(13, "Permission denied", "secret.toml")

    monkeypatch.setattr("smsid.description.load_description", refuse)
    code, _, err = call("show", urdf / "paper_sms.toml")
    assert code == 1 and "Permission denied: secret.toml" in err and "Traceback" not in err


def test_a_fault_of_our_own_is_owned_up_to(call, monkeypatch, urdf):
    def fail(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("oops")

    monkeypatch.setattr("smsid.description.load_description", fail)
    code, out, err = call("show", urdf / "paper_sms.toml", "--json")
    assert code == 70 and "fault of smsid" in err and "Traceback" in err
    assert json.loads(out)["error"]["kind"] == "ZeroDivisionError"


def test_an_interruption_ends_with_130(call, monkeypatch, urdf):
    def stop(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("smsid.description.load_description", stop)
    code, _, err = call("show", urdf / "paper_sms.toml")
    assert code == 130 and "interrupted" in err


def test_wrong_words_are_told_with_the_page_of_help(call):
    code, _, err = call("simulate", "a.toml", "exp1", "--sede", "3")
    assert code == 2 and "--seed" in err and "smsid simulate --help" in err
    code, _, err = call("identfy")
    assert code == 2 and "identify" in err
    code, out, err = call()
    assert code == 2 and out == "" and "Usage: smsid" in err


def invoked(function: Any, *words: str) -> Any:
    alone = typer.Typer(add_completion=False)
    alone.command()(with_output_options(function))
    return CliRunner().invoke(alone, words)


def test_outcome_goes_with_its_exit_code():
    def judge(name: str) -> CommandResult:
        print("for people")
        return CommandResult({"name": name, "share": float("nan")}, [Path("a.json")], 3)

    told = invoked(judge, "x", "--json")
    assert told.exit_code == 3
    assert json.loads(told.stdout) == {"exit_code": 3, "written": ["a.json"], "name": "x", "share": None}
    told = invoked(judge, "x")
    assert (told.exit_code, told.stdout) == (3, "for people\nwrote a.json\n")
    assert invoked(judge, "x", "-q").stdout == ""


def test_a_command_that_hands_nothing_back_still_gives_json():
    def speak(name: str) -> None:
        print(f"hello {name}")

    assert json.loads(invoked(speak, "x", "--json").stdout)["text"] == "hello x\n"


def test_errors_go_into_the_json_with_their_advice():
    def fail() -> CommandResult:
        raise SmsidError("It broke.", advice="Mend it.")

    told = invoked(fail, "--json")
    assert json.loads(told.stdout)["error"] == {
        "kind": "SmsidError",
        "message": "It broke.",
        "advice": "Mend it.",
    }


def test_progress_and_warnings_keep_off_stdout(capsys, monkeypatch):
    def work() -> CommandResult:
        with show_spinner("thinking") as tell, show_progress("counting", 3.0, "s") as count:
            logging.getLogger("smsid.test").info("half way")
            tell("nearly")
            count(2.0)
        warn("careful")
        return CommandResult({"done": True})

    monkeypatch.setenv("FORCE_COLOR", "1")  # rich takes stderr for a terminal
    monkeypatch.setenv("TERM", "xterm")
    told = invoked(work, "--json")
    assert json.loads(told.stdout)["done"] is True
    assert "careful" in told.stderr and "nearly" in told.stderr
    quiet = invoked(work, "--quiet")
    assert (quiet.stdout, quiet.stderr) == ("", "")


def test_a_clock_that_stands_still_has_no_rate():
    from smsid.cli.tables import channel_rows
    from smsid.recording import Recording

    def rate_of(time):
        return channel_rows(Recording.from_arrays(time, {"a.joint_position": time[:, None]}))[0]["rate"]

    assert rate_of(np.zeros(5)) is None and rate_of(np.zeros(1)) is None
    assert rate_of(np.arange(5) / 50.0) == pytest.approx(50.0)
