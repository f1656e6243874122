"""The site: equations become MathML, results become pages, nothing is fetched when it is read."""

from __future__ import annotations

import importlib
import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.docs.pages import ROOT, pages

pytest.importorskip("sphinx", reason="the extra docs is not installed")
EQUATION = re.compile(r"\$\$(.+?)\$\$|(?<![\\$])\$([^$\n]+?)\$", re.S)


@pytest.fixture
def extension(monkeypatch: pytest.MonkeyPatch):
    """Give an extension of docs/_ext by name."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "_ext"))

    def load(name: str) -> ModuleType:
        return importlib.import_module(name)

    return load


def equations() -> list[tuple[str, str]]:
    found = []
    for page in pages():
        text = re.sub(
            r"^( *)```.*?^ *```|`[^`\n]*`", "", page.path.read_text(encoding="utf-8"), flags=re.M | re.S
        )
        found += [(page.name, a or b) for a, b in EQUATION.findall(text)]
    return found


def test_every_equation_becomes_mathml(extension) -> None:
    convert, unknown = extension("mathml").convert, extension("mathml").UNKNOWN
    every = equations()
    assert len(every) > 150
    for page, latex in every:
        text = convert(re.sub(r"\\tag\{[^}]*\}", "", latex))
        assert text.startswith("<math") and not unknown.search(text), f"{page}: {latex}"


def test_an_unknown_command_is_seen(extension) -> None:
    mathml = extension("mathml")
    assert mathml.UNKNOWN.search(mathml.convert(r"x = \nosuchthing"))


def test_numbers_of_the_paper_stand_beside_its_equations() -> None:
    """Those that the code leans on, by their numbers in the print."""
    tags = " ".join(re.findall(r"\\tag\{([^}]*)\}", "".join(latex for _, latex in equations())))
    ranges = {int(n) for n in re.findall(r"\d+", tags)}
    assert {1, 2, 5, 7, 8, 12, 13, 16, 21, 22, 24, 25, 26, 27, 28, 29, 30, 31, 32, 33, 34, 35} <= ranges
    assert {37, 38, 39, 40, 42, 43, 44, 45, 46, 47, 48} <= ranges


def test_the_import_graph_is_that_of_the_code(extension, tmp_path) -> None:
    api = extension("api_pages")
    package = tmp_path / "pack"
    (package / "high").mkdir(parents=True)
    (package / "high" / "one.py").write_text("def f():\n    from pack.low import x\n")
    (package / "high" / "two.py").write_text("from pack import other\nimport numpy\nimport pack.high.one\n")
    (package / "low.py").write_text("")
    (package / "other.py").write_text("if TYPE_CHECKING:\n    import pack.low\n")
    assert api.import_graph(package) == {"high": {"low", "other"}, "low": set(), "other": {"low"}}
    rows = [line.split(" | ") for line in api.import_page(ROOT).splitlines() if line.startswith("| `")]
    named = [row[0].strip("| `") for row in rows]
    up = {f"{a} -> {b}" for a, row in zip(named, rows, strict=True) for b in re.findall("`(.*?)`", row[2])}
    ordered = {f"{a} -> {b}" for k, a in enumerate(named) for b in named[k + 1 :]}
    craft = ("description", "effects", "inputs", "model")
    left = {x for x in up - ordered if not {*x.split(" -> ")} <= {*craft}}
    assert left == {"identify -> figures", "diagnose -> figures"}


def test_results_become_tables(extension) -> None:
    measured = extension("measured_pages")
    result = {"environment": {}, "runs": 12, "spread": [0.98123, 1.0], "cases": [{"name": "a", "x": 1.23456}]}
    text = measured.figures(result)
    assert "| runs | 12 |" in text and "| spread | 0.9812, 1 |" in text and "| a | 1.235 |" in text


def test_every_result_has_a_page(extension) -> None:
    measured = extension("measured_pages")
    for path in sorted((ROOT / "benchmarks" / "results").glob("*.json")):
        script = ROOT / "benchmarks" / f"{path.stem}.py"
        if script.exists():
            result = json.loads(path.read_text(encoding="utf-8"))
            page = measured.page(path.stem, measured.asked(script), result, path.with_suffix(".md"))
            assert page.count("|") > 8, path.name


@pytest.mark.slow
def test_the_site_is_built_without_warnings_and_fetches_nothing(tmp_path: Path) -> None:
    site = tmp_path / "site"
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "--fail-on-warning",
        "--keep-going",
        "-q",
        "-d",
        str(tmp_path / "trees"),
    ]
    done = subprocess.run(
        [*command, str(ROOT / "docs"), str(site)], capture_output=True, text=True, timeout=1800
    )
    assert done.returncode == 0, done.stderr
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        fetched = re.findall(r"<(?:script|img|iframe|link)[^>]*?(?:src|href)=\"(?:https?:)?//[^\"]*\"", text)
        assert not fetched, f"{path.name}: {fetched[:3]}"
