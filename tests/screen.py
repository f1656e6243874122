"""What a command prints by default options fits a screen, and `smsid show` shows what it wrote."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from smsid.cli.app import app

LINES, COLUMNS = 60, 110


def fits(text: str) -> None:
    """Assert that a text is at most a screen."""
    lines = text.splitlines()
    assert 0 < len(lines) <= LINES, f"{len(lines)} lines"
    assert max(map(len, lines)) <= COLUMNS, max(lines, key=len)


def shows(path: Path) -> str:
    """Assert that `smsid show` shows a file on a screen; return what it prints."""
    done = CliRunner().invoke(app, ["show", str(path)])
    assert done.exit_code == 0, (done.output, done.exception)
    fits(done.stdout)
    return done.stdout
