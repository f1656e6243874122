"""Combinations of inertial parameters as an estimate names them: ``link2.mx + 2 link3.m``."""

from __future__ import annotations

import re

_TERM = re.compile(r"^(?:(?P<factor>[\d.]+(?:e[+-]?\d+)?) )?(?P<name>\S+)$")


def parse_combination(text: str) -> dict[str, float] | None:
    """Return factors by parameter of a combination such as ``bus.mx - 2 link1.m``; None if it is none."""
    out: dict[str, float] = {}
    parts = re.split(r" ([+-]) ", text)
    for sign, term in zip(["+", *parts[1::2]], parts[::2], strict=True):
        found = _TERM.match(term)
        if found is None:
            return None
        size = float(found["factor"] or 1.0)
        out[found["name"]] = out.get(found["name"], 0.0) + (size if sign == "+" else -size)
    return out
