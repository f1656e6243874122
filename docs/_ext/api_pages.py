"""One page of the API per subpackage, written before every build from what the subpackages export.

A subpackage shows the names of its ``__all__``; one without it shows its public modules. Beside them a page
says which subpackage imports which.
"""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
import tomllib
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
IMPORTS = """# The import graph

Every import of one part of `smsid` by another, those for types and inside of functions too, as the code has
them. The order is that of the layers in `pyproject.toml`, the highest first: what a row imports stands below
it, but for the figure of a result (`identify` and `diagnose` know `figures`) and within the spacecraft
(`description`, `effects`, `inputs`, `model`: one layer).

| part | modules | imports | is imported by |
|---|---|---|---|
"""


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


def import_graph(package: Path) -> dict[str, set[str]]:
    """Return which parts of the package every one of its parts imports."""
    graph: dict[str, set[str]] = {}
    for path in package.rglob("*.py"):
        part = path.relative_to(package).parts[0].removesuffix(".py")
        found = graph.setdefault(part, set())
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and not node.level:
                base = node.module or ""
                found |= {f"{base}.{a.name}" for a in node.names} if base == package.name else {base}
            elif isinstance(node, ast.Import):
                found |= {a.name for a in node.names}
    for part, names in graph.items():
        inside = {n.split(".")[1] for n in names if n.startswith(f"{package.name}.")}
        graph[part] = (inside & graph.keys()) - {part}
    return graph


def import_page(root: Path) -> str:
    """Return the page of the import graph, a row per public part by layer; a checkout is at ``root``."""
    graph = import_graph(root / "smsid")
    linter = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    layers = [re.split(r"\s*[|:]\s*", layer) for layer in linter["contracts"][0]["layers"]]
    order = [part for layer in layers for part in layer if not part.startswith("_")]
    rows = []
    for part in order:
        count = len(list((root / "smsid" / part).rglob("*.py"))) or 1
        lower = [f"`{x}`" for x in order if x in graph[part]]
        upper = [f"`{x}`" for x in order if part in graph[x]]
        rows.append(f"| `{part}` | {count} | {', '.join(lower)} | {', '.join(upper)} |")
    return IMPORTS + "\n".join(rows) + "\n"


def generate(app: Sphinx) -> None:
    """Write the pages into the folder ``api`` of the sources, and remove those of modules that are gone."""
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    names = public()
    for name in names:
        write(folder / f"{name}.md", page(name))
    write(folder / "index.md", HEAD.replace(LIBRARY, library()) + "\n".join([*names, "imports"]) + "\n```\n")
    write(folder / "imports.md", import_page(Path(app.srcdir).parent))
    for old in folder.glob("*.md"):
        if old.stem not in (*names, "index", "imports"):
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
