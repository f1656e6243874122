"""Commands killed (SIGKILL) at random moments leave whole files, and the next run tidies up.

Every command that writes runs beside the files of an earlier run. Whatever is found after the kill is read
again: each output is the old file or a whole new one, each input what it was. The same command then runs to
its end and leaves no temporary file.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import tomllib
import zipfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import _common
import _fuzz
import tomli_w

from smsid._files import atomic_write
from smsid.cli import main as smsid_main

EXPERIMENT = {**_fuzz.EXPERIMENT, "duration": 4.0, "joints": [0.2]}
EXPERIMENT["force"] = {"kind": "steps", "times": [0.0, 2.0], "values": [[5.0, 3.0, 1.0], [-5.0, 0.0, 2.0]]}
POSE = {"name": "pose", "kind": "pose", "preset": "reference"}  # attitudes, for the controller
# each by what it is called with; in this order, as later ones read what earlier ones wrote
CALLS: dict[str, tuple[list[str], list[str]]] = {
    "simulate": (["simulate", "d.toml", "s.toml", "--save-experiment", "saved.toml"], ["r.nc", "saved.toml"]),
    "import": (["import", "l.csv", "--map", "m.toml"], ["imported.nc"]),
    "inspect": (["inspect", "l.csv", "--map", "draft.toml"], ["draft.toml"]),
    "cut": (["cut", "r.nc", "--from", "1", "--to", "3"], ["cut.nc"]),
    "resample": (["resample", "r.nc", "--rate", "20"], ["slow.nc"]),
    "convert": (["convert", "r.nc"], ["table.csv", "table.toml"]),
    "identify": (
        ["identify", "d.toml", "slow.nc", "--cad", "0.05", "--report", "e.html"],
        ["found.json", "e.html"],
    ),
    "compare": (["compare", "e.json", "found.json", "--report", "k.html"], ["compared.json", "k.html"]),
    "track": (
        ["track", "d.toml", "slow.nc", "--estimate", "found.json", "--save", "t.npz"],
        ["track.nc", "t.npz"],
    ),
    "track --changes": (["track", "d.toml", "slow.nc", "--changes"], ["changes.nc"]),
    "cut --pieces": (["cut", "r.nc", "--from", "1", "--pieces", "-o", "piece.nc"], ["piece_1.nc"]),
    "export": (["export", "d.toml"], ["exported"]),
    "export --fmu": (["export", "d.toml", "--fmu", "f.fmu"], ["f.fmu"]),
    "view": (["view", "d.toml", "r.nc"], ["v.html"]),
    "plot": (["plot", "recording", "r.nc"], ["f.png"]),
    "design": (
        ["design", "d.toml", "--for", "mass", "--effort", "0.01", "--duration", "1"],
        ["designed.toml"],
    ),
    "control": (["control", "d.toml", "found.json", "--samples", "20"], ["controller.json"]),
}


def words(name: str) -> list[str]:
    """Return the words of a call, with its first output after ``-o`` where they do not name it yet."""
    call, outputs = CALLS[name]
    return call if outputs[0] in call or "-o" in call else [*call, "-o", outputs[0]]


def started(call: Sequence[str], folder: Path) -> int:
    """Fork, run a command in ``folder`` without a word on the terminal, and return the child's number."""
    child = os.fork()
    if child:
        return child
    os.chdir(folder)
    sys.argv = ["smsid", *call]
    with open("said.log", "a") as said:
        os.dup2(said.fileno(), 1)
        os.dup2(said.fileno(), 2)
        code = 0
        try:
            smsid_main()
        except SystemExit as left:
            code = int(left.code or 0)
        except BaseException as error:
            code = 70
            print(repr(error), file=sys.stderr)
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def finished(call: Sequence[str], folder: Path) -> int:
    """Run a command to its end and return its exit code; an export goes into a new folder only."""
    if call[0] == "export":
        shutil.rmtree(folder / "exported", ignore_errors=True)
    return os.waitstatus_to_exitcode(os.waitpid(started(call, folder), 0)[1])


def contents(folder: Path) -> dict[str, bytes]:
    """Return every file under a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def _recording(path: Path) -> None:
    from smsid.recording import load_recording

    load_recording(path)


def _netcdf(path: Path) -> None:
    import xarray

    xarray.load_dataset(path, engine="h5netcdf")


def _page(path: Path) -> None:
    if not path.read_text(encoding="utf-8").rstrip().endswith("</html>"):
        raise ValueError("the page has no end")


def _picture(path: Path) -> None:
    if not path.read_bytes().endswith(b"IEND\xaeB`\x82"):
        raise ValueError("the picture has no end")


def _table(path: Path) -> None:
    rows = path.read_text(encoding="utf-8").splitlines()
    if not path.read_bytes().endswith(b"\n") or len({r.count(",") for r in rows}) != 1:
        raise ValueError("the table is cut short")


def _zip(path: Path) -> None:
    with zipfile.ZipFile(path) as file:
        if file.testzip() is not None:
            raise ValueError("a member is damaged")


def _archive(path: Path) -> None:
    import numpy as np

    with np.load(path) as file:
        for name in file.files:
            file[name]


SOUND: dict[str, Callable[[Path], Any]] = {
    ".nc": _recording,
    ".toml": lambda p: tomllib.loads(p.read_text(encoding="utf-8")),
    ".json": lambda p: json.loads(p.read_text(encoding="utf-8")),
    ".html": _page,
    ".png": _picture,
    ".csv": _table,
    ".npz": _archive,
    ".fmu": _zip,
}


def judged(folder: Path, before: dict[str, bytes], outputs: Sequence[str]) -> str:
    """Return what a killed command damaged, or nothing."""
    now = contents(folder)
    for name, old in before.items():
        if name not in now and not name.startswith("exported"):
            return f"{name} is gone"
        if name in now and now[name] != old:
            if name.split("/")[0] not in outputs and name != "said.log":
                return f"{name}, which it did not write, changed"
            path = folder / name
            check = _netcdf if name in ("track.nc", "changes.nc") else SOUND.get(path.suffix)
            try:
                if check is not None:
                    check(path)
            except Exception as error:
                return f"{name} is damaged: {error!r}"
    return ""


def killed(seed: int, number: int, base: Path, lasts: dict[str, float]) -> dict[str, Any]:
    """Kill one command at a random moment in a copy of ``base`` and return what came of it."""
    rng = random.Random(f"{seed} {number}")
    name = list(CALLS)[number % len(CALLS)]
    after = rng.uniform(0.0, 1.05) * lasts[name]
    folder = Path(tempfile.mkdtemp(prefix="smsid_kills_")).resolve()
    try:
        shutil.copytree(base, folder, dirs_exist_ok=True)
        if name == "export":
            shutil.rmtree(folder / "exported", ignore_errors=True)
        before = contents(folder)
        child = started(words(name), folder)
        time.sleep(after)
        os.kill(child, signal.SIGKILL)
        ended = not os.WIFSIGNALED(os.waitpid(child, 0)[1])
        wrong = judged(folder, before, CALLS[name][1])
        whole = set(contents(base / "exported")) if (base / "exported").exists() else set()
        if name == "export" and (folder / "exported").exists():
            lost = whole - set(contents(folder / "exported"))
            wrong = f"the folder lacks {sorted(lost)}" if lost else wrong
        halves = [p.name for p in folder.rglob("*.tmp")]
        code = finished(words(name), folder)
        left = [p.name for p in folder.rglob("*.tmp")]
        if not wrong and code not in (0, 3, 4):
            wrong = f"the next run ended with {code}: {(folder / 'said.log').read_text()[-300:]}"
        if not wrong and left:
            wrong = f"the next run left {left[0]}"
        return {
            "number": number,
            "command": name,
            "after": round(after, 3),
            "ended": ended,
            "wrong": wrong,
        } | {"temporary_after_kill": len(halves)}
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def prepared(base: Path) -> dict[str, float]:
    """Run every command once into ``base`` and return how long each took [s]."""
    _fuzz.write_base(base)
    (base / "s.toml").write_text(tomli_w.dumps(EXPERIMENT), encoding="utf-8")
    craft = {**_fuzz.DESCRIPTION, "sensor": [*_fuzz.DESCRIPTION["sensor"], POSE]}
    (base / "d.toml").write_text(tomli_w.dumps(craft), encoding="utf-8")
    lasts = {}
    for name in CALLS:
        finished(words(name), base)  # caches are filled
        begin = time.monotonic()
        code = finished(words(name), base)
        lasts[name] = time.monotonic() - begin
        if code not in (0, 3, 4):
            raise SystemExit(f"{name} ended with {code}: {(base / 'said.log').read_text()[-1000:]}")
    return lasts


def main() -> None:
    """Kill, judge, and write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--output", type=Path, default=_common.RESULTS / "kills.json")
    asked = parser.parse_args()
    base = Path(tempfile.mkdtemp(prefix="smsid_kills_base_")).resolve()
    try:
        lasts = prepared(base)
        found = []
        for number in range(asked.kills):
            found.append(killed(asked.seed, number, base, lasts))
            if found[-1]["wrong"]:
                print(json.dumps(found[-1]), flush=True)
    finally:
        shutil.rmtree(base, ignore_errors=True)
    wrong = [x for x in found if x["wrong"]]
    document = {
        "claim": "a killed command leaves no half-written file, and the next run no temporary one",
        "seed": asked.seed,
        "kills": len(found),
        "killed_while_running": sum(not x["ended"] for x in found),
        "temporary_files_after_kill": sum(x["temporary_after_kill"] for x in found),
        "commands": dict(sorted(Counter(x["command"] for x in found).items())),
        "wrong": wrong,
        "environment": _common.environment("numpy", "pin", "h5py", "smsid"),
    }
    atomic_write(asked.output, json.dumps(document, indent=1) + "\n")
    print(f"{len(found)} kills, {len(wrong)} wrong")


if __name__ == "__main__":
    main()
