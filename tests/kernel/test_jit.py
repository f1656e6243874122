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
from smsid.kernel import jit, _tree as tree
from smsid.kernel.arrays import Kernel
from smsid.model import build_model
from smsid.paths import urdf_folder
from smsid.simulate import Inputs, PiecewiseConstant, simulate
model = build_model(load_description(urdf_folder() / "paper_sms.toml"))
inputs = Inputs(joint_torque=PiecewiseConstant(tuple(0.02 * k for k in range(50)), np.ones((50, 3))))
print(type(Kernel.of(model)).__name__, simulate(model, inputs, 1.0).states(np.array([1.0])).v[0, 3].hex())
"""
HIDDEN = "import sys; sys.modules['numba'] = None"


def run(before: str = "", **environment: str) -> tuple[str, str]:
    """Return what a process that flies prints, and what it logs."""
    path = os.pathsep.join([str(Path(smsid.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
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
def test_without_a_folder_for_the_cache_the_plain_way_is_taken_and_said_once():
    cache = "getattr(n, 'CacheImpl', None) or n._CacheImpl"
    nowhere = f"import numba.core.caching as n; ({cache})._locator_classes = []"
    found, log = run(nowhere)
    assert found == run(HIDDEN)[0]
    assert log.count("numba keeps no cache") == 1


INNER = """from pack.jit import compile_inner

@compile_inner
def inner(x):
    return 2.0 * x
"""
OUTER = """from pack.inner import inner
from pack.jit import compiled_and_cached

@compiled_and_cached
def outer(x):
    return inner(x) + 1.0
"""
CALL = "from pack.outer import outer; print(outer(3.0), sum(outer.stats.cache_hits.values()))"


def rewrite(path: Path, text: str) -> None:
    """Write a text as if seconds later: Python's own cache tells files by size and whole seconds."""
    before = path.stat().st_mtime
    path.write_text(text)
    os.utime(path, (before + 10.0, before + 10.0))


@pytest.fixture
def pack(tmp_path):
    """A folder with the compiler of the kernel, and a cached function that calls one of another file."""
    folder = tmp_path / "pack"
    folder.mkdir()
    shutil.copy(jit.__file__, folder)
    (folder / "inner.py").write_text(INNER)
    (folder / "outer.py").write_text(OUTER)

    def call(before: str = "") -> list[str]:
        done = subprocess.run(
            [sys.executable, "-c", f"{before}\n{CALL}"],
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]),
            },
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        return [*done.stdout.split(), done.stderr]

    return folder, call


@needs_numba
def test_a_cache_of_another_text_is_never_used(pack):
    """Numba alone would take it: the file of the cached function stays what it is."""
    folder, call = pack
    assert call()[:2] == ["7.0", "0"]
    assert call()[:2] == ["7.0", "1"]
    rewrite(folder / "inner.py", INNER.replace("2.0 * x", "5.0 * x"))
    assert call()[:2] == ["16.0", "0"]
    assert call()[:2] == ["16.0", "1"]


@needs_numba
def test_a_cache_that_names_a_class_that_is_gone_is_not_read(pack):
    """Its index holds the types of arguments: unpickling them would end the process."""
    folder, call = pack
    own = "from typing import NamedTuple\nclass Old(NamedTuple):\n    x: float\n"
    (folder / "inner.py").write_text(INNER + own)
    (folder / "outer.py").write_text(OUTER.replace("inner(x) + 1.0", "inner(x.x) + 1.0"))
    hits = """import pack.inner, pack.outer
pack.outer.outer(pack.inner.{}(3.0))
print(sum(pack.outer.outer.stats.cache_hits.values()))
raise SystemExit"""
    assert [call(hits.format("Old"))[0] for _ in range(2)] == ["0", "1"]
    rewrite(folder / "inner.py", INNER + own.replace("Old", "New"))
    assert [call(hits.format("New"))[0] for _ in range(2)] == ["0", "1"]


@needs_numba
def test_a_damaged_cache_is_made_anew(pack):
    folder, call = pack
    call()
    (index,) = (folder / "__pycache__").glob("*.nbi")
    whole = index.read_bytes()
    index.write_bytes(whole[: len(whole) // 2])
    value, hits, log = call()
    assert (value, hits) == ("7.0", "0") and "cannot be used" in log
    assert call()[:2] == ["7.0", "1"]


@needs_numba
def test_a_full_disk_costs_the_cache_and_not_the_result(pack):
    _, call = pack
    full = "import numba.core.caching as n\ndef save(*a): raise OSError(28, 'No space left on device')"
    value, hits, log = call(f"{full}\nn.IndexDataCacheFile.save = save")
    assert (value, hits) == ("7.0", "0") and "No space left on device" in log
    assert call()[:2] == ["7.0", "0"]
