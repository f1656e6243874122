"""What each command spends its time on, the whole process: ``python benchmarks/command_profile.py``.

Of some commands alone, what they need first: ``... "simulate exp2" view``. Rows of the others are kept.

On the paper's craft: imports, the search for an excitation, building models, writing, and the work itself, in
shares of the time. Categories are cumulative times of the functions that do them (`PARTS`), by cProfile,
which slows Python code down: shares, not seconds. What is above a fifth beside the work is named. The
processor time of the whole process is measured beside it, without a profile: the median of three runs.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import pstats
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from _common import ROOT, environment, write_result

CRAFT = ROOT / "urdf" / "paper_sms.toml"
COMMANDS = {
    "simulate exp1": "simulate {craft} exp1 -o exp1.nc --seed 1",
    "simulate exp2": "simulate {craft} exp2 -o exp2.nc --seed 2",
    "identify": "identify {craft} exp1.nc exp2.nc -o estimate.json",
    "show": "show estimate.json",
    "diagnose": "diagnose {craft} exp2.nc --estimate estimate.json -o diagnosis.json",
    "control": "control {craft} estimate.json -o controller.json",
    "track": "track {craft} exp2.nc -o track.nc",
    "view": "view {craft} exp2.nc -o exp2.html",
    "export": "export {craft} estimate.json -o exported_{{turn}}",
}
TURNS = itertools.count()  # of commands that write into a new folder
VERDICTS = (3, 4)  # exit codes of a diagnosis that is told, but not explained or not evaluated
RUNNER = """
import cProfile, runpy, sys
out, profile = sys.argv.pop(1), cProfile.Profile()
try:
    profile.runcall(runpy.run_module, "smsid", run_name="__main__", alter_sys=True)
finally:
    profile.dump_stats(out)
"""  # as python -m cProfile, which takes any exit code for 0
PARTS = {
    "imports": ("_find_and_load",),
    "excitation": ("fourier_experiment",),
    "models": ("build_model", "rebuild"),
    "writing": ("save_recording", "atomic_write", "atomic_path"),
}


def run(python: list[str], arguments: list[str], folder: Path, cache: Path) -> float:
    """Return processor time [s] of a command, of user and system; one that fails ends the benchmark."""
    own = {"SMSID_CACHE": str(cache), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    arguments = [x.format(turn=next(TURNS)) for x in arguments]
    spent = _children()
    done = subprocess.run(
        [sys.executable, *python, *arguments],
        cwd=folder,
        env={**{k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}, **own},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    if done.returncode not in (0, *(VERDICTS if arguments[0] == "diagnose" else ())):
        raise SystemExit(f"smsid {' '.join(arguments)} ended with {done.returncode}:\n{done.stderr}")
    return _children() - spent


def _children() -> float:
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def cpu_seconds(arguments: list[str], folder: Path, cache: Path) -> float:
    """Return the median processor time [s] of three runs, byte code and kernels compiled before."""
    return statistics.median([run(["-m", "smsid"], arguments, folder, cache) for _ in range(4)][1:])


def profiled(arguments: list[str], folder: Path, cache: Path) -> pstats.Stats:
    """Return the profile of a command, its imports included."""
    out = folder / "profile.out"
    run(["-c", RUNNER, str(out)], arguments, folder, cache)
    return pstats.Stats(str(out))


def share_of(stats: pstats.Stats, names: tuple[str, ...]) -> float:
    """Return the share of all time that functions take with what they call; nested calls count once."""
    own = {key: row for key, row in stats.stats.items() if key[2] in names}
    if len(names) == 1:  # of a function that calls itself the cumulative time is that of the outermost calls
        return sum(row[3] for row in own.values()) / stats.total_tt
    # from outside of the group alone: what one of them calls of the others is in its time already
    spent = sum(caller[3] for row in own.values() for key, caller in row[4].items() if key[2] not in names)
    return spent / stats.total_tt


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("commands", nargs="*", metavar="COMMAND", help=", ".join(COMMANDS))
    chosen = parser.parse_args().commands or list(COMMANDS)
    file = ROOT / "benchmarks" / "results" / "command_profile.json"
    rows = json.loads(file.read_text())["commands"] if file.is_file() else {}
    earlier = set(rows)
    with tempfile.TemporaryDirectory(prefix="profile-") as name:
        folder = Path(name)
        for label, command in COMMANDS.items():
            if label not in chosen:
                continue
            arguments = command.format(craft=CRAFT).split()
            spent = cpu_seconds(arguments, folder, folder / "cache")
            stats = profiled(arguments, folder, folder / f"of {label}")  # an excitation is searched for anew
            shares = {part: round(share_of(stats, names), 3) for part, names in PARTS.items()}
            shares["work"] = round(max(0.0, 1.0 - sum(shares.values())), 3)
            load = round(os.getloadavg()[0], 1)
            seconds = {"cpu_seconds": round(spent, 2), "seconds_profiled": round(stats.total_tt, 2)}
            rows[label] = {**seconds, **shares, "load average": load}
            earlier.discard(label)
            print(label, json.dumps(rows[label]), flush=True)
            above = [f"{c}: {p}" for c, row in rows.items() for p in PARTS if row[p] > 0.2]
            found = {"commands": rows, "above_a_fifth": above, "of_an_earlier_run": sorted(earlier)}
            write_result("command_profile", {"environment": environment("pin", "numpy", "scipy"), **found})


if __name__ == "__main__":
    main()
