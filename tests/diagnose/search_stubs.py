"""Stand-ins for what a search handles: problems, candidates, scores."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from smsid.diagnose.score_test import Score


@dataclass(frozen=True)
class Whole:
    """A problem as far as it is put together again."""

    data: SimpleNamespace
    noise: str
    coloured: bool = False
    substep: float = 0.1


def candidate(key, family="friction"):
    return SimpleNamespace(
        key=key,
        location=key[1],
        family=family,
        effect=None,
        simpler=(),
        free=(f"{key[1]}.size",),
        also=(),
        parameters={f"{key[1]}.size"},
        holds=lambda other: False,
    )


def score_of(candidate):
    return Score(candidate, 30.0, 1, np.zeros(1), np.eye(1), 1.0, np.zeros((1, 1)), np.zeros((1, 1)))
