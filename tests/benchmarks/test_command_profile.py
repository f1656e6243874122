"""The profile of a command that fails is no profile of that command."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


def test_a_command_that_fails_ends_the_benchmark(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [str(BENCHMARKS), *sys.path])
    from command_profile import profiled, share_of

    assert 0.0 < share_of(profiled(["version"], tmp_path, tmp_path), ("_find_and_load",)) < 1.0
    with pytest.raises(SystemExit, match=r"ended with 1:\s.*nowhere.json"):
        profiled(["show", "nowhere.json"], tmp_path, tmp_path)
