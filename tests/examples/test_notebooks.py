"""Every notebook runs from top to bottom in IPython, in an empty folder, and shows something."""

from __future__ import annotations

import ast
import json
import os
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
SLOW = ("2_name_the_cause",)  # `tests/cli/test_demo_verdict.py` asks the same of the command
pytest.importorskip("IPython", reason="IPython (of smsid[view]) runs the notebooks")
pytest.importorskip("matplotlib", reason="notebooks draw with smsid[plot]")


def code(path: Path) -> list[str]:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    assert all(not c.get("outputs") for c in cells), "outputs are not kept: they would go stale"
    return ["".join(c["source"]) for c in cells if c["cell_type"] == "code"]


def test_there_are_three() -> None:
    assert len(NOTEBOOKS) == 3


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_the_notebook_finds_what_it_imports(path: Path) -> None:
    from IPython.core.inputtransformer2 import TransformerManager

    names: dict[str, object] = {}
    for cell in code(path):
        for statement in ast.parse(TransformerManager().transform_cell(cell)).body:
            if isinstance(statement, (ast.Import, ast.ImportFrom)):
                exec(compile(ast.Module([statement], []), path.name, "exec"), names)
    assert any("smsid" in str(value) for value in names.values())


@pytest.mark.parametrize(
    "path",
    [pytest.param(p, id=p.stem, marks=[pytest.mark.slow] if p.stem in SLOW else []) for p in NOTEBOOKS],
)
def test_the_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from IPython.core.interactiveshell import InteractiveShell
    from IPython.utils.capture import capture_output

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    shell = InteractiveShell()
    shown = 0
    for cell in code(path):
        with capture_output() as captured:
            result = shell.run_cell(cell)
        assert result.success, (cell, result.error_before_exec or result.error_in_exec, captured.stdout)
        if result.result is not None:
            shell.display_formatter.format(result.result)
            assert len(repr(result.result).splitlines()) <= 30, cell
            shown += 1
    assert shown, "nothing is shown"
    assert os.getcwd() == str(tmp_path)
