"""Signs and columns of joints and wheels, where the model does not explain a recording.

Channels of one group that are all turned round or exchanged agree with each other; only a model says that
they do not agree with the motion of the craft. The description's is taken as it is and allowed to err by a
share of what drives it: it may be wrong by a third.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

import numpy as np

from smsid.description.schema import Description
from smsid.errors import SmsidError
from smsid.estimation.flight import flight_of
from smsid.estimation.innovations import normalised_rmse
from smsid.estimation.joint_problem import thinned
from smsid.estimation.kalman import run_filter
from smsid.estimation.loosening import LOOSENED, loosened
from smsid.estimation.parameter_vector import Point
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

RATE = 10.0  # [1/s] of the samples that are looked at
CLEAR = 0.5  # of the errors as recorded, below which what is left tells that a column is wrong
POSITIONS = ("joint_position", "joint_velocity", "joint_acceleration")

Mended = Callable[[np.ndarray], np.ndarray]


def wrong_columns(description: Description, recordings: Sequence[Recording]) -> list[str]:
    """Return which joints or wheels seem to have a wrong sign or column, in sentences that say the mend."""
    point = Point.of(description)
    found = (_wrong_column(point, r, LOOSENED[0]) or _wrong_column(point, r, LOOSENED[1]) for r in recordings)
    return [words for words in found if words]


def _wrong_column(point: Point, recording: Recording, share: float) -> str:
    as_recorded = _errors(point, recording, share)
    likely = [
        (_errors(point, _mended(recording, quantities, mend), share), words)
        for words, quantities, mend in _hypotheses(point.base)
    ]
    left, words = min(likely, default=(np.inf, ""), key=lambda x: x[0])
    if not left < CLEAR * as_recorded:
        return ""
    left = 100.0 * left / as_recorded
    return f"in '{recording.name}' {words}: so mended, errors are {left:.0f} % as large. Mend the mapping"


def _errors(point: Point, recording: Recording, share: float) -> float:
    """Return the root mean square of what a model that may err leaves, over what it expects."""
    try:
        flight = flight_of(point, recording, recording.name)
        problem = thinned(loosened(flight.model, flight.problem, share), RATE)
        return normalised_rmse(run_filter(flight.model, problem))
    except SmsidError:
        return np.inf


def _hypotheses(model: SpacecraftModel) -> Iterator[tuple[str, tuple[str, ...], Mended]]:
    """Return what may be wrong in words, in channels of which quantities, and what mends samples (N, k)."""
    for names, quantities in ((model.arm_joints.names, POSITIONS), (model.wheels.names, ("wheel_rate",))):
        signs = np.ones((len(names), len(names))) - 2.0 * np.eye(len(names))
        for name, sign in zip(names, signs, strict=True):
            yield f"'{name}' seems to have the other sign", quantities, lambda x, s=sign: x * s
        for i, k in combinations(range(len(names)), 2):
            order = np.arange(len(names))
            order[[i, k]] = k, i
            words = f"'{names[i]}' and '{names[k]}' seem to be exchanged"
            yield words, quantities, lambda x, o=order: x[:, o]


def _mended(recording: Recording, quantities: Sequence[str], mend: Mended) -> Recording:
    own = [c for c in recording.channels if c.partition(".")[2] in quantities]
    return recording.with_channels({c: mend(np.asarray(recording[c])) for c in own})
