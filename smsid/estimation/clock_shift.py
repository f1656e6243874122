"""Recordings whose stamps count from an epoch, on a clock that begins near zero.

Near 1.7e9 s stamps are 0.24 us apart: steps of derivatives by a delay, and the two sides of a jump, are not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smsid.description.schema import Description
from smsid.recording import Recording

YEARS = 1e8  # [s], three years: what is further from zero, or from what came before, counts from elsewhere


def clock_shift(recordings: Sequence[Recording]) -> float:
    """Return what is added to the stamps of recordings [s]: whole seconds, below zero.

    Zero but where all count from an epoch: then the first of them begins near zero.
    """
    first = [float(r.time(c)[0]) for r in recordings for c in r.channels if len(r.time(c))]
    return -float(np.floor(min(first))) if first and min(first) > YEARS else 0.0


def on_shifted_clock(description: Description, shift: float) -> Description:
    """Return a description on a clock that shows ``shift`` [s] more: when effects and errors begin."""
    if not shift:
        return description
    effects = tuple(e.later(shift) for e in description.effect)
    sensors = tuple(
        s.model_copy(update={"errors": {q: e.later(shift) for q, e in s.errors.items()}})
        for s in description.sensor
    )
    return description.model_copy(update={"effect": effects, "sensor": sensors})
