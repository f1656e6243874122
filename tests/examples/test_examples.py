"""Every example runs headless, is short, and leaves a picture where it is told to."""

from __future__ import annotations

import inspect
import os
import runpy
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))
PICTURES = (".png", ".svg", ".html")
LINES = 120
FEW = {"02_mount_any_arm": ["ur5", "tiago_no_hand", "talos_left_arm"]}  # of all robots: `tests/description`
SLOW = (  # what they do is also done by what runs with the ordinary tests:
    "01_paper_end_to_end",  # README
    "02_mount_any_arm",  # `tests/description/test_robots.py`
    "03_control",  # `tests/control`
    "04_design_an_experiment",  # `tests/design`
    "07_campaign",  # `tests/campaign`
    "09_name_the_cause",  # `tests/cli/test_demo_verdict.py`
    "10_real_arm",  # `tests/arm`
    "11_laboratory_tests",  # `tests/lab`
    "12_follow_telemetry",  # `tests/tracking/test_stream_command.py`
)


def test_the_numbers_are_complete() -> None:
    numbers = [path.name[:2] for path in SCRIPTS]
    assert numbers == [f"{k:02d}" for k in range(1, len(SCRIPTS) + 1)]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_the_example_is_short(script: Path) -> None:
    assert len(script.read_text(encoding="utf-8").splitlines()) < LINES


def test_the_slow_ones_are_examples() -> None:
    assert set(SLOW) <= {path.stem for path in SCRIPTS}


@pytest.mark.parametrize("script", [p for p in SCRIPTS if p.stem in SLOW], ids=lambda p: p.stem)
def test_a_slow_example_finds_what_it_imports_and_takes_a_folder(script: Path) -> None:
    main = runpy.run_path(str(script), run_name="example")["main"]
    assert next(iter(inspect.signature(main).parameters)) == "folder"


@pytest.mark.parametrize(
    "script",
    [pytest.param(p, id=p.stem, marks=[pytest.mark.slow] if p.stem in SLOW else []) for p in SCRIPTS],
)
def test_the_example_runs_and_leaves_a_picture(script: Path, tmp_path: Path) -> None:
    text = script.read_text(encoding="utf-8")
    if "SMSID_DATA" in text and not os.environ.get("SMSID_DATA"):
        pytest.skip("SMSID_DATA names no folder with public recordings")
    if "robot=" in text:
        try:
            metadata.version("example-robot-data")
        except metadata.PackageNotFoundError:
            pytest.skip("example-robot-data is not installed")
    elsewhere, chosen = tmp_path / "elsewhere", tmp_path / "chosen"
    elsewhere.mkdir()
    done = subprocess.run(
        [sys.executable, str(script), str(chosen), *FEW.get(script.stem, [])],
        capture_output=True,
        text=True,
        cwd=elsewhere,
        timeout=600,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "DISPLAY": "", "WAYLAND_DISPLAY": ""},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    pictures = [path for path in chosen.iterdir() if path.suffix in PICTURES]
    assert pictures and all(path.stat().st_size > 5000 for path in pictures), list(chosen.iterdir())
    assert not list(elsewhere.iterdir()), "it wrote outside of the folder it was given"
