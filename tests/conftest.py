"""Fixtures that many tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


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
