"""What a command may replace: no TOML of the user's; unasked, only what smsid wrote of the same kind."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from smsid._files import is_signed
from smsid.cli.file_kind import kind_of
from smsid.errors import OutputError, SmsidError

FIGURE, PAGE = "figure", "page"
MARKED = {
    ".png": (FIGURE, b"Software\0smsid"),
    ".html": (PAGE, b'<meta name="generator" content="smsid'),
}
"""Kinds that are known by a mark near the beginning of the file."""
MARKED_WITHIN = 4096  # bytes


def check_toml(path: Path, called: str) -> None:
    """Refuse to replace a TOML that somebody wrote or changed, as a drafted mapping that was gone through.

    Raises:
        OutputError: the file is there, and not as smsid wrote it.
    """
    if path.is_file() and not _is_ours(path):
        raise OutputError(
            f"{called} '{path}' is there already and was written or changed by hand.",
            advice=f"Give {called} another path, or remove that file.",
            path=str(path),
        )


def _is_ours(path: Path) -> bool:
    try:
        return is_signed(path.read_text(encoding="utf-8"))
    except ValueError:
        return False


def check_unnamed(path: Path, kind: str, told: str, inputs: Sequence[Path]) -> None:
    """Refuse to replace a file of somebody else's, or measured data, at a place that nobody named.

    ``told`` says why it would be written there, ``inputs`` are the files the command reads.

    Raises:
        OutputError: the file was not written by smsid, is of another kind, was changed by hand, or holds a
            recording imported from a log that is none of the inputs.
    """
    if not path.is_file():
        return
    reason = _why_not(path, kind, inputs)
    if reason:
        raise OutputError(
            f"'{path}' ({told}) is there already and {reason}.",
            advice="Name the output by --output (-o), or move that file.",
            path=str(path),
        )


def _why_not(path: Path, kind: str, inputs: Sequence[Path]) -> str:
    found = _written_kind(path)
    if not found:
        changed = ", or was changed since" if path.suffix == ".toml" else ""
        return f"is no {kind.replace('_', ' ')} that smsid wrote{changed}"
    if found != kind:
        return f"is {_article(found)}, not {_article(kind)}"
    log = _imported_from(path) if kind == "recording" else ""
    if log and log not in [p.name for p in inputs]:
        return f"holds what was measured in '{log}'"
    return ""


def _article(kind: str) -> str:
    return f"{'an' if kind[0] in 'aeiou' else 'a'} {kind.replace('_', ' ')}"


def _written_kind(path: Path) -> str:
    """Return the kind of a file that smsid wrote and nobody changed; nothing of another."""
    suffix = path.suffix.lower()
    if suffix in MARKED:
        kind, mark = MARKED[suffix]
        with path.open("rb") as stream:
            return kind if mark in stream.read(MARKED_WITHIN) else ""
    try:
        kind = kind_of(path)
    except SmsidError:
        return ""
    if suffix == ".toml" and not _is_ours(path):
        return ""
    from smsid.recording.storage import file_attribute

    return kind if suffix != ".nc" or file_attribute(path, "schema").startswith("smsid.") else ""


def _imported_from(path: Path) -> str:
    """Return the name of the log that a recording was imported from and is still whole of."""
    from smsid.recording.storage import file_attribute

    try:
        made = json.loads(file_attribute(path, "provenance"))
        return "" if made.get("steps") else str(made["imported"]["file"])
    except (ValueError, LookupError, TypeError, AttributeError):
        return ""
