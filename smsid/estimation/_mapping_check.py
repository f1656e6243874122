"""Signs and columns of joints, wheels and commands, where the model does not explain a recording.

Channels of one group that are all turned round or exchanged agree with each other; only a model says that
they do not agree with the motion of the craft. The description's is taken as it is and allowed to err by a
share of what drives it: it may be wrong by a third.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from smsid.description.schema import Description
from smsid.errors import SmsidError
from smsid.estimation._maximum import maximise
from smsid.estimation.flight import Flight, flight_of
from smsid.estimation.innovations import normalised_rmse
from smsid.estimation.input_hold import input_channels
from smsid.estimation.joint_problem import thin_problem
from smsid.estimation.kalman import run_filter
from smsid.estimation.loosening import loosen_model
from smsid.estimation.parameter_vector import Point
from smsid.estimation.unknowns import unknowns_of
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

ERROR_SHARES = (0.3, 0.03)  # shares of what drives the motion by which a description may err
CHECK_RATE = 10.0  # [1/s] of the samples that are looked at
CLEAR_SHARE = 0.5  # of the errors as recorded, below which what is left tells that a column is wrong
FITTED_SHARE = 0.5  # the same of their squares where parameters are fitted
FOLLOWED_RATIO = 3.0  # times what a model that may err expects, beyond which it follows no motion
MOST_FITTED = 3  # hypotheses, the likeliest, whose parameters are fitted where none is clear without
OF_JOINTS = ("joint_position", "joint_velocity", "joint_acceleration", "joint_torque")
OF_WHEELS = ("wheel_rate", "wheel_torque")

Correction = Callable[[np.ndarray], np.ndarray]


def wrong_columns(description: Description, recordings: Sequence[Recording]) -> list[str]:
    """Return which joints, wheels or commands seem to have a wrong sign or column, and the mend, in words."""
    point = Point.of(description)
    found = (_wrong_column(point, order_columns(r, point.base)) for r in recordings)
    return [words for words in found if words]


def follows(description: Description, recording: Recording) -> bool:
    """Return whether a model that may err a little follows a recording as it is."""
    point = Point.of(description)
    return _errors(point, order_columns(recording, point.base), ERROR_SHARES[-1]) < FOLLOWED_RATIO


def _wrong_column(point: Point, recording: Recording) -> str:
    likely = [
        (0.0, words, _with_correction(recording, channels, mend))
        for words, channels, mend in _hypotheses(point.base, recording)
    ]
    for share in ERROR_SHARES:
        as_recorded = _errors(point, recording, share)
        likely = [(_errors(point, r, share), words, r) for _, words, r in likely]
        likely = sorted((x for x in likely if x[0] < as_recorded), key=lambda x: x[0])
        if likely and likely[0][0] < min(CLEAR_SHARE * as_recorded, FOLLOWED_RATIO):
            return _sentence(recording, likely[0][1], likely[0][0] / as_recorded)
    likely = [(_fitted_errors(point, r), words, r) for _, words, r in likely[:MOST_FITTED]]
    left, words, _ = min(likely, default=(np.inf, "", recording), key=lambda x: x[0])
    share = left / _fitted_errors(point, recording) if np.isfinite(left) else np.inf
    return _sentence(recording, words, share) if share**2 < FITTED_SHARE and left < FOLLOWED_RATIO else ""


def _sentence(recording: Recording, words: str, share: float) -> str:
    errors = f"errors are {100.0 * share:.0f} % as large"
    return f"in '{recording.name}' {words}: so mended, {errors}. Mend the mapping"


def _errors(point: Point, recording: Recording, share: float) -> float:
    """Return the root mean square of what a model that may err leaves, over what it expects."""
    try:
        flight = _looked_at(point, recording, share)
        return normalised_rmse(run_filter(flight.model, flight.problem))
    except SmsidError:
        return np.inf


def _fitted_errors(point: Point, recording: Recording) -> float:
    """Return the same with parameters fitted, of a model that may hardly err."""
    try:
        flight = _looked_at(point, recording, ERROR_SHARES[-1])
        unknowns = unknowns_of(point, components=True).unknowns
        sums = maximise(point, unknowns, [flight], enough=1.0)[0].terms[0].innovations
        return float(np.sqrt(sums.squares.sum() / sums.count.sum()))
    except SmsidError:
        return np.inf


def _looked_at(point: Point, recording: Recording, share: float) -> Flight:
    flight = flight_of(point, recording, recording.name)
    return replace(
        flight, problem=thin_problem(loosen_model(flight.model, flight.problem, share), CHECK_RATE)
    )


def _hypotheses(model: SpacecraftModel, recording: Recording) -> Iterator[tuple[str, list[str], Correction]]:
    """Return what may be wrong in words, in which channels, and what mends samples (N, k) of them."""
    groups = []
    for names, quantities in ((model.arm_joints.names, OF_JOINTS), (model.wheels.names, OF_WHEELS)):
        groups.append((names, [c for c in recording.channels if c.partition(".")[2] in quantities]))
    for field, channel in input_channels(model, recording).items():
        if field in ("force", "torque") and np.any(recording[channel]):
            groups.append((tuple(f"{channel}.{a}" for a in "xyz"), [channel]))
    for names, channels in groups:
        signs = np.ones((len(names), len(names))) - 2.0 * np.eye(len(names))
        for name, sign in zip(names, signs, strict=True):
            yield f"'{name}' seems to have the other sign", channels, lambda x, s=sign: x * s
        if len(names) > 1:
            yield f"all of {', '.join(names)} seem to have the other sign", channels, lambda x: -x
        for i, k in combinations(range(len(names)), 2):
            order = np.arange(len(names))
            order[[i, k]] = k, i
            words = f"'{names[i]}' and '{names[k]}' seem to be exchanged"
            yield words, channels, lambda x, o=order: x[:, o]


def _with_correction(recording: Recording, channels: Sequence[str], mend: Correction) -> Recording:
    return recording.with_channels({c: mend(np.asarray(recording[c])) for c in channels})
