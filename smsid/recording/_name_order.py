"""The order of components that names of columns tell: x, y, z, roll, pitch, yaw, numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from smsid.recording._units import bare
from smsid.recording.mapping import ChannelTable

TURNS = ("roll", "pitch", "yaw")
TOKENS = (r"(?i:roll|pitch|yaw)", r"[xyzwXYZW]", r"\d+")


def name_tokens(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the axis (x, y, z, w), turn (roll, ...) or number by which alone names differ, in lower case.

    None where they differ in more, or two are alike.
    """
    texts = [bare(name) for name in names]
    if len(texts) < 2:
        return None
    for token in TOKENS:
        for found in reversed(list(re.finditer(token, texts[0]))):
            before, after = re.escape(texts[0][: found.start()]), re.escape(texts[0][found.end() :])
            matches = [re.fullmatch(f"{before}({token}){after}", text) for text in texts]
            tokens = tuple(m.group(1).lower() for m in matches if m)
            if len(tokens) == len(texts) == len({_key(t) for t in tokens}):
                return tokens
    return None


def _key(token: str) -> int:
    """Return the place of an axis or turn, or the number."""
    if token.isdigit():
        return int(token)
    return TURNS.index(token) if token in TURNS else "xyzw".index(token)


def sorted_by_name(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names by axis, turn or number; in their own order where they do not tell one."""
    tokens = name_tokens(names)
    if tokens is None:
        return tuple(names)
    return tuple(name for _, name in sorted(zip(map(_key, tokens), names, strict=True), key=lambda x: x[0]))


def order_doubts(channels: Mapping[str, ChannelTable]) -> list[str]:
    """Return which channels of a mapping take their columns in an order that contradicts their names."""
    said = []
    for name, table in channels.items():
        tokens = name_tokens(table.columns)
        if tokens is None or isinstance(table.sign, tuple):  # signs of their own: axes are turned on purpose
            continue
        quantity, listed = table.quantity(name), ", ".join(table.columns)
        if not quantity.dims:
            continue
        numbered = tokens[0].isdigit()
        if quantity.is_quaternion:
            order = table.quaternion or "xyzw"
            if not numbered and "".join(tokens) != order:
                said.append(
                    f"'{name}' takes {listed} as {', '.join(order)}, which their names contradict: correct "
                    "`columns` or `quaternion` of the mapping."
                )
        elif table.labels is not None and len(table.labels) == len(tokens):
            labels = name_tokens(table.labels)
            if labels is not None and labels != tokens and set(map(_key, labels)) == set(map(_key, tokens)):
                said.append(
                    f"'{name}' labels {listed} as {', '.join(table.labels)}, which their names contradict: "
                    "correct `columns` or `labels` of the mapping."
                )
        elif table.labels is None and sorted_by_name(table.columns) != table.columns:
            right = ", ".join(sorted_by_name(table.columns))
            meant = "as x, y, z" if quantity.is_vector else "in the spacecraft's order"
            mend = "`labels` tell which is which"
            mend = "a sign for each tells that axes are turned" if quantity.is_vector else mend
            said.append(
                f"'{name}' takes {listed} {meant}; their names say {right}: correct `columns` of the "
                f"mapping, or leave it as it is meant ({mend})."
            )
    return said
