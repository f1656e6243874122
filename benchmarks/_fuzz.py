"""Mutated inputs of the command line, each from its number and a seed, and the rule that judges a run."""

from __future__ import annotations

import copy
import json
import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from _fuzz_files import (
    DESCRIPTION,
    EXPERIMENT,
    MAPPING,
    PLAN,
    URDF,
    estimate,
    log,
    samples,
    write_base,
    write_toml,
)

WEIRD: list[Any] = [
    math.nan, math.inf, -math.inf, -1.0, 0, 0.0, 1e308, 1e-308, -1e-300, 2**62, 1e12, "text", "", True, [],
    [1.0], [0.0, 0.0, 0.0], [1.0] * 4, [math.nan] * 3, {}, {"a": 1}, "x" * 5000, "a b", "\u00fcn\u00ef\u2603",
    "\"quoted'", "<script>alert(1)</script>", "../../../etc/passwd", "/etc/passwd", "a/b", "a.b", "a,b",
    "[bold]x", "%s{0}", -0.0, [[1.0, 2.0, 3.0]], "1.0", "nan", "con", "\u202e", "..", ".", "a\x00b",
]  # fmt: skip
WORDS: list[str] = [
    "-1",
    "0",
    "nan",
    "inf",
    "1e300",
    "",
    "x",
    "a b",
    "$\\frac{$",
    "..",
    "/dev/null",
    "[b]",
    "1,",
]
FILES = ("description", "urdf", "recording", "csv", "experiment", "estimate", "mapping", "samples", "plan")
KINDS = (*FILES, "arguments")


@dataclass(frozen=True)
class Case:
    """One input: files are written in the folder it is run in, ``words`` call the command."""

    number: int
    kind: str
    what: str
    words: tuple[str, ...]


def case(seed: int, number: int, folder: Path) -> Case:
    """Write the files of an input into ``folder`` and return how it is called; numbers decide it."""
    rng = random.Random(f"{seed} {number}")
    kind = KINDS[number % len(KINDS)]
    write_base(folder)
    what, words = MUTATIONS[kind](rng, folder)
    return Case(number, kind, what[:200], tuple(words))


def judge(code: int, stdout: str, stderr: str, folder: Path) -> str:
    """Return what is wrong with a run, or nothing: errors are lines of our own, successes are sound."""
    if code == 70 or "Traceback" in stderr:
        return "traceback"
    left = [p.name for p in folder.rglob("*.tmp")]
    if left:
        return f"left behind: {left[0]}"
    if code in (1, 2):
        says = "error: " in stderr or _faults_told(stdout)  # `check` tells faults of what it is asked about
        return "" if says else "an error that says nothing"
    if code not in (0, 3, 4):
        return f"exit code {code}"
    try:
        found = json.loads(stdout)
    except ValueError:
        return "accepted, and what it prints is no JSON"
    mass = found.get("description", {}).get("mass", found.get("mass", {"value": 1.0}))
    value = mass.get("value") if isinstance(mass, dict) else 1.0
    if not isinstance(value, float) or not 0.0 < value < 1e12:
        return f"accepted with a mass of {value} kg"
    for path in found.get("written", []):
        if not Path(path).exists() or folder not in Path(path).resolve().parents:
            return f"says it wrote {path}"
    if any(p.suffix == ".nc" and p.name == "o.nc" for p in folder.iterdir()):
        return _judge_recording(folder / "o.nc")
    return ""


def _faults_told(stdout: str) -> bool:
    try:
        return bool(json.loads(stdout)["wrong"])
    except (ValueError, KeyError):
        return False


def _judge_recording(path: Path) -> str:
    from smsid.recording import load_recording

    recording = load_recording(path)
    for name in recording.channels:
        if np.isinf(recording[name]).any():
            return f"accepted, and {name} is infinite"
        if np.isnan(recording[name]).any() and not _missing_before(path.with_name("r.nc"), name):
            return f"accepted, and {name} is not a number"
    return ""


def _missing_before(path: Path, name: str) -> bool:
    """Say whether samples of a channel are missing in what was read, too."""
    from smsid.recording import load_recording

    before = load_recording(path)
    return name in before and bool(np.isnan(before[name]).any())


def _places(x: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    items = x.items() if isinstance(x, dict) else enumerate(x) if isinstance(x, list) else ()
    for key, value in items:
        yield (*at, key)
        yield from _places(value, (*at, key))


def mutated(rng: random.Random, tables: Any) -> tuple[str, Any]:
    """Return a copy with one value replaced, removed, scaled or nested, and what was done."""
    made = copy.deepcopy(tables)
    *way, last = rng.choice(list(_places(made)))
    inner = made
    for key in way:
        inner = inner[key]
    name = ".".join(map(str, (*way, last)))
    old = inner[last]
    roll = rng.random()
    if roll < 0.15:
        del inner[last]
        return f"without {name}", made
    if roll < 0.3 and isinstance(old, float):
        factor = rng.choice([1e3, 1e-3, 57.3, -1.0, 1e6, 1e-6, 1e150])
        inner[last] = old * factor
        return f"{name} times {factor}", made
    if roll < 0.38 and isinstance(inner, dict):
        inner[rng.choice(["masss", "folder", "kind2", "\u03c0", "__class__", ""])] = 1.0
        return f"an unknown key beside {name}", made
    inner[last] = copy.deepcopy(rng.choice(WEIRD))
    return f"{name} = {inner[last]!r}", made


def shaken(rng: random.Random, text: str) -> tuple[str, bytes]:
    """Return a text with bytes replaced, removed or cut, and what was done."""
    data = bytearray(text.encode())
    roll = rng.random()
    if roll < 0.1:
        return "cut short", bytes(data[: rng.randrange(len(data))])
    if roll < 0.2:
        return "another file", rng.choice(
            [b"", b"[]", b"null", b"[" * 100_000, bytes(range(256)), b"1", b'{"kind": []}']
        )
    for _ in range(rng.choice([1, 2, 6])):
        k = rng.randrange(len(data))
        if rng.random() < 0.5:
            data[k] = rng.choice(b'<>"&/=0 -e\n9[]{},.\x00\xff')
        else:
            del data[k : k + rng.randrange(1, 30)]
    return "bytes changed", bytes(data)


CALLS = {
    "show": ["show", "d.toml"],
    "simulate": ["simulate", "d.toml", "s.toml", "-o", "o.nc"],
    "export": ["export", "d.toml", "-o", "ex"],
    "view": ["view", "d.toml", "-o", "v.html"],
}
OF_RECORDINGS = [
    ["cut", "r.nc", "--from", "0.1", "--to", "0.3", "-o", "o.nc"],
    ["cut", "r.nc", "--pieces", "-o", "o.nc"],
    ["resample", "r.nc", "--rate", "50", "-o", "o.nc"],
    ["convert", "r.nc", "-o", "c.csv"],
    ["track", "d.toml", "r.nc", "--changes", "-o", "t.nc"],
    ["diagnose", "d.toml", "r.nc", "-o", "g.json"],
]
STREAM = ["stream", "d.toml", "p.jsonl", "--begin", "0.2"]
CAMPAIGN = ["campaign", "c.toml", "--backend", "serial", "-o", "w.jsonl"]
OF_TESTS = [
    ["play", "r.nc"],
    ["lab", "modal", "r.nc", "--highest", "20", "--free-decay", "-o", "k.json"],
    ["lab", "oscillator", "r.nc", "--output-channel", "encoder.joint_position", "-o", "k.json"],
]
OF_DESCRIPTIONS = [
    ["check", "d.toml"],
    ["export", "d.toml", "--fmu", "f.fmu"],
    ["regressor", "d.toml"],
    ["new", "craft", "--panel", "2x1"],
]


def _of_toml(
    rng: random.Random, path: Path, tables: dict[str, Any], calls: list[list[str]]
) -> tuple[str, list[str]]:
    """Write a TOML with one value changed, or its text shaken, and choose a command that reads it."""
    if rng.random() < 0.15:
        what, data = shaken(rng, tomli_w.dumps(tables))
        path.write_bytes(data)
    else:
        what, changed = mutated(rng, tables)
        write_toml(path, changed)
    return what, [*rng.choice(calls), "--json"]


def _description(rng: random.Random, folder: Path) -> tuple[str, list[str]]:
    calls = [*CALLS.values(), CALLS["show"], *OF_DESCRIPTIONS[:3]]
    return _of_toml(rng, folder / "d.toml", DESCRIPTION, calls)


def _urdf(rng: random.Random, folder: Path) -> tuple[str, list[str]]:
    import re

    if rng.random() < 0.3:
        what, data = shaken(rng, URDF)
        (folder / "small.urdf").write_bytes(data)
    else:
        hit = rng.choice(list(re.finditer(r'(\w+)="([^"]*)"', URDF)))
        values = [
            "-5",
            "0",
            "nan",
            "inf",
            "1e400",
            "",
            "abc",
            " 10 ",
            "10,5",
            "1 2",
            "0 0 0",
            "a b",
            "a/b",
            "bus",
            "1e308",
        ]
        value = rng.choice(values)
        what = f"{hit[0]} -> {value!r}"
        text = f"{URDF[: hit.start(2)]}{value}{URDF[hit.end(2) :]}"
        (folder / "small.urdf").write_text(text, encoding="utf-8")
    return what, [*rng.choice([*CALLS.values(), CALLS["show"], *OF_DESCRIPTIONS[:3]]), "--json"]


def _recording(rng: random.Random, folder: Path) -> tuple[str, list[str]]:
    path = folder / "r.nc"
    data = bytearray(path.read_bytes())
    roll = rng.random()
    if roll < 0.3:
        import h5py

        with h5py.File(path, "r+") as file:
            name = rng.choice(sorted(file))
            value: Any = rng.choice([math.nan, math.inf, 1e300, 0.0, -1.0])
            what = f"{name} = {value}"
            if file[name].dtype.kind == "f":  # type: ignore[union-attr]
                file[name][...] = value  # type: ignore[index]
            else:
                del file[name]
    elif roll < 0.5:
        import h5py

        with h5py.File(path, "r+") as file:
            name = rng.choice(sorted(file.attrs))
            value = rng.choice(["", "{", 5, "[]", '{"a": "<script>"}', 99])
            what = f"attribute {name} = {value!r}"
            file.attrs[name] = value
    elif roll < 0.6:
        what, cut = "cut short", data[: rng.randrange(len(data))]
        path.write_bytes(cut)
    else:
        what = "bytes flipped"
        for _ in range(rng.choice([1, 20])):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(data)
    calls = [
        ["show", "r.nc"],
        ["view", "d.toml", "r.nc", "-o", "v.html"],
        ["plot", "recording", "r.nc", "-o", "f.png"],
    ]
    calls += [["identify", "d.toml", "r.nc", "-o", "i.json"], ["inspect", "r.nc"], *OF_RECORDINGS, *OF_TESTS]
    return what, [*rng.choice(calls), "--json"]


def _csv(rng: random.Random, folder: Path) -> tuple[str, list[str]]:
    if rng.random() < 0.4:
        what, data = shaken(rng, log())
        (folder / "l.csv").write_bytes(data)
    else:
        rows = [line.split(",") for line in log().splitlines()]
        row, column = rng.randrange(len(rows)), rng.randrange(5)
        rows[row][column] = rng.choice(
            ["nan", "inf", "", "x", "9" * 200_000, "1e400", "1e300", "0x1", "-", '"', "2024-01-01"]
        )
        what = f"cell {row}, {column} = {rows[row][column][:20]!r}"
        (folder / "l.csv").write_text("\n".join(",".join(r) for r in rows) + "\n", encoding="utf-8")
    calls = [["import", "l.csv", "--map", "m.toml", "-o", "o.nc"], ["inspect", "l.csv"]]
    return what, [*rng.choice([*calls, ["inspect", "l.csv", "--with", "m.toml"]]), "--json"]


def _experiment(rng: random.Random, folder: Path) -> tuple[str, list[str]]:
    what, tables = mutated(rng, EXPERIMENT)
    long = isinstance(tables.get("duration"), int | float) and tables["duration"] > 100.0
    if rng.random() < 0.15 or long:
        what, data = shaken(rng, tomli_w.dumps(EXPERIMENT))
        (folder / "s.toml").write_bytes(data)
    else:
        write_toml(folder / "s.toml", tables)
    return what, [*rng.choice([CALLS["simulate"], ["show", "s.toml"]]), "--json"]


def _estimate(rng: random.Random, folder: Path) -> tuple[str, list[str]]:
    if rng.random() < 0.2:
        what, data = shaken(rng, json.dumps(estimate()))
        (folder / "e.json").write_bytes(data)
    else:
        what, document = mutated(rng, estimate())
        (folder / "e.json").write_text(json.dumps(document), encoding="utf-8")
    calls = [
        ["show", "e.json"],
        ["export", "d.toml", "e.json", "-o", "ex"],
        ["plot", "estimate", "e.json", "-o", "f.png"],
    ]
    calls += [
        ["compare", "e.json", "e.json", "-o", "n.json"],
        ["plot", "diagnosis", "e.json", "-o", "f.png"],
        ["control", "d.toml", "e.json", "--samples", "3", "-o", "c.json"],
    ]
    return what, [*rng.choice(calls), "--json"]


def _mapping(rng: random.Random, folder: Path) -> tuple[str, list[str]]:
    calls = [["import", "l.csv", "--map", "m.toml", "-o", "o.nc"], ["inspect", "l.csv", "--with", "m.toml"]]
    return _of_toml(rng, folder / "m.toml", MAPPING, calls)


def _samples(rng: random.Random, folder: Path) -> tuple[str, list[str]]:
    if rng.random() < 0.3:
        what, data = shaken(rng, samples())
    else:
        lines = [json.loads(line) for line in samples().splitlines()]
        what, lines = mutated(rng, lines)
        data = "".join(json.dumps(x) + "\n" for x in lines).encode()
    (folder / "p.jsonl").write_bytes(data)
    return what, [*STREAM, *rng.choice([[], ["--changes"]]), "--json"]


def _plan(rng: random.Random, folder: Path) -> tuple[str, list[str]]:
    return _of_toml(rng, folder / "c.toml", PLAN, [CAMPAIGN, ["show", "c.toml"]])


def _arguments(rng: random.Random, folder: Path) -> tuple[str, list[str]]:
    from smsid.cli.app import COMMANDS

    calls = [*CALLS.values(), ["import", "l.csv", "--map", "m.toml", "-o", "o.nc"], ["inspect", "l.csv"]]
    calls += [
        ["control", "d.toml", "e.json", "--samples", "3", "-o", "c.json"],
        ["plot", "estimate", "e.json", "-o", "f.png"],
    ]
    calls += [["design", "d.toml", "--for", "mass", "--effort", "0.01", "--duration", "1", "-o", "x.toml"]]
    calls += [*OF_RECORDINGS, *OF_DESCRIPTIONS, ["compare", "e.json", "e.json"]]
    calls += [["identify", "d.toml", "r.nc", "-o", "i.json"], STREAM, CAMPAIGN, *OF_TESTS]
    words = list(rng.choice(calls))
    command = COMMANDS[words[0]].load(words[0])
    command = getattr(command, "commands", {}).get(words[1], command)
    options = [p.opts[0] for p in command.params if p.opts and p.opts[0].startswith("--")]
    roll = rng.random()
    if roll < 0.6:
        words += [rng.choice(options), rng.choice(WORDS)]
    elif roll < 0.8:
        words[rng.randrange(1, len(words))] = rng.choice(
            [*WORDS, ".", "d.toml", "l.csv", "e.json", "y" * 5000]
        )
    elif roll < 0.9:
        k = rng.randrange(1, len(words))
        words[1], words[k] = words[k], words[1]
    else:
        del words[rng.randrange(len(words))]
    if "--live" in words or "demo" in words or "--help" in words:
        words = ["show", "x"]
    return " ".join(words), [*words, "--json"]


MUTATIONS: dict[str, Callable[[random.Random, Path], tuple[str, list[str]]]] = {
    "description": _description,
    "urdf": _urdf,
    "recording": _recording,
    "csv": _csv,
    "experiment": _experiment,
    "estimate": _estimate,
    "mapping": _mapping,
    "samples": _samples,
    "plan": _plan,
    "arguments": _arguments,
}
