"""One page of the API per subpackage, written before every build from what the subpackages export.

A subpackage shows the names of its ``__all__``; one without it shows its public modules.
"""

from __future__ import annotations

import importlib
import pkgutil
import re
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from sphinx.application import Sphinx

HIDDEN = ("cli",)  # the command line has a page of its own
HEAD = """# API

From the docstrings. SI units and radians throughout, arrays with the samples first; frames, channels and the
order of states are those of [the design](../design.md). Every error smsid raises is a
{py:obj}`smsid.errors.SmsidError`.

## What `import smsid` offers

Light to import; a name is loaded when it is used. Everything else stands in the subpackages below.

%library%

## Subpackages

```{toctree}
"""
LIBRARY = "%library%"


def write(path: Path, text: str) -> None:
    """Write a page unless it is there already as it should be: what has not changed is not built again."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def block(module: str, *options: str) -> str:
    """Return the directive that documents a module."""
    lines = [f".. automodule:: {module}", *(f"   :{x}:" for x in ("members", *options))]
    return "```{eval-rst}\n" + "\n".join(lines) + "\n```\n"


def page(name: str) -> str:
    """Return the page of a module or subpackage of smsid."""
    module = importlib.import_module(name)
    text = f"# `{name}`\n\n"
    if hasattr(module, "__all__"):
        return text + block(name, "imported-members")
    if not hasattr(module, "__path__"):
        return text + block(name)
    text += f"{(module.__doc__ or '').strip()}\n"
    for part in sorted(pkgutil.iter_modules(module.__path__), key=lambda m: m.name):
        if not part.name.startswith("_") and not part.name.endswith("command"):
            text += f"\n## `{name}.{part.name}`\n\n" + block(f"{name}.{part.name}")
    return text


def public(package: str = "smsid") -> list[str]:
    """Return the names of the public modules and subpackages."""
    found = pkgutil.iter_modules(importlib.import_module(package).__path__)
    return sorted(f"{package}.{m.name}" for m in found if not m.name.startswith("_") and m.name not in HIDDEN)


def library() -> str:
    """Return a table of the names that `smsid` itself offers, each with the first line of its docstring."""
    package = importlib.import_module("smsid")
    rows = []
    for name, module in sorted(package._MODULES.items(), key=lambda item: (item[0][0].isupper(), item[0])):
        place = ".".join(module.split(".")[:2])
        first = (getattr(importlib.import_module(module), name).__doc__ or "").strip().splitlines()[0]
        rows.append(f"| {{py:obj}}`{name} <{place}.{name}>` | {literal_bars(first)} |")
    return "\n".join(["| | |", "|---|---|", *rows])


def generate(app: Sphinx) -> None:
    """Write the pages into the folder ``api`` of the sources, and remove those of modules that are gone."""
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    names = public()
    for name in names:
        write(folder / f"{name}.md", page(name))
    write(folder / "index.md", HEAD.replace(LIBRARY, library()) + "\n".join(names) + "\n```\n")
    for old in folder.glob("*.md"):
        if old.stem not in (*names, "index"):
            old.unlink()


def literal_bars(line: str) -> str:
    """Return the line with bars outside backticks escaped: ``|x|`` is a magnitude and no substitution."""
    parts = re.split("(`+[^`]*`+)", line)
    return "".join(part if k % 2 else part.replace("|", r"\|") for k, part in enumerate(parts))


def docstring(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Mend a docstring's bars, and list the fields of a pydantic model."""
    lines[:] = [literal_bars(line) for line in lines]
    if what == "class" and issubclass(thing, BaseModel) and not any(":ivar" in line for line in lines):
        lines.append("")
        lines.extend(field(key, info) for key, info in thing.model_fields.items())


def field(key: str, info: Any) -> str:
    """Return the entry of one field: what it is, its unit, its default."""
    extra = info.json_schema_extra if isinstance(info.json_schema_extra, dict) else {}
    unit = f" [{extra['unit']}]" if extra.get("unit") else ""
    default = (
        "required" if info.is_required() else f"default ``{info.get_default(call_default_factory=True)!r}``"
    )
    return f":ivar {key}: {literal_bars(info.description or '')}{unit} ({default})"


def skip(app: Sphinx, what: str, name: str, thing: Any, skipped: bool, options: Any) -> bool | None:
    """Leave out what pydantic puts into every model."""
    return True if name in ("model_config", "model_post_init") else None


def setup(app: Sphinx) -> dict[str, Any]:
    """Run before the sources are read."""
    app.connect("builder-inited", generate)
    # after napoleon, which turns sections into fields
    app.connect("autodoc-process-docstring", docstring, priority=900)
    app.connect("autodoc-skip-member", skip)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
