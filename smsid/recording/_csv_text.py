"""The lines of a text file, whatever its encoding."""

from __future__ import annotations

import codecs
import gzip
import io
import logging
import re
from pathlib import Path

from smsid.errors import RecordingError
from smsid.recording.columns import unreadable, without_samples

logger = logging.getLogger(__name__)

CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")


def read_lines(path: Path, skip_rows: int) -> tuple[list[str], str, int]:
    """Give the lines from the header on, the last comment before them, and the number of the first, from 1.

    Raises:
        RecordingError: not text, a damaged archive, or nothing in it.
    """
    try:
        raw = path.read_bytes()
        data = gzip.decompress(raw) if path.name.lower().endswith(".gz") else raw
    except Exception as error:  # gzip raises OSError, EOFError or zlib.error
        raise unreadable(path, "gzipped CSV", error) from error
    lines = io.StringIO(_decoded(path, data), newline=None).read().split("\n")
    skipped = skip_rows
    comment = ""
    # Spreadsheets take their delimiter from a first line such as 'sep=;'.
    while skipped < len(lines) and re.match(r"#|\s*$|(?i:sep=.\s*$)", lines[skipped]):
        comment = lines[skipped].lstrip("# ") or comment
        skipped += 1
    while lines and not lines[-1].strip():
        lines.pop()
    if len(lines) <= skipped:
        raise without_samples(path, "lines to read")
    return [f"{line}\n" for line in lines[skipped:]], comment, skipped + 1


def _decoded(path: Path, data: bytes) -> str:
    """Decode UTF-8, UTF-16, or the code page of older programs of Windows."""
    even, odd = data[0:2000:2], data[1:2000:2]
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) and len(data) % 2 == 0 and 0 in data[:200]:
        names = ("utf-16",)
    elif len(odd) > 4 and (odd.count(0) > 0.9 * len(odd) or even.count(0) > 0.9 * len(even)):
        names = ("utf-16-le" if odd.count(0) > even.count(0) else "utf-16-be",)
    else:
        names = ("utf-8-sig", "cp1252")
    for name in names:
        try:
            text = data.decode(name)
        except UnicodeDecodeError:
            continue
        if name == "cp1252":
            if CONTROL.search(text):
                break
            logger.warning("%s is not UTF-8; it is read as Windows-1252.", path)
        return text
    raise RecordingError(
        f"{path} is no text in UTF-8, UTF-16 or Windows-1252.",
        advice="Is it the right file? If so, save it as UTF-8.",
        path=str(path),
    )
