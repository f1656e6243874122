"""A text for results that fits a screen, and a table for notebooks: arrays by their shape, long tuples by
their length.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from html import escape
from typing import Any, TypeVar

LINES, WIDTH = 30, 110
T = TypeVar("T", bound=type)


class ShortRepr:
    """Text and notebook table of a class: its ``_title_and_rows`` returns a title and rows."""

    __slots__ = ()

    def __repr__(self) -> str:
        return as_text(*self._title_and_rows())

    def __str__(self) -> str:  # pydantic has one of its own
        return repr(self)

    def _repr_html_(self) -> str:
        return as_html(*self._title_and_rows())


def short_repr(cls: T) -> T:
    """Give a dataclass a ``repr`` of at most `LINES` lines: a field a line, long values told, not shown; and
    the same as a table in notebooks.
    """
    cls.__repr__ = _text  # type: ignore[method-assign]
    cls._repr_html_ = lambda self: as_html(type(self).__name__, _rows(self))  # type: ignore[attr-defined]
    return cls


def as_text(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """Return a title and a line for each row, at most `LINES` lines of at most `WIDTH` characters."""
    shown = rows if len(rows) < LINES else rows[: LINES - 2]
    lines = [title, *(f"  {name}: {text}" for name, text in shown)]
    if len(rows) > len(shown):
        lines.append(f"  {len(rows) - len(shown)} more fields")
    return "\n".join(line if len(line) <= WIDTH else f"{line[: WIDTH - 3]}..." for line in lines)


def as_html(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """Return the same as a table of HTML."""
    left = 'style="text-align:left"'
    cells = "".join(
        f"<tr><th {left}>{escape(name)}</th><td {left}>{escape(text)}</td></tr>" for name, text in rows
    )
    return f"<p>{escape(title)}</p><table><tbody>{cells}</tbody></table>"


def _text(self: Any) -> str:
    return as_text(type(self).__name__, _rows(self))


def _rows(self: Any) -> list[tuple[str, str]]:
    shown = [f for f in fields(self) if f.repr and not f.name.startswith("_")]
    return [(f.name, one_line(getattr(self, f.name))) for f in shown]


def one_line(value: Any) -> str:
    """Return one line about a value: itself where it is short, else what and how much it is."""
    if getattr(value, "shape", ()) and hasattr(value, "dtype"):
        return f"array {tuple(value.shape)}"
    if value is None or isinstance(value, bool | int | float):
        return repr(value)
    if isinstance(value, str):
        return repr(value)
    if isinstance(value, Mapping):
        return _count_and_names(f"{len(value)} entries", [str(k) for k in value])
    if isinstance(value, Sequence | Set):
        plain = all(isinstance(x, str | int | float) or x is None for x in value)
        if plain:
            text = repr(tuple(value))
            return text if len(text) < 80 else f"{len(value)} values: {text[:60]}..."
        kinds = ", ".join(dict.fromkeys(type(x).__name__ for x in value))
        return f"{len(value)} of {kinds}"
    first = repr(value).splitlines()[0] if _is_short(value) else f"<{type(value).__name__}>"
    return first if len(first) < 90 else f"<{type(value).__name__}>"


def _is_short(value: Any) -> bool:
    """Whether a value's own text is cheap and short: that of a result is, that of a model need not be."""
    own = type(value).__repr__
    if is_dataclass(value):
        return own is _text or not type(value).__dataclass_params__.repr  # type: ignore[attr-defined]
    return own is not object.__repr__


def _count_and_names(count: str, names: list[str]) -> str:
    text = ", ".join(names)
    return f"{count}: {text}" if len(text) < 70 else f"{count}: {text[:60]}..."
