"""The page of licences names what pyproject.toml names, and can be written again."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / "docs" / "_ext" / "licences.py"


def test_every_dependency_of_a_user_stands_on_the_page_with_its_licence():
    spec = importlib.util.spec_from_file_location("licences", SCRIPT)
    assert spec is not None and spec.loader is not None
    licences = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(licences)
    wanted = licences.requirements()
    rows = re.findall(r"^\| ([\w.-]+) \| (.+) \| (.+) \|$", licences.PAGE.read_text(encoding="utf-8"), re.M)
    assert {name: needed for name, needed, _ in rows[1:]} == wanted
    assert {"pin", "numpy", "meshcat"} <= set(wanted) and "pytest" not in wanted
    assert not [name for name, _, told in rows if told in ("not told", "not installed here")]
    assert (
        licences.licence("numpy") != "not told"
        and licences.licence("no-such-package") == "not installed here"
    )
