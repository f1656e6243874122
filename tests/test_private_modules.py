"""A file's name says who may import it: ``_name.py`` its own folder alone, ``name.py`` others too.

Others are subpackages, and what users read: examples and the code of the pages. Tests and benchmarks look
behind the names; a command's file and an effect's are called by name from a table (`COMMANDS`, `register`).
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "smsid"
TABLES = ("cli", "effects")
CODE_OF_PAGES = re.compile(r"(?:from|import) (smsid(?:\.\w+)+)")


def modules() -> dict[str, Path]:
    """Return the file of every module and subpackage of smsid, by its dotted name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = modules()


def named_in(source: str) -> set[str]:
    """Return the modules that a source imports, or names in a text that is nothing else."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            found |= {
                name if (name := f"{node.module}.{a.name}") in MODULES else node.module for a in node.names
            }
        elif isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value.partition(":")[0])
    return found & MODULES.keys()


def users() -> dict[str, set[Path]]:
    """Return which files of the package, the examples and the pages name each module."""
    found = defaultdict(set)
    for path in (*PACKAGE.rglob("*.py"), *(ROOT / "examples").rglob("*.py")):
        for module in named_in(path.read_text(encoding="utf-8")):
            found[module].add(path)
    for path in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        for module in MODULES.keys() & set(CODE_OF_PAGES.findall(path.read_text(encoding="utf-8"))):
            found[module].add(path)
    return found


USERS = users()


def outside(module: str) -> list[str]:
    """Return who names a module from outside of its folder."""
    folder = MODULES[module].parent
    return sorted(str(p.relative_to(ROOT)) for p in USERS[module] if folder not in p.parents)


def test_imports_of_all_kinds_are_seen():
    """From a package, of a name, as a whole, within a function, for types, by a text."""
    source = """
from smsid.model import build
from smsid.errors import SmsidError
import smsid.paths
if TYPE_CHECKING:
    from smsid.recording.recording import Recording
def load():
    from smsid.simulate import simulate
    return "smsid.kernel.jit:compiled", "about smsid.lab.tank: a text"
"""
    named = named_in(source)
    assert named == {
        "smsid.model.build", "smsid.errors", "smsid.paths", "smsid.recording.recording", "smsid.simulate",
        "smsid.kernel.jit",
    }  # fmt: skip


def test_who_is_outside():
    assert outside("smsid.diagnose._forward_step") == []
    assert "smsid/diagnose/diagnose.py" not in outside("smsid.diagnose.result") != []


@pytest.mark.parametrize("module", sorted(m for m, p in MODULES.items() if p.name != "__init__.py"))
def test_the_name_of_a_file_says_who_imports_it(module: str):
    path = MODULES[module]
    if path.name.startswith("_"):
        assert not outside(module), "rename it without the underscore, or import it from its folder alone"
    elif path.parent != PACKAGE and path.relative_to(PACKAGE).parts[0] not in TABLES:
        assert outside(module), f"only its own folder imports it: rename it to _{path.name}"
