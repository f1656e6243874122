"""How a time of a recording is written so that it can be found."""

from __future__ import annotations

LARGE = 1e5
"""From this size on a stamp [s] counts from an epoch, not from the start of the recording."""


def time_text(time: float, start: float | None = None) -> str:
    """Return a time [s] in words, to a tenth of a millisecond or better, as `Recording.window` takes it.

    Stamps as large as those since 1970 tell little by themselves: where ``start`` [s], the recording's first
    time, is given, they are followed by the time since then.
    """
    text = f"{stamp_text(time)} s"
    if start is None or abs(time) < LARGE:
        return text
    return f"{text}, {stamp_text(round(time - start, 4))} s after the start"


def stamp_text(time: float) -> str:
    """Return the digits of a time, four or more after the point where they are not zero; of any unit."""
    return f"{time:.4f}".rstrip("0").rstrip(".") if 100.0 <= abs(time) < 1e22 else f"{time:.6g}"


def about_text(time: float) -> str:
    """Return four digits of a time [s] that is estimated; of a stamp since an epoch, as `stamp_text`."""
    return f"{time:.4g}" if abs(time) < LARGE else stamp_text(time)
