"""Names told in a line."""

from __future__ import annotations

import difflib
from collections.abc import Sequence


def some_of(names: Sequence[str], most: int = 4) -> str:
    """Return the first names with commas, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def did_you_mean(name: str, known: Sequence[str]) -> str:
    """Return `` Did you mean '...'?`` with the closest of the known names, or nothing."""
    near = difflib.get_close_matches(name, known, n=1)
    return f" Did you mean '{near[0]}'?" if near else ""
