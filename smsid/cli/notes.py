"""Notes on the terminal: those of one kind in a line, the rest on demand."""

from __future__ import annotations

import re
from collections.abc import Iterable

from smsid.cli.output import WIDTH

MOST = 6  # lines of notes, unless everything is asked for

_KINDS = (
    (
        re.compile(r"^only in combination: (?P<item>[^(]+?)(?: \(.*)?$", re.DOTALL),
        "{count} sets are seen only in combination: {items}",
    ),
    (
        re.compile(r"^(?P<item>\S+): noise of (?P<second>\S+) as its residuals show it: .*$"),
        "noise as the residuals show it, of {count} channels of {items}: --all",
    ),
    (re.compile(r"^(?P<item>.+?): .* left out: (?P<rest>.*)$"), "samples left out in {items}: --all"),
    (
        re.compile(r"^'(?P<item>[^']+)' contradicts the other recordings (?!.*One factor).*$", re.DOTALL),
        "{items} contradict each other: were they flown with the same spacecraft? In what, with --all",
    ),
    (
        re.compile(r"^(?P<item>\S+) stands? still .*$"),
        "stand still, their own parameters stay as described: {items}",
    ),
    (re.compile(r"^(?P<item>'.+?') has no mass in the URDF.*$"), "without mass in the URDF: {items}"),
)


def told(notes: Iterable[str], *, everything: bool = False, most: int = MOST) -> list[str]:
    """Return lines that tell notes: each once, those of one kind together, at most ``most`` lines.

    ``everything``: every note in full, in the order given.
    """
    unique = list(dict.fromkeys(str(n) for n in notes))
    if everything:
        return [f"note: {n}" for n in unique]
    groups: dict[str, list[str]] = {}
    for n in unique:
        groups.setdefault(_kind(n)[0] or n, []).append(n)
    lines = []
    for sentence, own in groups.items():
        text = own[0]
        if len(own) > 1:
            names = list(dict.fromkeys(_kind(n)[1] for n in own))
            several = "; " if any("," in x for x in names) else ", "
            text = sentence.format(count=len(own), items=several.join(names))
        lines.append(clipped(f"note: {text}"))
    if len(lines) > most:
        left = sum(len(own) for own in list(groups.values())[most - 1 :])
        lines = [*lines[: most - 1], f"note: {left} more with --all"]
    return lines


def clipped(text: str, width: int = WIDTH) -> str:
    """Return one line of at most ``width`` characters; what is cut stands with ``--all``."""
    text = " ".join(text.split())
    tail = " ... (--all)"
    return text if len(text) <= width else text[: width - len(tail)].rstrip(" ,;(") + tail


def _kind(note: str) -> tuple[str, str]:
    """Return the sentence that notes of one kind share, and what this one is about."""
    for pattern, sentence in _KINDS:
        match = pattern.match(note)
        if match:
            return sentence, match["item"].strip()
    return "", note
