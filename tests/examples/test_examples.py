"""Every example runs headless."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.parametrize("script", sorted(FOLDER.glob("*.py")), ids=lambda p: p.stem)
def test_the_example_runs(script: Path, tmp_path: Path) -> None:
    text = script.read_text(encoding="utf-8")
    if "SMSID_DATA" in text and not os.environ.get("SMSID_DATA"):
        pytest.skip("SMSID_DATA names no folder with public recordings")
    if "robot=" in text:
        try:
            metadata.version("example-robot-data")
        except metadata.PackageNotFoundError:
            pytest.skip("example-robot-data is not installed")
    done = subprocess.run(
        [sys.executable, str(script)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        timeout=600,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
