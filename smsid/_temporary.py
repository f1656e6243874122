"""Temporary files beside what they become: recognisable; the next run removes what a killed run left."""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

LONGEST = 180  # bytes of the target's name that are kept: a name may hold 255
PATTERN = re.compile(r"\..*\.smsid-[0-9a-f]{12}\.tmp", re.DOTALL)


@contextmanager
def temporary_beside(target: Path, *, folder: bool = False) -> Iterator[Path]:
    """Make an empty temporary file (or folder) beside ``target`` and remove it when the block ends.

    It is locked while the block runs. The lock dies with the process, so that `remove_orphans` tells what a
    killed run left from what another run is writing.
    """
    remove_orphans(target.parent)
    path, handle = _create_locked(target, folder)
    try:
        yield path
    finally:
        # not another's: after the block has renamed it there is nothing by this name
        _remove(path)
        os.close(handle)


def remove_orphans(folder: Path) -> list[Path]:
    """Remove what killed runs left in ``folder``; return what was removed."""
    if fcntl is None:
        return []
    removed = []
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if PATTERN.fullmatch(entry.name) and not entry.is_symlink() and _is_orphan(entry.path):
                _remove(Path(entry.path))
                removed.append(Path(entry.path))
    return removed


def _create_locked(target: Path, folder: bool) -> tuple[Path, int]:
    kept = target.name.encode(errors="surrogateescape")[:LONGEST].decode(errors="ignore")
    while True:
        path = target.with_name(f".{kept}.smsid-{secrets.token_hex(6)}.tmp")
        if folder:
            path.mkdir()
        else:
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        try:
            handle = os.open(path, os.O_RDONLY)
        except FileNotFoundError:  # another run took it for an orphan before it was locked
            continue
        if fcntl is not None:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if path.exists():
            return path, handle
        os.close(handle)


def _is_orphan(path: str) -> bool:
    try:
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # type: ignore[union-attr]
    except OSError:
        return False
    finally:
        os.close(handle)
    return True


def _remove(path: Path) -> None:
    with suppress(OSError):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
