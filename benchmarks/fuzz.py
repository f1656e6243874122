"""The command line takes 2 000 mutated inputs without a traceback, a hang or a crash.

Each runs in a process of its own (forked, the imports are done once). Interrupted, the same command goes on.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import _common
import _fuzz

from smsid._files import atomic_write
from smsid.cli import main as smsid_main

HANG = 60.0  # [s] of processor time
ASLEEP = 120.0  # [s] of time: what has not worked at all for so long waits for ever, a hang, too


def run(seed: int, number: int, folder: Path) -> dict[str, Any]:
    """Run one input in a forked process and return what came of it."""
    case = _fuzz.case(seed, number, folder)
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        _in_child(case, folder, writer)
    os.close(writer)
    slept = False
    worked = -1.0

    def look(*_: Any) -> None:
        nonlocal slept, worked
        now = processor_time(child)
        slept = now <= worked
        if slept:
            os.kill(child, signal.SIGKILL)
        worked = now

    signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, ASLEEP, ASLEEP)
    with os.fdopen(reader, "rb") as stream:
        told = stream.read()
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        hung = slept or os.WTERMSIG(status) == signal.SIGXCPU
        wrong, code = ("hang" if hung else f"crash by signal {os.WTERMSIG(status)}"), -1
        return {"number": number, "kind": case.kind, "code": code, "wrong": wrong, "what": case.what}
    found = json.loads(told)
    return {"number": number, "kind": case.kind, **found, "what": case.what, "words": list(case.words)}


def processor_time(process: int) -> float:
    """Return the processor time [s] a process has used so far."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _in_child(case: _fuzz.Case, folder: Path, writer: int) -> None:
    out, err = io.StringIO(), io.StringIO()
    resource.setrlimit(resource.RLIMIT_CPU, (int(HANG), int(HANG) + 5))
    os.chdir(folder)
    sys.argv = ["smsid", *case.words]
    code = 0
    with redirect_stdout(out), redirect_stderr(err):
        try:
            smsid_main()
        except SystemExit as left:
            code = int(left.code or 0)
        except BaseException as error:  # what the command line let through
            code = 70
            print(f"Traceback of {error!r}", file=sys.stderr)
    wrong = _fuzz.judge(code, out.getvalue(), err.getvalue(), folder)
    last = (err.getvalue().strip().splitlines() or [""])[-1] if wrong else ""
    os.write(writer, json.dumps({"code": code, "wrong": wrong, "last": last[:300]}).encode())
    os._exit(0)


def summary(seed: int, wanted: int, found: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the document of the result."""
    wrong = [x for x in found if x["wrong"]]
    return {
        "claim": "mutated inputs give no traceback, hang or crash, and what is accepted is sound",
        "seed": seed,
        "inputs": {"wanted": wanted, "run": len(found)},
        "kinds": dict(sorted(Counter(x["kind"] for x in found).items())),
        "accepted": sum(x["code"] in (0, 3, 4) for x in found),
        "refused": sum(x["code"] in (1, 2) for x in found),
        "tracebacks": sum(x["wrong"] == "traceback" for x in found),
        "hangs": sum(x["wrong"] == "hang" for x in found),
        "crashes": sum(x["wrong"].startswith("crash") for x in found),
        "unsound": len([x for x in wrong if not x["wrong"].startswith(("traceback", "hang", "crash"))]),
        "wrong": wrong,
        "environment": _common.environment("numpy", "pin", "typer", "pydantic", "h5py", "smsid"),
    }


def commit() -> str:
    """Return the commit that is checked out, marked where files differ: results of another do not count."""
    git = ["git", "-C", str(_common.ROOT)]
    at = subprocess.run([*git, "rev-parse", "--short=12", "HEAD"], capture_output=True, text=True, check=True)
    changed = subprocess.run(
        [*git, "diff", "--quiet", "HEAD", "--", "smsid", "benchmarks/_fuzz.py"], check=False
    )
    return at.stdout.strip() + ("-changed" if changed.returncode else "")


def main() -> None:
    """Run the inputs that are not done yet and write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--inputs", type=int, default=2000)
    parser.add_argument(
        "--seconds", type=float, default=float("inf"), help="stop after; the next call goes on"
    )
    parser.add_argument("--fresh", action="store_true", help="forget what was run")
    parser.add_argument("--output", type=Path, default=_common.RESULTS / "fuzz.json")
    asked = parser.parse_args()
    os.nice(10)
    at = commit()
    lines = Path(tempfile.gettempdir()) / f"smsid_fuzz_{asked.seed}_{at}.jsonl"
    if asked.fresh:
        lines.unlink(missing_ok=True)
    known = lines.read_text(encoding="utf-8").splitlines() if lines.is_file() else []
    found = [json.loads(line) for line in known]
    done = {x["number"] for x in found}
    end = time.monotonic() + asked.seconds
    root = Path(tempfile.mkdtemp(prefix="smsid_fuzz_")).resolve()
    try:
        warm(root)
        for number in range(asked.inputs):
            if number in done or time.monotonic() > end:
                continue
            folder = root / str(number)
            folder.mkdir()
            result = run(asked.seed, number, folder)
            found.append(result)
            with lines.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(result) + "\n")
            if result["wrong"]:
                print(json.dumps(result), flush=True)
            shutil.rmtree(folder, ignore_errors=True)
    finally:
        shutil.rmtree(root, ignore_errors=True)
    atomic_write(
        asked.output, json.dumps({"commit": at, **summary(asked.seed, asked.inputs, found)}, indent=1) + "\n"
    )
    print(f"{len(found)} inputs, {sum(bool(x['wrong']) for x in found)} wrong")


def warm(root: Path) -> None:
    """Import what commands import, so that forked processes need not."""
    folder = root / "warm"
    folder.mkdir()
    _fuzz.write_base(folder)
    here = os.getcwd()
    os.chdir(folder)
    calls = [*_fuzz.CALLS.values(), ["import", "l.csv", "--map", "m.toml", "-o", "w.nc"], ["show", "w.nc"]]
    calls += [["plot", "estimate", "e.json", "-o", "f.png"], ["inspect", "l.csv"]]
    calls += [["control", "d.toml", "e.json", "--samples", "3", "-o", "c.json"]]
    for words in calls:
        sys.argv = ["smsid", *words]
        hidden = io.StringIO()
        with redirect_stdout(hidden), redirect_stderr(hidden):
            try:
                smsid_main()
            except SystemExit as left:
                print(words, left, hidden.getvalue()[-400:], file=sys.__stderr__)
    os.chdir(here)


if __name__ == "__main__":
    main()
