"""Effects hidden in MuJoCo worlds, and what the diagnosis says: rates with exact intervals, confusion matrix.

    python benchmarks/hidden_effects.py --seeds-from 1000 [--runs 500] [--minutes 60] [--family sensor]
        [--study strong]

Every run draws its world, what it hides, how strong and when from one seed, and the judge reads nothing but
diagnosis.json. Runs are kept in ``build/hidden_effects.jsonl`` and reused for the same sources of the
diagnosis, so the study can be stopped and started again; whatever is there is summed up in
``results/hidden_effects.json`` and ``.md``, or in those of a ``--study`` by name. Thresholds are frozen by
committing ``smsid/diagnose`` before a block of seeds (``--seeds-from``) is used for the first time: rows
carry the digest of its sources.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from _common import RESULTS, ROOT, commit, environment, write_result
from _hidden_summary import markdown, summary
from rich.console import Console

from smsid._files import atomic_write
from tests.hidden.plan import CATEGORIES, Run, draw_run
from tests.hidden.study import run_and_judge

NAME = "hidden_effects"
STORE = ROOT / "build" / f"{NAME}.jsonl"
STRENGTHS = (1.0, 3.0, 10.0, 100.0)
DECIDING = (
    "description", "diagnose", "effects", "estimation", "identify", "kernel", "likelihood", "model",
    "recording", "sensing", "simulate",
)  # fmt: skip
"""Packages that decide a verdict: those that ``smsid.diagnose`` imports."""


def digest() -> str:
    """Digest of the sources that decide a verdict, without comments, docstrings and layout."""
    found = hashlib.sha256()
    for package in DECIDING:
        for path in sorted((ROOT / "smsid" / package).rglob("*.py")):
            if "torque" not in path.parts:  # for logs of real arms; no part of this study
                found.update(path.name.encode() + _said(path).encode())
    return found.hexdigest()[:16]


def _said(path: Path) -> str:
    tree = ast.parse(path.read_bytes())
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node):
            node.body = node.body[1:]
    return ast.dump(tree)


def stored(fingerprint: str) -> dict[str, dict[str, Any]]:
    """Return the runs made with the same sources, by key; those that are drawn otherwise by now are not."""
    if not STORE.is_file():
        return {}
    rows = {}
    for line in STORE.read_text(encoding="utf-8").splitlines():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:  # cut short by an interruption
            continue
        if row["digest"] == fingerprint:
            rows[row["key"]] = row

    def drawn(row: dict[str, Any]) -> str:
        return draw_run(int(row["seed"]), strengths=tuple(row.get("strengths", STRENGTHS))).key

    return {k: r for k, r in rows.items() if drawn(r) == k}


def ceiling() -> dict[str, Any]:
    """Return what `hidden_ceiling` found, by world; nothing where it was not run."""
    path = RESULTS / "hidden_ceiling.json"
    return json.loads(path.read_text(encoding="utf-8"))["worlds"] if path.is_file() else {}


def planned(arguments: argparse.Namespace) -> Iterator[Run]:
    """Give the runs of the study, as drawn from consecutive seeds."""
    for seed in range(arguments.seeds_from, arguments.seeds_from + arguments.runs):
        run = draw_run(seed, strengths=tuple(arguments.strengths))
        families = {f for i in run.hidden for f in i.effect.family}
        if arguments.family is None or arguments.family == run.category or arguments.family in families:
            yield run


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds-from", type=int, required=True, help="first seed; one run a seed")
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--family", help=f"a family, or one of {', '.join(CATEGORIES)}")
    parser.add_argument(
        "--strengths", type=float, nargs="+", default=STRENGTHS, help="of single effects, 1: the limit"
    )
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so many")
    parser.add_argument("--study", help="end of the names of the files written: strong, friction, onset")
    parser.add_argument("--show", action="store_true", help="only sum up what is stored")
    arguments = parser.parse_args()
    console = Console()
    fingerprint = digest()
    rows = stored(fingerprint)
    STORE.parent.mkdir(exist_ok=True)
    until = time.monotonic() + 60.0 * arguments.minutes
    if not arguments.show:
        for run in planned(arguments):
            if run.key in rows or time.monotonic() > until:
                continue
            with tempfile.TemporaryDirectory(prefix="hidden-") as folder:
                drawn = {"key": run.key, "digest": fingerprint, "strengths": list(arguments.strengths)}
                row = {**drawn, **run_and_judge(run, Path(folder))}
            rows[run.key] = row
            with STORE.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            what = ", ".join(f"{h['effect']} x{h['strength']:g}" for h in row["hidden"]) or "nothing"
            console.print(
                f"{run.key} {row['world']}: {what}: [bold]{row['outcome']}[/bold] "
                f"{row['named']} {row['seconds']['diagnose']:.1f} s"
            )
    if digest() != fingerprint:
        console.print("the sources changed during the study: rows belong to what was loaded")
    result = {
        "environment": environment("smsid", "pin", "mujoco", "numpy", "scipy"),
        "commit": commit(ROOT),
        "digest": fingerprint,
        "seeds": sorted({int(r["seed"]) for r in rows.values()}),
        "levels": _levels(),
        **summary(list(rows.values()), ceiling()),
    }
    if not rows:
        console.print("no runs yet with these sources")
        return
    name = f"{NAME}_{arguments.study}" if arguments.study else NAME
    write_result(name, result)
    atomic_write(RESULTS / f"{name}.md", markdown(result))
    console.print(f"{len(rows)} runs; wrote {RESULTS / name}.json and .md")


def _levels() -> dict[str, Any]:
    from smsid.diagnose import DetectionThresholds

    names = ("candidate", "further", "block", "alias", "onset", "linear", "beside", "causes", "contenders")
    return {name: getattr(DetectionThresholds(), name) for name in names}


if __name__ == "__main__":
    main()
