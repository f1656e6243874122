"""A first line by which a text file is known as written by smsid and not changed since."""

from __future__ import annotations

import hashlib

SIGNED = "# Written by smsid, "


def signed(text: str) -> str:
    """Return a text with a first line, a comment in TOML, that holds the sum of the rest."""
    return f"{SIGNED}{_sum(text)}\n{text}"


def is_signed(text: str) -> bool:
    """Return whether a text is what `signed` gave: nobody wrote or changed it by hand."""
    first, _, rest = text.partition("\n")
    return first == f"{SIGNED}{_sum(rest)}"


def _sum(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
