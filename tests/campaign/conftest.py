"""A campaign with a cheap method, in a folder of its own."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w

HERE = Path(__file__).parent


@pytest.fixture
def make_plan(tmp_path: Path, urdf: Path) -> Callable[..., Path]:
    """Write the plan of a cheap campaign; keywords replace its keys."""

    def write(file: str = "plan.toml", **keys: Any) -> Path:
        for source in ("paper_sms.toml", "paper_sms.urdf"):
            if not (tmp_path / source).exists():
                shutil.copy(urdf / source, tmp_path / source)
        shutil.copy(HERE / "cheap.py", tmp_path / "cheap_method.py")
        tables = {
            "name": "cheap",
            "description": "paper_sms.toml",
            "runs": 12,
            "seed": 7,
            "method": "cheap_method:measure",
            "truth": [{"parameters": ["tank.mass"], "relative": 0.1}],
            **keys,
        }
        path = tmp_path / file
        path.write_text(tomli_w.dumps(tables))
        return path

    return write


def lines_of(store: Path) -> dict[int, str]:
    """Return every line of a store by run, without its seconds; fails when a run is there twice."""
    out: dict[int, str] = {}
    for line in store.read_text().splitlines()[1:]:
        record = json.loads(line)
        assert record["run"] not in out, f"run {record['run']} counted twice"
        record.pop("seconds")
        out[record["run"]] = json.dumps(record)
    return out
