"""What happens without numba, without a folder for its cache, and with a cache of another text."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import smsid
from smsid.kernel import jit

FLIGHT = """
import logging
import numpy as np
{before}
logging.basicConfig(level=logging.INFO, format="%(message)s")
from smsid.description import load_description
from smsid.kernel import jit, tree
from smsid.kernel.arrays import Kernel
from smsid.model import build_model
from smsid.paths import urdf_folder
from smsid.simulate import Inputs, Steps, simulate
model = build_model(load_description(urdf_folder() / "paper_sms.toml"))
inputs = Inputs(joint_torque=Steps(tuple(0.02 * k for k in range(50)), np.ones((50, 3))))
print(type(Kernel.of(model)).__name__, simulate(model, inputs, 1.0).states(np.array([1.0])).v[0, 3].hex())
"""
HIDDEN = "import sys; sys.modules['numba'] = None"


def run(before: str = "", package: Path | None = None, **environment: str) -> tuple[str, str]:
    """Return what a process that flies prints, and what it logs."""
    root = Path(smsid.__file__).parents[1] if package is None else package
    path = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", FLIGHT.format(before=before)],
        env={**os.environ, "PYTHONPATH": path, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip(), done.stderr


def test_without_numba_the_plain_way_is_taken_and_said_once():
    found, log = run(HIDDEN)
    kind, _ = found.split()
    assert kind == "NoneType"
    assert log.count("pip install 'smsid[fast]'") == 1
    assert run(SMSID_COMPILED="0")[0] == found


needs_numba = pytest.mark.skipif(jit.numba is None, reason="numba is not installed")


@needs_numba
def test_without_a_folder_for_the_cache_the_plain_way_is_taken_and_said_once(tmp_path):
    file = tmp_path / "file"
    file.write_text("no folder")
    found, log = run(NUMBA_CACHE_DIR=str(file / "cache"))
    assert found == run(HIDDEN)[0]
    assert log.count("numba keeps no cache") == 1


@needs_numba
def test_a_cache_of_another_text_is_never_used(tmp_path):
    """Gravity's sign in the one module, while the file of the function that is cached stays what it is."""
    shutil.copytree(
        Path(smsid.__file__).parent, tmp_path / "smsid", ignore=shutil.ignore_patterns("__pycache__")
    )
    where = {"package": tmp_path, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    first, _ = run(**where)
    assert run(**where)[0] == first
    changed = tmp_path / "smsid" / "kernel" / "tree.py"
    before, stamp = changed.read_text(), changed.stat()
    text = before.replace("tau[k] - forces[n, k]", "tau[k] + forces[n, k]")
    assert text != before
    changed.write_text(text)
    os.utime(changed, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    assert changed.stat().st_size == stamp.st_size
    second, _ = run(**where)
    assert second.split()[0] == "Kernel" and second != first
    changed.write_text(before)
    assert run(**where)[0] == first
