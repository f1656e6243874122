"""Recordings whose stamps count from an epoch, on a clock that begins near zero.

Near 1.7e9 s stamps are 0.24 us apart: steps of derivatives by a delay, and the two sides of a jump, are not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smsid._time_text import LARGE
from smsid.description.schema import Description
from smsid.recording import Recording


def clock_shift(recordings: Sequence[Recording]) -> float:
    """Return by how much later recordings are to be taken than by their own clocks [s], whole seconds.

    Zero but where all count from an epoch: then the first of them begins near zero.
    """
    first = [float(r.time(c)[0]) for r in recordings for c in r.channels if len(r.time(c))]
    return -float(np.floor(min(first))) if first and min(first) > LARGE else 0.0


def on_shifted_clock(description: Description, shift: float) -> Description:
    """Return a description whose effects begin ``shift`` [s] later, as on a clock that shows so much more."""
    starts = [getattr(e, "start", None) for e in description.effect]
    if not shift or all(s is None for s in starts):
        return description
    effects = tuple(
        e if s is None else e.model_copy(update={"start": s + shift})
        for e, s in zip(description.effect, starts, strict=True)
    )
    return description.model_copy(update={"effect": effects})
