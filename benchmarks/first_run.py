"""From a fresh clone to the demonstration's report, as README says it: one command, how long.

python benchmarks/first_run.py

Clones the checkout's last commit into a folder that is removed again, and gives `make demo` there, without
anything of this environment. Processor time is that of everything started; what it waits for, downloads above
all, shows in the wall clock alone.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path

from _common import RESULTS, ROOT, atomic_write, environment

KEPT = ("HOME", "PATH", "LANG", "PIP_INDEX_URL", "PIP_EXTRA_INDEX_URL", "PIP_CONFIG_FILE", "SSL_CERT_FILE")


def own_environment() -> dict[str, str]:
    """Return the environment of somebody new: no virtual environment, no data of the project."""
    kept = {k: v for k, v in os.environ.items() if k in KEPT}
    active = os.environ.get("VIRTUAL_ENV")
    if active:
        folders = kept["PATH"].split(os.pathsep)
        kept["PATH"] = os.pathsep.join(x for x in folders if not x.startswith(active))
    return kept


def main() -> None:
    with tempfile.TemporaryDirectory() as place:
        clone = Path(place) / "smsid"
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        load, start = os.getloadavg()[0], time.perf_counter()
        done = subprocess.run(
            ["make", "demo"], cwd=clone, env=own_environment(), capture_output=True, text=True, check=False
        )
        wall = time.perf_counter() - start
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        report = clone / "demo-out" / "report.html"
        result = {
            "environment": environment("pin", "numpy", "scipy"),
            "commands after the clone": 1,
            "exit code": done.returncode,
            "report written": report.exists(),
            "report [MB]": round(report.stat().st_size / 1e6, 2) if report.exists() else None,
            "processor time [s]": round(used.ru_utime + used.ru_stime, 1),
            "wall clock [s]": round(wall, 1),
            "load of the machine when it began": round(load, 1),
        }
    atomic_write(RESULTS / "first_run.json", json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1))
    if done.returncode:
        print(done.stdout[-2000:], done.stderr[-2000:])


if __name__ == "__main__":
    main()
