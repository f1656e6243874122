"""Would the tests notice? ``python benchmarks/mutations.py [--minutes 60]``.

Each mutation of `mutations.toml` is planted in a copy of the sources, and the tests that ought to notice run
there, fast ones only. Half of them are of decisions in diagnosis and tracking: thresholds, sizes of tests,
prices, log-determinants, settling times. A result is a line of ``build/mutations.jsonl``, kept for the same
sources and tests, so that it can be stopped; those that survive are printed and written.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from _common import ROOT, environment, write_result

STORE = ROOT / "build" / "mutations.jsonl"
COPIED = ("smsid", "tests", "urdf", "benchmarks", "docs", "examples", "pyproject.toml", "README.md")
LONGEST = 900.0  # [s] of the tests of one mutation


@dataclass(frozen=True)
class Mutation:
    """In ``path``, ``before``, which stands there once, becomes ``after``; ``tests`` ought to fail."""

    what: str
    group: str
    path: str
    before: str
    after: str
    tests: tuple[str, ...]


def mutations() -> list[Mutation]:
    """Return the mutations of the table."""
    table = tomllib.loads((ROOT / "benchmarks" / "mutations.toml").read_text(encoding="utf-8"))
    return [Mutation(**{**row, "tests": tuple(row["tests"])}) for row in table["mutation"]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="stop starting mutations after this long")
    options = parser.parse_args()
    STORE.parent.mkdir(parents=True, exist_ok=True)
    read = STORE.read_text(encoding="utf-8").splitlines() if STORE.is_file() else []
    done = {line["key"]: line for line in map(json.loads, read)}
    begin = time.monotonic()
    rows = []
    with (
        tempfile.TemporaryDirectory(prefix="mutations-") as folder,
        STORE.open("a", encoding="utf-8") as file,
    ):
        copy = Path(folder) / "smsid"
        copied(copy)
        for mutation in mutations():
            key = key_of(mutation)
            if key not in done:
                if time.monotonic() - begin > 60.0 * options.minutes:
                    continue
                done[key] = {"key": key, "what": mutation.what, **noticed(mutation, copy)}
                file.write(json.dumps(done[key]) + "\n")
                file.flush()
                print(f"{done[key]['outcome']:9} {mutation.what} ({mutation.path})", flush=True)
            told = {"what": mutation.what, "group": mutation.group, "path": mutation.path}
            rows.append(told | {"outcome": done[key]["outcome"]})
    result = {
        "environment": environment("pin", "numpy", "scipy"),
        "claim": "the ordinary tests notice planted mutations",
        **counted(rows),
        "of_diagnosis_and_tracking": counted(r for r in rows if r["group"] in ("diagnosis", "tracking")),
        "not_run": len(mutations()) - len(rows),
        "rows": rows,
    }
    print(write_result("mutations", result))
    for row in rows:
        if row["outcome"] != "caught":
            print(f"{row['outcome']}: {row['what']} ({row['path']})")


def counted(rows: Iterable[dict[str, str]]) -> dict[str, int]:
    """Return how many were planted, and how many of these caught."""
    outcomes = [r["outcome"] for r in rows]
    return {"planted": len(outcomes), "caught": outcomes.count("caught")}


def copied(to: Path) -> None:
    """Copy what the tests need, compiled code included, which is as old as its sources."""
    to.mkdir(parents=True)
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, to / name, ignore=shutil.ignore_patterns("results", "api"))
        else:
            shutil.copy2(source, to / name)


def key_of(mutation: Mutation) -> str:
    """Return a digest of a mutation, of the file it is in and of the tests that ought to notice."""
    found = hashlib.sha256(repr(mutation).encode())
    files = [ROOT / mutation.path]
    for test in map(ROOT.joinpath, mutation.tests):
        files += sorted(test.rglob("*.py")) if test.is_dir() else [test]
    for path in files:
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


def planted(mutation: Mutation, text: str) -> str:
    """Return a source with the mutation in it; raises `ValueError` unless its line stands there once."""
    if text.count(mutation.before) != 1:
        times = text.count(mutation.before)
        raise ValueError(f"{mutation.path} has {mutation.before!r} {times} times, not once")
    return text.replace(mutation.before, mutation.after)


def noticed(mutation: Mutation, copy: Path) -> dict[str, object]:
    """Plant a mutation in the copy, run its tests, take it out again."""
    path = copy / mutation.path
    before = path.read_text(encoding="utf-8")
    path.write_text(planted(mutation, before), encoding="utf-8")
    began = time.monotonic()
    try:
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", "not slow", "-p", "no:cacheprovider"]
        run = subprocess.run(
            [*command, *mutation.tests],
            cwd=copy,
            env={**os.environ, "PYTHONPATH": str(copy)},
            capture_output=True,
            text=True,
            timeout=LONGEST,
        )
        # 1: tests failed; 0: all passed; else the tests themselves did not run
        outcome = {0: "survived", 1: "caught"}.get(run.returncode, f"not run ({run.returncode})")
        first = next((x for x in run.stdout.splitlines() if x.startswith(("FAILED", "ERROR"))), "")
    except subprocess.TimeoutExpired:
        outcome, first = "timed out", ""
    finally:
        path.write_text(before, encoding="utf-8")
    return {"outcome": outcome, "by": first[:120], "seconds": round(time.monotonic() - began, 1)}


if __name__ == "__main__":
    main()
