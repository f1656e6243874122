"""kill -9 in the middle, several times: nothing is lost, nothing counted twice."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from campaign.conftest import lines_of
from smsid.campaign import campaign_main, read_store

RUNS = 40
SCRIPT = """
import sys
from smsid.campaign import campaign_main
campaign_main(sys.argv[1], sys.argv[2], workers=int(sys.argv[3]))
"""


def start(plan: Path, store: Path, workers: int) -> subprocess.Popen[bytes]:
    """Start the campaign in a session of its own."""
    command = [sys.executable, "-c", SCRIPT, str(plan), str(store), str(workers)]
    return subprocess.Popen(command, start_new_session=True, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})


def written(store: Path) -> int:
    """Lines in the store, torn or not."""
    return store.read_bytes().count(b"\n") if store.exists() else 0


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL on this system")
def test_killed_three_times_and_resumed_equals_uninterrupted(
    make_plan: Callable[..., Path], tmp_path: Path
) -> None:
    """Killed with its workers, alone (so that they are orphaned), and while it computes by itself."""
    plan, store = make_plan(runs=RUNS, options={"pause": 0.03}), tmp_path / "killed.jsonl"
    before: set[int] = set()
    groups: list[int] = []
    for goal, workers, kill in ((6, 2, os.killpg), (15, 2, os.kill), (26, 1, os.kill)):
        process = start(plan, store, workers)
        groups.append(process.pid)
        deadline = time.monotonic() + 60.0
        while written(store) < goal and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.002)
        assert process.poll() is None, "it ended before it was killed"
        kill(process.pid, signal.SIGKILL)
        assert process.wait(10) == -signal.SIGKILL
        kept = {r.run for r in read_store(store)[1]}
        assert goal - 1 <= len(kept) < RUNS
        assert before <= kept, "a result was lost"
        before = kept
    campaign_main(plan, store, backend="serial")
    whole = tmp_path / "whole.jsonl"
    campaign_main(plan, whole, backend="serial")
    assert sorted(lines_of(store)) == list(range(RUNS))
    assert lines_of(store) == lines_of(whole)
    assert not [g for g in groups if not _ends(g)], "workers outlive the campaign"


def _ends(group: int, within: float = 10.0) -> bool:
    """Whether the processes of a group end soon [s]."""
    deadline = time.monotonic() + within
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False
