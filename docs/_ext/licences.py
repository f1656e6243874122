"""What smsid depends on, and under which licences: ``python docs/_ext/licences.py`` writes the page.

Read from the metadata of what is installed; a package that is not is named as such.
"""

from __future__ import annotations

import re
import tomllib
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "licences.md"
DEVELOPERS = ("test", "benchmark", "docs", "lint")  # extras that no user needs
HEAD = """# Licences

smsid is under the BSD-3-Clause licence. What it stands on, by the metadata of each package; written by
`python docs/_ext/licences.py`. What only developers need (tests, benchmarks, this site) is left out.

| package | needed for | licence |
|---|---|---|
"""


def requirements() -> dict[str, str]:
    """Return every package that smsid or an extra of it names, with what needs it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = {"smsid": project["dependencies"]}
    groups |= {f"extra `{k}`": v for k, v in project["optional-dependencies"].items() if k not in DEVELOPERS}
    found: dict[str, list[str]] = {}
    for group, names in groups.items():
        for text in names:
            found.setdefault(re.split(r"[^\w.-]", text)[0], []).append(group)
    return {name: ", ".join(own) for name, own in found.items()}


def licence(package: str) -> str:
    """Return a package's licence in few words, as its metadata has it."""
    try:
        told = metadata.metadata(package)
    except metadata.PackageNotFoundError:
        return "not installed here"
    classified = [
        c.rpartition(" :: ")[2] for c in told.get_all("Classifier") or () if c.startswith("License")
    ]
    whole = (told.get("License") or "").strip()
    if "Redistribution and use in source and binary forms" in whole:
        whole = "BSD-3-Clause" if "Neither the name" in whole else "BSD-2-Clause"
    text = told.get("License-Expression") or " and ".join(c for c in classified if c != "OSI Approved")
    return (text or whole.split("\n")[0])[:80] or "not told"


def page() -> str:
    """Return the page."""
    rows = [f"| {name} | {needed} | {licence(name)} |\n" for name, needed in requirements().items()]
    return HEAD + "".join(rows)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
