"""How long one waits before anything happens: `import smsid` and `smsid --help`, beside what they rest on.

Claims: `import smsid` adds at most half of what `import pinocchio` takes by itself, and `smsid --help` takes
at most twice as long as importing typer and rich. Each is a fresh interpreter (a bare one's time is taken off
the first two); processor time, in turn, so that a loaded machine slows all alike.

    python benchmarks/startup.py --rounds 15
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys

import numpy as np
from _common import ROOT, environment, spread, write_result

RUNS = {
    "python": "pass",
    "import smsid": "import smsid",
    "import pinocchio": "import pinocchio",
    "import typer, rich": "import typer, rich",
    "smsid --help": "import sys; sys.argv = ['smsid', '--help']; from smsid.cli import main; main()",
    "smsid identify --help": (
        "import sys; sys.argv = ['smsid', 'identify', '--help']; from smsid.cli import main; main()"
    ),
}


def seconds(code: str) -> float:
    """Return the processor time of a fresh interpreter that runs some code [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL, cwd=ROOT)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    rounds = parser.parse_args().rounds
    times = {name: np.empty(rounds) for name in RUNS}
    for code in RUNS.values():
        seconds(code)  # compiled files and disk caches
    for k in range(rounds):
        for name, code in RUNS.items():
            times[name][k] = seconds(code)
    middle = {name: float(np.median(t)) for name, t in times.items()}
    bare = middle["python"]
    package = (middle["import smsid"] - bare) / (middle["import pinocchio"] - bare)
    page = middle["smsid --help"] / middle["import typer, rich"]
    result = {
        "environment": environment("smsid", "typer", "rich", "pin"),
        "rounds": rounds,
        "processor_seconds": {name: spread(t) for name, t in times.items()},
        "import_smsid_of_import_pinocchio": {"value": round(package, 4), "wanted": 0.5},
        "help_of_import_typer_rich": {"value": round(page, 4), "wanted": 2.0},
        "holds": bool(package <= 0.5 and page <= 2.0),
    }
    path = write_result("startup", result)
    for name, value in middle.items():
        print(f"{name:24s} {1e3 * value:7.1f} ms")
    print(f"import smsid adds {100 * package:.1f} % of what import pinocchio takes (wanted: at most 50 %)")
    print(f"smsid --help takes {page:.2f} times as long as import typer, rich (wanted: at most 2)")
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
