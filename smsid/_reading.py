"""Reading text, JSON and TOML that others wrote: whatever is wrong with the file is one error of our own."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from smsid.errors import SmsidError

SCHEMA_VERSION = 1  # of every JSON document


def read_text(path: str | os.PathLike[str], error: type[SmsidError] = SmsidError) -> str:
    """Return the text of a UTF-8 file.

    Raises:
        SmsidError: of the kind ``error``: no such file, no right to read it, a folder, or no UTF-8.
    """
    file = Path(path)
    try:
        return file.read_text(encoding="utf-8")
    except FileNotFoundError as cause:
        raise error(f"The file '{file}' does not exist.", advice="Check the path.") from cause
    except UnicodeDecodeError as cause:
        raise error(f"'{file}' is no UTF-8 text: {cause}.", advice="Is it the right file?") from cause
    except (OSError, ValueError) as cause:  # ValueError: a NUL in the name
        reason = getattr(cause, "strerror", None) or cause
        raise error(
            f"'{str(file)[:200]}' cannot be read: {reason}.", advice="Check the path and its rights."
        ) from cause


def read_toml(path: str | os.PathLike[str], error: type[SmsidError] = SmsidError) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Raises:
        SmsidError: of the kind ``error``: as `read_text`, or no TOML; names the line.
    """
    text = read_text(path, error)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as cause:  # a number or a nesting beyond Python's is one of these too
        raise error(
            f"'{path}' is not valid TOML: {_reason(cause)}.",
            advice="Is the file cut short? Mend the place it names.",
        ) from cause


def read_json(path: str | os.PathLike[str], error: type[SmsidError] = SmsidError) -> Any:
    """Return the document of a JSON file.

    Raises:
        SmsidError: of the kind ``error``: as `read_text`, or no JSON.
    """
    text = read_text(path, error)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as cause:
        raise error(
            f"'{path}' is not valid JSON: {_reason(cause)}.", advice="Is it cut short, or another file?"
        ) from cause


@contextmanager
def reading_document(
    path: str | os.PathLike[str], kind: str, command: str, error: type[SmsidError] = SmsidError
) -> Iterator[dict[str, Any]]:
    """Give the document of a JSON file that ``smsid <command>`` wrote; what the block lacks in it is told.

    Raises:
        SmsidError: of the kind ``error``: as `read_json`, another kind of document or schema, or not whole.
    """
    if not Path(path).is_file():
        raise error(f"The file '{path}' does not exist.", advice=f"Run `smsid {command}` to make it.")
    document = read_json(path, error)
    named = kind.replace("_", " ")
    try:
        found = document.get("kind") if isinstance(document, dict) else None
        if found != kind or document.get("schema") != SCHEMA_VERSION:
            if isinstance(found, str) and found != kind:
                raise error(
                    f"'{path}' is of the kind '{found.replace('_', ' ')}', no {named}.",
                    advice=f"Give what `smsid {command}` wrote.",
                )
            raise error(
                f"'{path}' is no {named} of schema {SCHEMA_VERSION}.",
                advice=f"Was it made by another version? `smsid {command}` makes it anew.",
            )
        yield document
    except (ValueError, KeyError, TypeError, AttributeError) as cause:
        article = "an" if kind[0] in "aeiou" else "a"
        raise error(
            f"'{path}' cannot be read as {article} {named}: {cause}.", advice="Is it cut short?"
        ) from cause


def _reason(cause: Exception) -> str:
    return "it is nested too deep" if isinstance(cause, RecursionError) else str(cause)
