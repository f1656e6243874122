"""What every benchmark needs: a record of the machine, interleaved timing, and writing the result."""

from __future__ import annotations

import datetime
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
RESULTS = Path(__file__).resolve().parent / "results"
sys.path.insert(0, str(ROOT))  # the checkout wins over an installed smsid

from smsid._files import atomic_write  # noqa: E402


def environment(*packages: str) -> dict[str, Any]:
    """Return CPU model, cores, load, system, Python, and the versions of the packages that are installed."""
    versions = {}
    for package in packages:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "not installed"
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "load average": round(os.getloadavg()[1], 1),  # of five minutes
        "system": platform.system(),
        "python": platform.python_version(),
        "versions": versions,
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
    }


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def commit(tree: Path) -> str:
    """Return the commit of a checkout."""
    asked = ["git", "-C", str(tree), "rev-parse", "--short=8", "HEAD"]
    return subprocess.run(asked, capture_output=True, check=True, text=True).stdout.strip()


def rows_by_seed(
    store: Path, run: Callable[[int], dict[str, Any]], seeds: int, minutes: float, told: Callable[..., object]
) -> list[dict[str, Any]]:
    """Return a row of each seed, kept in ``store`` by the commit of the sources; stop after some minutes."""
    store.parent.mkdir(exist_ok=True)
    sources, end = commit(ROOT), time.monotonic() + 60.0 * minutes
    every = [json.loads(line) for line in store.read_text().splitlines()] if store.exists() else []
    rows = [r for r in every if r["commit"] == sources]
    for seed in sorted(set(range(seeds)) - {r["seed"] for r in rows}):
        if time.monotonic() > end:
            break
        rows.append(run(seed) | {"commit": sources})
        with store.open("a", encoding="utf-8") as file:
            file.write(json.dumps(rows[-1]) + "\n")
        print(seed, told(rows[-1]), flush=True)
    return rows


def interleaved(functions: Mapping[str, Callable[[], Any]], rounds: int) -> dict[str, np.ndarray]:
    """Time functions in turn, ``rounds`` times after one warm-up: seconds of each call, (rounds,) by name."""
    for function in functions.values():
        function()
    seconds: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(rounds):
        for name, function in functions.items():
            begin = time.perf_counter()
            function()
            seconds[name].append(time.perf_counter() - begin)
    return {name: np.array(values) for name, values in seconds.items()}


def spread(values: np.ndarray) -> dict[str, float]:
    """Return median and quartiles, to four digits."""
    low, middle, high = np.percentile(values, [25, 50, 75])
    return {"median": _digits(middle), "quartile_25": _digits(low), "quartile_75": _digits(high)}


def relative_error(found: np.ndarray, expected: np.ndarray) -> float:
    """Return the largest deviation, relative to the largest expected magnitude."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def write_result(name: str, result: Mapping[str, Any]) -> Path:
    """Write ``results/<name>.json``, whole or not at all."""
    RESULTS.mkdir(exist_ok=True)
    return atomic_write(RESULTS / f"{name}.json", json.dumps(result, indent=1, allow_nan=False) + "\n")


def _digits(x: float) -> float:
    return float(f"{x:.4g}")
