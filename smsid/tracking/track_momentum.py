"""Follow combinations of inertial parameters through recordings by recursive total least squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smsid._threads import single_threaded
from smsid.description.schema import Description
from smsid.errors import RecordingError
from smsid.estimation.identify_flights import labels_of
from smsid.identify.estimate import Estimate
from smsid.model.column_order import order_columns
from smsid.recording import Recording
from smsid.tracking._momentum_tracker import EQUATIONS, MomentumTracker
from smsid.tracking._sample import samples_of
from smsid.tracking._update import Update
from smsid.tracking.followed_parameters import UNCERTAIN
from smsid.tracking.history import TrackHistory


@single_threaded
def track_momentum(
    description: Description,
    recordings: Sequence[Recording],
    *,
    estimate: Estimate | None = None,
    cad: float = UNCERTAIN,
    memory: float | None = None,
    gap: float = 0.0,
) -> tuple[TrackHistory, MomentumTracker]:
    """Run a `MomentumTracker` through recordings; return a row per window, and the tracker as it ends.

    ``recordings`` each begin at rest and have no thrust; ``gap`` is the time between them [s]. The others are
    the tracker's. The history has no degrees of freedom, and for channels the kinds of equation.

    Raises:
        RecordingError: no recording, thrust in one, or none long enough for a window.
        NotIdentifiableError: a recording does not begin at rest.
    """
    if not recordings:
        raise RecordingError("No recording was given.", advice="Give at least one.")
    tracker = MomentumTracker(description, estimate=estimate, cad=cad, memory=memory)
    rows: list[tuple[float, int, Update]] = []
    shift = 0.0
    for number, recording in enumerate(recordings):
        tracker.begin_recording()
        ordered = order_columns(recording, tracker.model)
        told = [*tracker.update_all(samples_of(ordered)), *tracker.flush()]
        if not told:
            raise RecordingError(
                f"'{recording.name}' is too short to tell motion from errors.",
                advice="Give recordings of half a minute or more.",
            )
        begin = min(float(ordered.time(c)[0]) for c in ordered.channels)
        rows += [(u.time - begin + shift, number, u) for u in told]
        shift = rows[-1][0] + gap
    updates = [u for _, _, u in rows]
    nothing = np.zeros((len(rows), 0))
    history = TrackHistory(
        description=description.name,
        time=np.array([t for t, _, _ in rows]),
        own_time=np.array([u.time for u in updates]),
        recording=np.array([number for _, number, _ in rows]),
        recordings=tuple(labels_of(recordings)),
        names=tracker.names,
        units=tracker.units,
        described=tracker.nominal,
        values=np.array([u.values for u in updates]),
        sigmas=np.array([u.sigmas for u in updates]),
        dofs=(),
        position=nothing,
        position_sigma=nothing,
        velocity=nothing,
        velocity_sigma=nothing,
        channels=EQUATIONS,
        fit=np.array([u.normalised for u in updates]),
        covariance=tracker.parameter_covariance,
        events=tuple(tracker.log.last),
        notes=("slosh and panels are taken as described; recursive total least squares of the momentum",),
        conditions={"samples": float(tracker.samples)},
    )
    return history, tracker
