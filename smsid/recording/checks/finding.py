"""What a consistency check found."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """A fault of one or more components of a channel.

    ``kind`` is ``outlier``, ``stuck``, ``saturated``, ``held``, ``full turn``, ``swapped``, ``sign``,
    ``unit``, ``scale``, ``delay`` or ``quaternion``. ``other`` is the channel it was compared with (empty:
    none); a pair of channels alone cannot tell which of the two is wrong. ``numbers`` is the evidence, all
    finite. ``clear`` says that the fault is beyond doubt; otherwise it is a note.
    """

    channel: str
    components: tuple[str, ...]
    kind: str
    other: str
    numbers: tuple[float, ...]
    clear: bool
    sentence: str
    mend: str
