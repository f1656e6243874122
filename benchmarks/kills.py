"""Commands killed (SIGKILL) at random moments leave whole files, and the next run tidies up.

Every command that writes runs beside the files of an earlier run. Whatever is found after the kill is read
again: each output is the old file or a whole new one, each input what it was. The same command then runs to
its end and leaves no temporary file. Rows are kept in ``build/``, so that it can be stopped.
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
PLAN = {
    "name": "cheap",
    "description": "d.toml",
    "runs": 3,
    "seed": 7,
    "method": "cheap_method:measure",
    "truth": [{"parameters": ["tank.mass"], "relative": 0.1}],
}
METHOD = (_common.ROOT / "tests" / "campaign" / "cheap.py").read_text(encoding="utf-8")
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
    "diagnose": (["diagnose", "d.toml", "r.nc"], ["diagnosis.json"]),
    "stream": (["stream", "d.toml", "lines.jsonl", "--save", "live.npz"], ["live.npz"]),
    "new": (["new", "craft", "--panel", "2x1"], ["craft.toml", "craft_bus.urdf"]),
    "campaign": (["campaign", "plan.toml", "--backend", "serial", "-q"], ["runs.jsonl", "runs.summary.json"]),
    "lab oscillator": (
        ["lab", "oscillator", "lab.nc", "--frequency", "1.4", "--damping", "0.2"],
        ["oscillator.json"],
    ),
    "lab modal": (
        ["lab", "modal", "lab.nc", "--highest", "5", "--channel", "extra.output"],
        ["modes.json"],
    ),
    "lab tank": (
        ["lab", "tank", "lab.nc", "--force", "hand.force.y", "--position", "pose.position.y"],
        ["tank.json"],
    ),
}
FRESH = {"export": ["exported"], **{name: CALLS[name][1] for name in ("new", "campaign")}}
"""What is removed before a command runs: it takes a new folder or name only, or would find all done."""
OWN_PLACE = ("new", "stream")
"""Commands that write where they are told without ``-o``."""


def words(name: str) -> list[str]:
    """Return the words of a call, with its first output after ``-o`` where they do not name it yet."""
    call, outputs = CALLS[name]
    named = name in OWN_PLACE or outputs[0] in call or "-o" in call
    return call if named else [*call, "-o", outputs[0]]


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


def make_room(name: str, folder: Path) -> None:
    """Remove what a command would not write again."""
    for path in FRESH.get(name, []):
        shutil.rmtree(folder / path, ignore_errors=True)
        (folder / path).unlink(missing_ok=True)


def finished(name: str, folder: Path) -> int:
    """Run a command to its end and return its exit code."""
    make_room(name, folder)
    return os.waitstatus_to_exitcode(os.waitpid(started(words(name), folder), 0)[1])


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
        if name not in now:
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
        make_room(name, folder)
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
        code = finished(name, folder)
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


def _write_lab(path: Path) -> None:
    """Write a driven oscillator, its vibration in two places, and a force on a container."""
    import numpy as np
    from scipy.signal import StateSpace, lsim

    from smsid.recording import Recording, save_recording

    rng, times, w = np.random.default_rng(1), 0.02 * np.arange(3000), 2.0 * np.pi * 1.5
    drive = rng.normal(size=times.size)
    motion = StateSpace([[0.0, 1.0], [-w * w, -0.04 * w]], [[0.0], [w * w]], [[1.0, 0.0]], [[0.0]])
    answer = lsim(motion, drive, times)[1]
    # a container of 9 kg that carries 2 kg on a spring is moved, and rings down
    w = 6.0
    place = np.where(times < 40.0 * np.pi / 6.0, 0.02 * (1.0 - np.cos(3.0 * times)), 0.0)
    pushed = np.where(place > 0.0, 0.18 * np.cos(3.0 * times), 0.0)  # acceleration of the place
    swing = StateSpace([[0.0, 1.0], [-w * w, -0.04 * w]], [[0.0], [-1.0]], [[-w * w, -0.04 * w]], [[0.0]])
    none = np.zeros_like(times)
    force = 9.0 * pushed + 2.0 * (pushed + lsim(swing, pushed, times)[1]) + 0.01 * rng.normal(size=times.size)
    channels = {
        "extra.input": drive,
        "extra.output": answer,
        "hand.force": np.stack([none, force, none], 1),
        "pose.position": np.stack([none, place, none], 1),
    }
    units = {"extra.input": "V", "extra.output": "m"}
    save_recording(Recording.from_arrays(times, channels, units=units), path)


def _write_lines(base: Path) -> None:
    with (base / "lines.jsonl").open("w") as stream:
        child = os.fork()
        if not child:
            os.chdir(base)
            os.dup2(stream.fileno(), 1)
            sys.argv = ["smsid", "play", "r.nc"]
            smsid_main()
            sys.stdout.flush()
            os._exit(0)
        os.waitpid(child, 0)


def prepared(base: Path) -> dict[str, float]:
    """Run every command once into ``base`` and return how long each took [s]."""
    _fuzz.write_base(base)
    (base / "s.toml").write_text(tomli_w.dumps(EXPERIMENT), encoding="utf-8")
    craft = {**_fuzz.DESCRIPTION, "sensor": [*_fuzz.DESCRIPTION["sensor"], POSE]}
    (base / "d.toml").write_text(tomli_w.dumps(craft), encoding="utf-8")
    _write_lab(base / "lab.nc")
    (base / "cheap_method.py").write_text(METHOD, encoding="utf-8")
    (base / "plan.toml").write_text(tomli_w.dumps(PLAN), encoding="utf-8")
    lasts = {}
    for name in CALLS:
        if name == "stream":
            _write_lines(base)
        finished(name, base)  # caches are filled
        begin = time.monotonic()
        code = finished(name, base)
        lasts[name] = time.monotonic() - begin
        if code not in (0, 3, 4):
            raise SystemExit(f"{name} ended with {code}: {(base / 'said.log').read_text()[-1000:]}")
    return lasts


def main() -> None:
    """Kill, judge, and write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--minutes", type=float, default=60.0, help="of time; the next call goes on")
    parser.add_argument("--output", type=Path, default=_common.RESULTS / "kills.json")
    asked = parser.parse_args()
    end = time.monotonic() + 60.0 * asked.minutes
    kept = _common.ROOT / "build" / f"kills_{asked.seed}.jsonl"
    kept.parent.mkdir(exist_ok=True)
    found = [json.loads(line) for line in kept.read_text().splitlines()] if kept.is_file() else []
    base = Path(tempfile.mkdtemp(prefix="smsid_kills_base_")).resolve()
    try:
        lasts = prepared(base)
        for number in range(len(found), asked.kills):
            if time.monotonic() > end:
                break
            found.append(killed(asked.seed, number, base, lasts))
            with kept.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(found[-1]) + "\n")
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
