"""What is imported, and when; completion of the shell."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from smsid.cli.app import COMMANDS
from smsid.cli.lab import lab_app

HEAVY = ("pinocchio", "numpy", "scipy", "xarray", "h5py", "joblib", "matplotlib", "meshcat", "jinja2")


def imported(code: str) -> set[str]:
    """Which heavy packages a fresh interpreter has imported at the end of some code."""
    code += f"\nprint('imported', *[m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\n{code}"], capture_output=True, text=True, check=True
    )
    return set(done.stdout.split("imported", 1)[1].split())


def after(*words: str) -> set[str]:
    return imported(
        f"from smsid.cli import main\nsys.argv = {['smsid', *words]!r}\n"
        "sys.stdout, out = open('/dev/null', 'w'), sys.stdout\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\nsys.stdout = out"
    )


def test_the_package_alone_imports_nothing() -> None:
    assert imported("import smsid") == set()


@pytest.mark.parametrize("words", [(), ("--help",), ("version",), ("frobnicate",)])
def test_help_waits_for_nothing(words: tuple[str, ...]) -> None:
    assert after(*words) == set()


def test_help_of_no_command_waits_for_anything() -> None:
    """All in one interpreter, one after the other: what is imported is told by the command that does it."""
    words = [[name] for name in COMMANDS]
    words += [["lab", c.callback.__name__] for c in lab_app.registered_commands if c.callback is not None]
    code = f"""
import contextlib, io, json, sys
from smsid.cli import main
told, before = {{}}, set()
for words in {words!r}:
    sys.argv = ["smsid", *words, "--help"]
    page = io.StringIO()
    with contextlib.redirect_stdout(page), contextlib.suppress(SystemExit):
        main()
    now = {{m for m in {HEAVY} if m in sys.modules}}
    told[" ".join(words)] = [" ".join(page.getvalue().split()[:2]), sorted(now - before)]
    before |= now
print(json.dumps(told))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    told = json.loads(done.stdout)
    assert len(told) == len(words) > 15
    assert {name: found for name, (page, found) in told.items() if page != "Usage: smsid" or found} == {}


def run(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", "from smsid.cli import main; main()", *words],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
        timeout=120,
    )


@pytest.mark.parametrize(
    ("typed", "offered"),
    [("smsid ident", "identify"), ("smsid identify --met", "--method"), ("smsid lab os", "oscillator")],
)
def test_the_shell_completes_commands_and_options(typed: str, offered: str) -> None:
    words = str(len(typed.split()) - 1)
    done = run(_SMSID_COMPLETE="complete_bash", COMP_WORDS=typed, COMP_CWORD=words)
    assert done.stdout.split() == [offered], done.stderr


def test_completion_is_shown_and_installed_where_the_shell_looks(tmp_path: Path) -> None:
    known = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1", "HOME": str(tmp_path)}
    shown = run("--show-completion", "bash", **known)
    assert shown.returncode == 0 and "complete -o default -F _smsid_completion smsid" in shown.stdout
    assert run("--install-completion", "bash", **known).returncode == 0
    script = tmp_path / ".bash_completions" / "smsid.sh"
    assert "_smsid_completion" in script.read_text()
    assert str(script) in (tmp_path / ".bashrc").read_text()
