"""The command, registered as the application does it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from smsid.cli.campaign import campaign_command


@pytest.fixture
def app() -> typer.Typer:
    application = typer.Typer(pretty_exceptions_enable=False)
    application.command(name="campaign")(campaign_command)
    application.command(name="other")(lambda: None)
    return application


def test_command_writes_results_and_summary(
    app: typer.Typer, make_plan: Callable[..., Path], tmp_path: Path
) -> None:
    output = tmp_path / "c.jsonl"
    plan = make_plan(options={"failing": [3]})
    arguments = ["campaign", str(plan), "-o", str(output), "--backend", "serial", "--runs", "6"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "6 runs, 1 failed" in result.output
    assert re.search(r"mass +kg ", result.output)
    assert "told to fail" in re.sub(r"[\s│]+", " ", result.output)
    document = json.loads((tmp_path / "c.summary.json").read_text())
    assert document["runs"] == 6
    assert len(output.read_text().splitlines()) == 7


def test_an_interruption_says_how_to_go_on(
    app: typer.Typer, make_plan: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("smsid.campaign.run.run_campaign", interrupted)
    result = CliRunner().invoke(app, ["campaign", str(make_plan()), "-o", str(tmp_path / "c.jsonl")])
    assert result.exit_code != 0
    assert "goes on from there" in result.output.replace("\n", " ")
