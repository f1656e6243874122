"""The page of results says what the results say."""

from __future__ import annotations

import importlib
import json
import shutil
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def writer():
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        return importlib.import_module("results_page")
    finally:
        sys.path.pop(0)


def test_every_benchmark_has_a_row_and_every_result_a_benchmark():
    folder, text = ROOT / "benchmarks", (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    scripts = {p.stem for p in folder.glob("[!_]*.py")} - {"results_page"}
    assert not {s for s in scripts if f"benchmarks/{s}.py" not in text}
    of_one = tuple(scripts)
    left = {p.name for p in (folder / "results").iterdir() if not p.name.startswith(of_one)}
    assert left == {n for n in left if f"results/{n.partition('.')[0]}." in text}


def test_the_committed_page_is_the_written_one(writer):
    assert (ROOT / "docs" / "results.md").read_text(encoding="utf-8") == writer.page()


def test_a_changed_result_changes_the_page(writer, tmp_path):
    for name in ("tx40", "silverbox", "antisloshing", "cessipy_slab"):
        shutil.copy(ROOT / "benchmarks" / "results" / f"{name}.json", tmp_path)
    path = tmp_path / "silverbox.json"
    result = json.loads(path.read_text(encoding="utf-8"))
    result["models"]["linear"]["arrow_free_run_rmse_mV"] = 123.456
    path.write_text(json.dumps(result), encoding="utf-8")
    assert "123.456" in writer.page(tmp_path) and "123.456" not in writer.page()
