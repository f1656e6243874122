"""The inputs of what is under way, which no writer may replace."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from smsid.errors import OutputError

_protected: ContextVar[tuple[Path, ...]] = ContextVar("_protected", default=())


@contextmanager
def protect_inputs(inputs: Iterable[Path]) -> Iterator[None]:
    """Refuse inside the block to replace any of these files, by whatever name it is written."""
    token = _protected.set((*_protected.get(), *inputs))
    try:
        yield
    finally:
        _protected.reset(token)


def refuse_protected(path: Path) -> None:
    """Raise `OutputError` when ``path`` is one of the files `protect_inputs` names."""
    for other in _protected.get():
        if is_same_file(path, other):
            raise OutputError(
                f"'{path}' is not written: it is the input '{other}'.",
                advice="Name another output.",
                path=str(path),
            )


def is_same_file(a: Path, b: Path) -> bool:
    """Return whether two paths lead to one file: by resolved name, by symbolic or by hard link."""
    try:
        if os.path.samefile(a, b):
            return True
    except (OSError, ValueError):
        pass
    return os.path.realpath(a) == os.path.realpath(b)
