"""Writing files so that they appear whole or not at all."""

from __future__ import annotations

import math
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from smsid.errors import SmsidError


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path beside ``path``; what is written there replaces ``path`` when the block ends.

    When the block raises, the temporary file is removed and an existing ``path`` stays as it was. A symbolic
    link is followed, so the file it points to is replaced and the link stays.

    Raises:
        SmsidError: the folder of ``path`` does not exist, ``path`` is a folder, or the block wrote nothing.
    """
    target = Path(path).resolve()
    if not target.parent.is_dir():
        raise SmsidError(
            f"Cannot write {path}: the folder {target.parent} does not exist.",
            advice="Create it first.",
            path=str(path),
        )
    if target.is_dir():
        raise SmsidError(
            f"Cannot write {path}: it is a folder.", advice="Name a file inside it.", path=str(path)
        )
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(6)}.tmp")
    try:
        yield temporary
        if not temporary.is_file():
            raise SmsidError(
                f"Nothing was written for {path}.",
                advice="Write to the path that atomic_path gives.",
                path=str(path),
            )
        # Without the sync a power cut can leave the new name on an empty file.
        with temporary.open("rb+") as stream:
            os.fsync(stream.fileno())
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def atomic_write(path: str | os.PathLike[str], content: bytes | str) -> Path:
    """Write ``content`` (a str as UTF-8) to ``path``, whole or not at all; return the path.

    Raises:
        SmsidError: the folder of ``path`` does not exist, or ``path`` is a folder.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)
    return Path(path)


def json_ready(x: Any) -> Any:
    """Return a document with every number that is not finite as ``None``: JSON has no word for it."""
    if isinstance(x, float) and not math.isfinite(x):
        return None
    if isinstance(x, dict):
        return {k: json_ready(v) for k, v in x.items()}
    if isinstance(x, list | tuple):
        return [json_ready(v) for v in x]
    return x
