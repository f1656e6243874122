"""No command destroys what it reads: all commands, all their outputs, all their inputs."""

from __future__ import annotations

import inspect
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import typer

from smsid._files import atomic_write, protect_inputs
from smsid.cli.app import COMMANDS, main
from smsid.cli.diagnose import _extended_path
from smsid.cli.places import Writes, option_name, output_marks
from smsid.description import load_description, save_description
from smsid.errors import OutputError
from smsid.paths import urdf_folder
from smsid.recording import Recording, save_recording

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
try:
    import _fuzz
finally:
    sys.path.pop(0)


def functions() -> list[tuple[str, Callable[..., Any]]]:
    """Every command's function, those of groups too, with the words that call it."""
    found = []
    for name, entry in COMMANDS.items():
        module, _, attribute = entry.target.partition(":")
        target = getattr(__import__(f"smsid.cli.{module}", fromlist=[attribute]), attribute)
        if isinstance(target, typer.Typer):
            for info in target.registered_commands:
                assert info.callback is not None
                found.append((f"{name} {info.name or info.callback.__name__}", info.callback))
        else:
            found.append((name, target))
    return found


def parameters(function: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    found = inspect.signature(function, eval_str=True).parameters
    return {k: p for k, p in found.items() if k not in ("as_json", "quiet", "context")}


def is_path(p: inspect.Parameter) -> bool:
    return "Path" in str(get_args(p.annotation)[0])


def is_argument(p: inspect.Parameter) -> bool:
    return any(isinstance(a, typer.models.ArgumentInfo) for a in get_args(p.annotation))


def inputs(function: Callable[..., Any]) -> list[str]:
    """Names of what a command reads: paths without a mark, and words that may name a file."""
    words = ("experiment", "mapping")
    marks = output_marks(function)
    return [k for k, p in parameters(function).items() if k not in marks and (is_path(p) or k in words)]


FUNCTIONS = functions()
CASES = [
    pytest.param(words, f, out, source, id=f"{words}: {out} is {source}")
    for words, f in FUNCTIONS
    for out in output_marks(f)
    for source in inputs(f)
]
DEFAULTS = [
    pytest.param(words, f, out, id=f"{words}: {p.default}")
    for words, f in FUNCTIONS
    for out, mark in output_marks(f).items()
    if isinstance((p := parameters(f)[out]).default, Path) and not mark.folder
]
PAIRS = [
    pytest.param(words, f, one, other, id=f"{words}: {one} is {other}")
    for words, f in FUNCTIONS
    for one in output_marks(f)
    for other in output_marks(f)
    if one < other
]


def call(words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: Any) -> tuple[int, str]:
    monkeypatch.setattr(sys, "argv", ["smsid", *words])
    try:
        main()
        code = 0
    except SystemExit as left:
        code = int(left.code or 0)
    return code, capsys.readouterr().err


def command_line(words: str, f: Callable[..., Any], given: dict[str, Path]) -> list[str]:
    """Words that call a command with these paths and anything for what else it requires."""
    line = words.split()
    for name, p in parameters(f).items():
        needed = p.default is inspect.Parameter.empty
        value = str(given[name]) if name in given else "1" if needed else None
        if value is None and is_argument(p) and any(k in given for k in later_arguments(f, name)):
            value = "unused.json"
        if value is not None:
            line += [value] if is_argument(p) else [option_name(p), value]
    return line


def later_arguments(f: Callable[..., Any], name: str) -> list[str]:
    names = [k for k, p in parameters(f).items() if is_argument(p)]
    return names[names.index(name) + 1 :]


def fitting(folder: Path, name: str, mark: Writes) -> Path:
    """A file that is read, with the suffix of what is written, so that only its being an input is wrong."""
    path = folder / f"{name}{(mark.suffixes or ('.dat',))[0]}"
    path.write_bytes(f"measured: {name}".encode())
    return path


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize(("words", "f", "out", "source"), CASES)
def test_an_output_that_is_an_input_is_refused(words, f, out, source, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    mark = output_marks(f)[out]
    given = {k: fitting(tmp_path, k, mark) for k in inputs(f)}
    path = given[source]
    symbolic, hard = (tmp_path / f"{kind}{path.suffix}" for kind in ("symbolic", "hard"))
    symbolic.symlink_to(path)
    os.link(path, hard)
    before = contents(tmp_path)
    for same in (path, symbolic, hard, tmp_path / "." / ".." / tmp_path.name / path.name):
        line = command_line(words, f, {**given, out: same})
        code, err = call(line, monkeypatch, capsys)
        assert code == 1, (line, err)
        assert err.startswith("error: ") and "Traceback" not in err
        assert "is a file" in err if mark.folder else "is an input" in err
        assert contents(tmp_path) == before and symbolic.is_symlink()


@pytest.mark.parametrize(("words", "f", "one", "other"), PAIRS)
def test_two_outputs_in_one_place_are_refused(words, f, one, other, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    given = {k: fitting(tmp_path, k, Writes()) for k in inputs(f)}
    before = contents(tmp_path)
    marks = output_marks(f)
    same = tmp_path / f"same{marks[one].suffixes[0]}"
    code, err = call(command_line(words, f, {**given, one: same, other: same}), monkeypatch, capsys)
    assert code == 1 and err.startswith("error: ")
    assert "the same file as" in err or "does not fit" in err
    assert contents(tmp_path) == before


@pytest.mark.parametrize(("words", "f"), FUNCTIONS, ids=[w for w, _ in FUNCTIONS])
def test_what_is_written_is_marked_and_its_suffix_checked(words, f, tmp_path, monkeypatch, capsys):
    marks = output_marks(f)
    for name, p in parameters(f).items():
        if not is_path(p):
            continue
        told = " ".join(str(getattr(a, "help", "")) for a in get_args(p.annotation))
        writes = {"write", "folder to", "folder for"}
        looks = option_name(p) in ("--output", "--report", "--html") or any(w in told for w in writes)
        looks = looks and "`" not in told.partition("write")[0]  # "that `smsid identify` wrote"
        assert name in marks or not looks, f"{words}: {option_name(p)} is written and has no mark"
    monkeypatch.chdir(tmp_path)
    for name, mark in marks.items():
        assert mark.folder or mark.suffixes, f"{words}: {name} may have any suffix"
        if mark.suffixes:
            given = {k: fitting(tmp_path, k, Writes()) for k in inputs(f)}
            before = contents(tmp_path)
            for wrong in ("wrong.xyz", "wrong", "wrong.toml.exe"):
                code, err = call(
                    command_line(words, f, {**given, name: tmp_path / wrong}), monkeypatch, capsys
                )
                assert code == 1 and "does not fit" in err and mark.suffixes[0] in err
            assert contents(tmp_path) == before


def test_an_option_is_no_path_of_an_output(tmp_path, monkeypatch, capsys):
    """A folder named --json was written, and what was printed was no JSON."""
    monkeypatch.chdir(tmp_path)
    code, said = call(["export", "d.toml", "-o", "--json"], monkeypatch, capsys)
    assert code == 1 and "--output is followed by '--json', which is an option" in said
    assert not list(tmp_path.iterdir())


def test_a_file_that_a_description_names_is_an_input(tmp_path, monkeypatch, capsys):
    """The extended description would replace the arm's mapping, experiment or URDF that a TOML names."""
    (tmp_path / "d.toml").write_text('name = "d"\nurdf = "u.urdf"\n[[arm]]\nother = "more.toml"\n')
    (tmp_path / "u.urdf").write_text("<robot/>")
    (tmp_path / "more.toml").write_text("kept = true\n")
    code, err = call(
        ["diagnose", str(tmp_path / "d.toml"), "r.nc", "--extended", str(tmp_path / "more.toml")],
        monkeypatch,
        capsys,
    )
    assert code == 1 and "is an input" in err
    assert (tmp_path / "more.toml").read_text() == "kept = true\n"


def test_what_is_written_beside_is_compared_too(tmp_path, monkeypatch, capsys):
    """``diagnose`` writes extended.toml beside its output: not over the description it reads."""
    description = tmp_path / "extended.toml"
    description.write_text('name = "d"\n')
    line = ["diagnose", str(description), "r.nc", "-o", str(tmp_path / "d.json")]
    code, err = call(line, monkeypatch, capsys)
    assert code == 1 and "is an input" in err and description.read_text() == 'name = "d"\n'


def test_what_nobody_named_replaces_its_own_kind_only(tmp_path, monkeypatch, capsys):
    """``convert -o craft.csv`` writes craft.toml as well, which may be the description of the craft."""
    monkeypatch.chdir(tmp_path)
    rates = {"imu.angular_rate": np.zeros((9, 3))}
    save_recording(Recording.from_arrays(0.1 * np.arange(9), rates), "r.nc")
    kept = 'name = "d"\nurdf = "u.urdf"\n'
    Path("craft.toml").write_text(kept)
    code, err = call(["convert", "r.nc", "-o", "craft.csv"], monkeypatch, capsys)
    assert code == 1 and "'craft.toml'" in err and "is no mapping that smsid wrote" in err
    assert Path("craft.toml").read_text() == kept and not Path("craft.csv").exists()
    for _ in range(2):  # its own is replaced
        assert call(["convert", "r.nc", "-o", "log.csv"], monkeypatch, capsys)[0] == 0
    Path("extended.toml").write_text("duration = 1.0\n")
    code, err = call(["diagnose", "craft.toml", "r.nc", "-o", "d.json"], monkeypatch, capsys)
    assert code == 1 and "'extended.toml'" in err and "is no description that smsid wrote" in err


@pytest.mark.parametrize(("words", "f", "out"), DEFAULTS)
def test_a_default_output_replaces_nothing_that_smsid_did_not_write(
    words, f, out, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    given = {k: fitting(tmp_path, k, Writes()) for k in inputs(f)}
    default = parameters(f)[out].default
    for text in ("duration = 1.0\n", '{"kind": "another"}\n', ""):
        default.write_text(text)
        before = contents(tmp_path)
        code, err = call(command_line(words, f, given), monkeypatch, capsys)
        assert code == 1 and contents(tmp_path) == before
        if output_marks(f)[out].kind:  # a campaign goes on with its store
            assert f"'{default}' (the default of --output) is there already" in err


def test_a_default_output_replaces_what_the_command_wrote_but_no_measured_data(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    _fuzz.write_base(tmp_path)
    made = {
        "recording.nc": ["simulate", "d.toml", "s.toml"],
        "view.html": ["view", "d.toml"],
        "figure.png": ["plot", "recording", "r.nc"],
        "cut.nc": ["cut", "r.nc", "--from", "0.1", "--to", "0.3"],
        "experiment.toml": ["design", "d.toml", "--for", "mass", "--effort", "0.01", "--duration", "1"],
        "comparison.json": ["compare", "e.json", "e.json"],
    }
    for name, words in made.items():
        for _ in range(2):
            assert call(words, monkeypatch, capsys)[0] == 0, name
    shutil.copy("r.nc", "recording.nc")  # imported from l.csv
    code, err = call(made["recording.nc"], monkeypatch, capsys)
    assert code == 1 and "holds what was measured in 'l.csv'" in err
    assert Path("recording.nc").read_bytes() == Path("r.nc").read_bytes()
    assert call(["import", "l.csv", "--map", "m.toml"], monkeypatch, capsys)[0] == 0
    shutil.copy("e.json", "comparison.json")
    code, err = call(made["comparison.json"], monkeypatch, capsys)
    assert code == 1 and "is an estimate, not a comparison" in err
    with Path("experiment.toml").open("a") as stream:
        stream.write("# tried on Monday\n")
    code, err = call(made["experiment.toml"], monkeypatch, capsys)
    assert code == 1 and "or was changed since" in err
    assert Path("experiment.toml").read_text().endswith("# tried on Monday\n")


TOMLS = [
    pytest.param(words, f, out, id=f"{words}: {out}")
    for words, f in FUNCTIONS
    for out, mark in output_marks(f).items()
    if ".toml" in mark.suffixes
]


@pytest.mark.parametrize(("words", "f", "out"), TOMLS)
def test_a_toml_written_by_hand_is_never_replaced(words, f, out, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    given = {k: fitting(tmp_path, k, Writes()) for k in inputs(f)}
    Path("mine.toml").write_text('name = "two weeks of work"\n')
    Path("link.toml").symlink_to("mine.toml")
    for name in ("mine.toml", "link.toml"):
        before = contents(tmp_path)
        code, err = call(command_line(words, f, {**given, out: tmp_path / name}), monkeypatch, capsys)
        assert code == 1 and "written or changed by hand" in err and contents(tmp_path) == before


def test_a_drafted_mapping_is_replaced_until_somebody_goes_through_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    _fuzz.write_base(tmp_path)
    line = ["inspect", "l.csv", "--map", "draft.toml"]
    for _ in range(2):
        assert call(line, monkeypatch, capsys)[0] == 0
    text = Path("draft.toml").read_text()
    Path("draft.toml").write_text(text.replace('unit = "rad/s"', 'unit = "degree/s"', 1))
    code, err = call(line, monkeypatch, capsys)
    assert code == 1 and "written or changed by hand" in err
    assert "degree/s" in Path("draft.toml").read_text()


def test_a_writer_refuses_an_input_that_no_check_knew_of(tmp_path):
    (tmp_path / "a").write_text("measured")
    os.link(tmp_path / "a", tmp_path / "b")
    with protect_inputs([tmp_path / "a"]), pytest.raises(OutputError, match="it is the input"):
        atomic_write(tmp_path / "b", "lost")
    assert (tmp_path / "a").read_text() == "measured"
    atomic_write(tmp_path / "b", "may be written again")


def test_a_second_diagnosis_leaves_the_extended_description_of_the_first(tmp_path):
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    assert _extended_path(first) == (tmp_path / "extended.toml",)
    save_description(load_description(urdf_folder() / "paper_sms.toml"), tmp_path / "extended.toml")
    first.write_text("{}")
    assert _extended_path(first) == (tmp_path / "extended.toml",)  # its own is replaced
    assert _extended_path(second) == (tmp_path / "second.extended.toml",)


def test_a_recording_is_not_converted_over_the_log_it_was_imported_from(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{0.1 * k:.1f},0,{0.001 * k},0\n" for k in range(60))
    Path("log.csv").write_text(f"t,wx,wy,wz\n{rows}")
    columns = '[channel."imu.angular_rate"]\ncolumns = ["wx", "wy", "wz"]\nunit = "rad/s"\nframe = "body"\n'
    Path("map.toml").write_text(f'[time]\ncolumn = "t"\nunit = "s"\n{columns}')
    before = Path("log.csv").read_bytes()
    assert call(["import", "log.csv", "--map", "map.toml", "-o", "log.nc"], monkeypatch, capsys)[0] == 0
    code, err = call(["convert", "log.nc", "-o", "log.csv"], monkeypatch, capsys)
    assert code == 1 and "was imported from" in err and Path("log.csv").read_bytes() == before
    assert call(["convert", "log.nc", "-o", "again.csv"], monkeypatch, capsys)[0] == 0
