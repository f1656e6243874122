"""A text for results that fits a screen: arrays by their shape, long tuples by their length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

LINES, WIDTH = 30, 110
T = TypeVar("T", bound=type)


def short_repr(cls: T) -> T:
    """Give a dataclass a ``repr`` of at most `LINES` lines: a field a line, long values told, not shown."""
    cls.__repr__ = _text  # type: ignore[method-assign]
    return cls


def _text(self: Any) -> str:
    shown = [f for f in fields(self) if f.repr and not f.name.startswith("_")]
    lines = [f"  {f.name}: {told(getattr(self, f.name))}"[:WIDTH] for f in shown[: LINES - 2]]
    if len(shown) > len(lines):
        lines.append(f"  {len(shown) - len(lines)} more fields")
    return "\n".join([type(self).__name__, *lines])


def told(value: Any) -> str:
    """Return one line about a value: itself where it is short, else what and how much it is."""
    if getattr(value, "shape", ()) and hasattr(value, "dtype"):
        return f"array {tuple(value.shape)}"
    if value is None or isinstance(value, bool | int | float):
        return repr(value)
    if isinstance(value, str):
        return repr(value)
    if isinstance(value, Mapping):
        return _counted(f"{len(value)} entries", [str(k) for k in value])
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


def _counted(count: str, names: list[str]) -> str:
    text = ", ".join(names)
    return f"{count}: {text}" if len(text) < 70 else f"{count}: {text[:60]}..."
