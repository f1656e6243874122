"""Fixtures that many tests share."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def pytest_configure(config: pytest.Config) -> None:
    """Let all processes of a run share what searches find, and leave the user's own cache alone."""
    if hasattr(config, "workerinput") or "SMSID_CACHE" in os.environ:
        return
    kept = tempfile.TemporaryDirectory(prefix="smsid-tests-")
    os.environ["SMSID_CACHE"] = kept.name
    config.add_cleanup(kept.cleanup)


@pytest.fixture(scope="session")
def urdf() -> Path:
    """Folder of the bundled spacecraft."""
    return ROOT / "urdf"


@pytest.fixture(scope="session")
def oracle() -> Path:
    """Folder of recordings of an independent engine; skips when SMSID_ORACLE names none."""
    folder = Path(os.environ.get("SMSID_ORACLE") or "/nonexistent")
    if not folder.is_dir():
        pytest.skip("SMSID_ORACLE names no folder with recordings of an independent engine")
    return folder
