"""Writing files so that they appear whole or not at all, and replace no input; what smsid wrote is signed."""

from __future__ import annotations

import errno
import hashlib
import math
import os
import shutil
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from smsid._temporary import temporary_beside
from smsid.errors import OutputError

FULL = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}
RESERVED = {"con", "prn", "aux", "nul"} | {f"{k}{n}" for k in ("com", "lpt") for n in range(1, 10)}
LONGEST_STEM = 200  # bytes: a file's name may hold 255, with its suffix


_protected: ContextVar[tuple[Path, ...]] = ContextVar("_protected", default=())
SIGNED = "# Written by smsid, "


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path beside ``path``; what is written there replaces ``path`` when the block ends.

    When the block raises, the temporary file is removed and an existing ``path`` stays as it was. A symbolic
    link is followed, so the file it points to is replaced and the link stays. The temporary file is empty;
    do not replace it by another. What killed runs left in the folder is removed.

    Raises:
        OutputError: as `check_target`, the disk is full, or the block wrote nothing.
    """
    target = check_target(path)
    with _explain_os_errors(path), temporary_beside(target) as temporary:
        yield temporary
        if not temporary.is_file() or not temporary.stat().st_size:
            raise OutputError(
                f"Nothing was written for {path}.",
                advice="Write to the path that atomic_path gives.",
                path=str(path),
            )
        _replace(temporary, target)


def atomic_write(path: str | os.PathLike[str], content: bytes | str) -> Path:
    """Write ``content`` (a str as UTF-8) to ``path``, whole or not at all; return the path.

    Raises:
        OutputError: as `check_target`, or the disk is full.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    target = check_target(path)
    with _explain_os_errors(path), temporary_beside(target) as temporary:
        temporary.write_bytes(data)
        _replace(temporary, target)
    return Path(path)


@contextmanager
def atomic_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary folder beside ``path`` that becomes ``path`` when the block ends.

    Raises:
        OutputError: ``path`` exists and is not an empty folder, its parent is missing, or the disk is full.
    """
    target = _resolve_path(path)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise OutputError(
            f"'{path}' exists and is not an empty folder.", advice="Name a new folder.", path=str(path)
        )
    _check_parent(target, path)
    with _explain_os_errors(path), temporary_beside(target, folder=True) as temporary:
        try:
            yield temporary
        except OutputError as error:  # of a file in it, by the name that the user gave the folder
            told = error.message.replace(str(temporary), str(path))
            raise OutputError(told, advice=error.advice, **{**error.evidence, "path": str(path)}) from error
        if target.exists():
            target.rmdir()
        os.replace(temporary, target)


def check_target(path: str | os.PathLike[str]) -> Path:
    """Return the file that writing to ``path`` makes or replaces, links followed.

    Raises:
        OutputError: its folder does not exist, it is a folder, a device, a pipe, or not to be written to, a
            link leads to itself, the name is no file's, or it is an input of the command under way.
    """
    target = _resolve_path(path)
    _check_parent(target, path)
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        return target
    except OSError as error:
        raise _cannot_write(path, f"{error.strerror}.", "Name another file.") from error
    if stat.S_ISDIR(mode):
        raise _cannot_write(path, "it is a folder.", "Name a file inside it.")
    if not stat.S_ISREG(mode):
        raise _cannot_write(path, "it is a device or a pipe.", "Name a file.")
    if not os.access(target, os.W_OK):
        raise _cannot_write(path, "it is read-only.", "Name another file.")
    refuse_protected(Path(path))
    return target


def _cannot_write(path: str | os.PathLike[str], reason: str, advice: str) -> OutputError:
    name = str(path) if len(str(path)) < 200 else f"{str(path)[:200]} ..."
    return OutputError(f"Cannot write {name!r}: {reason}", advice=advice, path=str(path))


def file_stem(name: str) -> str:
    """Return a name that a user gave, for the beginning of a file's name.

    Raises:
        OutputError: it would be a path, hidden, reserved on some system, or longer than a file's name can be.
    """
    wrong = ""
    if not name.strip() or name != name.strip():
        wrong = "is empty, or begins or ends with a blank"
    elif any(c in '/\\:*?"<>|' or not c.isprintable() for c in name):
        wrong = "has a character that a file's name cannot have"
    elif name.startswith((".", "-")) or name.endswith("."):
        wrong = "begins or ends with a dot, or begins with a dash"
    elif name.split(".")[0].lower() in RESERVED:
        wrong = "is reserved on some systems"
    elif len(name.encode()) > LONGEST_STEM:
        wrong = f"is longer than {LONGEST_STEM} bytes"
    if wrong:
        raise OutputError(
            f"The name {name[:80]!r} {wrong}, and a file is to be called by it.",
            advice="Give it a name of letters, digits, '_', '-' and single dots.",
            name=name,
        )
    return name


def _resolve_path(path: str | os.PathLike[str]) -> Path:
    """Return the path with links followed; a name that the system cannot have is our own error."""
    try:
        target = Path(path).resolve()
        target.is_dir()
        os.stat(target.parent)
        os.lstat(target)
    except FileNotFoundError:
        return target
    except (OSError, RuntimeError, ValueError) as error:  # too long, a loop of links, a NUL
        reason = getattr(error, "strerror", None) or str(error)
        raise _cannot_write(path, f"{reason}.", "Name another file.") from error
    return target


def _check_parent(target: Path, path: str | os.PathLike[str]) -> None:
    if not target.parent.is_dir():
        raise _cannot_write(path, f"the folder '{target.parent}' does not exist.", "Create it first.")


@contextmanager
def _explain_os_errors(path: str | os.PathLike[str]) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        full = error.errno in FULL
        reason = "the disk is full" if full else error.strerror or str(error)
        advice = "Make room, or name a file elsewhere." if full else "Check the rights of its folder."
        raise _cannot_write(path, f"{reason}; nothing was changed.", advice) from error


def _replace(temporary: Path, target: Path) -> None:
    # Without the sync a power cut can leave the new name on an empty file.
    with temporary.open("rb+") as stream:
        os.fsync(stream.fileno())
    if target.exists():
        shutil.copymode(target, temporary)
    os.replace(temporary, target)


def sha256(path: str | os.PathLike[str]) -> str:
    """Return the sha256 sum of a file."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def json_ready(x: Any) -> Any:
    """Return a document with every number that is not finite as ``None``: JSON has no word for it."""
    if isinstance(x, float) and not math.isfinite(x):
        return None
    if isinstance(x, dict):
        return {k: json_ready(v) for k, v in x.items()}
    if isinstance(x, list | tuple):
        return [json_ready(v) for v in x]
    return x


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


def with_sum(text: str) -> str:
    """Return a text with a first line, a comment in TOML, that holds the sum of the rest."""
    return f"{SIGNED}{_sum_of(text)}\n{text}"


def is_signed(text: str) -> bool:
    """Return whether a text is what `with_sum` gave: nobody wrote or changed it by hand."""
    first, _, rest = text.partition("\n")
    return first == f"{SIGNED}{_sum_of(rest)}"


def _sum_of(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
