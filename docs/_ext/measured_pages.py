"""Pages of what was measured, written before every build from `benchmarks/results`: nothing in them is typed.

One page per result: what was asked (the first sentence of the benchmark), machine and versions, and the
figures: the benchmark's own tables where it writes some, else the numbers of its JSON.
"""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from api_pages import write
from sphinx.application import Sphinx

ROWS = 40  # of a table of plain numbers; the rest is in the file
HEAD = """# What was measured

Every figure in these pages comes from a file in `benchmarks/results/`, written by a script in `benchmarks/`
with machine, versions and seeds. Recordings of real hardware have [a page of their own](../results.md).

| what | command | measured on | date |
|---|---|---|---|
"""


def asked(script: Path) -> str:
    """Return the first sentence of a benchmark's docstring."""
    doc = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
    return " ".join(doc.split("\n\n")[0].split()).rstrip(".").replace("|", r"\|")


def shown(value: Any) -> str | None:
    """Return a number, a word or a short list of them as text; None for anything else."""
    if isinstance(value, list) and value and len(value) <= 12:
        parts = [shown(x) for x in value]
        return ", ".join(x for x in parts if x) if all(parts) else None
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, bool | int | str) and len(str(value)) < 120:
        return str(value).replace("|", " ")
    return None


def numbers(value: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, str]]:
    """Give names and values of what can be shown, four levels deep."""
    text = shown(value)
    if text is not None:
        yield name.replace("|", " "), text
    elif isinstance(value, dict) and depth < 4:
        for key, inner in value.items():
            yield from numbers(inner, f"{name}, {key}" if name else str(key), depth + 1)


def figures(result: dict[str, Any]) -> str:
    """Return the tables of a result that has none of its own: one of every list, one of the rest."""
    plain = {k: v for k, v in result.items() if k not in ("environment", "claim", "command", "what")}
    lists = {k: v for k, v in plain.items() if isinstance(v, list) and v and isinstance(v[0], dict)}
    rows = list(numbers({k: v for k, v in plain.items() if k not in lists}))
    text = "| | |\n|---|---|\n" + "".join(f"| {name} | {value} |\n" for name, value in rows[:ROWS])
    if len(rows) > ROWS:
        text += f"\n{len(rows) - ROWS} more are in the file.\n"
    return text + "".join(records(name, every) for name, every in lists.items())


def records(name: str, every: list[dict[str, Any]]) -> str:
    """Return the table of a list of records, of what can be shown of them."""
    keys = [k for k in every[0] if all(shown(x.get(k, "")) is not None for x in every)][:9]
    if not keys:
        return ""
    lines = [keys, ["---"] * len(keys), *([shown(x.get(k, "")) or "" for k in keys] for x in every[:ROWS])]
    return f"\n## {name}\n\n" + "".join("| " + " | ".join(cells) + " |\n" for cells in lines)


def page(name: str, title: str, result: dict[str, Any], tables: Path) -> str:
    """Return the page of one result."""
    where = result.get("environment", {})
    versions = ", ".join(f"{k} {v}" for k, v in where.get("versions", {}).items())
    text = f"# {title}\n\n`python benchmarks/{name}.py`, on {where.get('cpu', 'a machine not named')}"
    text += f" ({where.get('cores', '?')} cores), Python {where.get('python', '?')}"
    text += f", {versions}" if versions else ""
    text += f", {where.get('date', 'no date')}. Source: `benchmarks/results/{name}.json`.\n\n"
    if not tables.exists():
        return text + figures(result)
    body = tables.read_text(encoding="utf-8").split("\n", 1)
    return text + (body[1] if body[0].startswith("# ") else "\n".join(body))


def generate(app: Sphinx) -> None:
    """Write the pages into the folder ``measured`` of the sources; those of results that are gone go too."""
    folder = Path(app.srcdir) / "measured"
    folder.mkdir(exist_ok=True)
    benchmarks = Path(app.srcdir).parent / "benchmarks"
    rows, names = [], []
    for path in sorted((benchmarks / "results").glob("*.json")):
        name, script = path.stem, benchmarks / f"{path.stem}.py"
        if not script.exists():
            continue
        result = json.loads(path.read_text(encoding="utf-8"))
        title, where = asked(script), result.get("environment", {})
        write(folder / f"{name}.md", page(name, title, result, path.with_suffix(".md")))
        names.append(name)
        cells = (f"[{title}]({name}.md)", f"`python benchmarks/{name}.py`", where.get("cpu", ""))
        rows.append("| " + " | ".join((*cells, where.get("date", ""))) + " |")
    toc = (
        "\n\n```{toctree}\n:hidden:\n\n"
        + "\n".join(f"{n.replace('_', ' ')} <{n}>" for n in names)
        + "\n```\n"
    )
    write(folder / "index.md", HEAD + "\n".join(rows) + toc)
    for old in folder.glob("*.md"):
        if old.stem not in (*names, "index"):
            old.unlink()


def setup(app: Sphinx) -> dict[str, Any]:
    """Run before the sources are read."""
    app.connect("builder-inited", generate)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
