"""The motion that a tracker believed in, as states to replay."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from smsid.errors import RecordingError
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate import States

if TYPE_CHECKING:
    from smsid.tracking.history import TrackHistory


def tracked_states(model: SpacecraftModel, history: TrackHistory) -> States:
    """Return the motion of a track, slosh and bending with it, as states of a model; no forces are known.

    Smoothed by all that was read, where the track is.

    Raises `RecordingError` for a track of a spacecraft with other degrees of freedom.
    """
    from smsid.tracking.track_recordings import dof_names  # the tracker takes time to load

    if (names := tuple(dof_names(model))) != history.dofs:
        other = sorted(set(history.dofs) ^ set(names))
        raise RecordingError(
            f"The track is of a spacecraft with other degrees of freedom ({', '.join(other[:6])}).",
            advice="Give the description that was tracked.",
            dofs=other,
        )
    kept = np.flatnonzero(np.diff(history.time, prepend=-np.inf) > 0.0)
    known = history.smoothed or history
    place, v = known.position[kept], known.velocity[kept]
    q = np.zeros((len(kept), model.nq))
    for joint in list(model.pin.joints)[1:]:
        own = place[:, joint.idx_v : joint.idx_v + joint.nv]
        if joint.nv == 6:
            turns = [pin.Quaternion(pin.exp3(x)).coeffs() for x in own[:, 3:]]
            own = np.hstack([own[:, :3], np.array(turns)])
        elif joint.nq > joint.nv:
            own = np.hstack([np.cos(own), np.sin(own)])
        q[:, joint.idx_q : joint.idx_q + joint.nq] = own
    nothing = np.zeros_like(v)
    return States(history.time[kept], q, v, nothing, nothing, nothing)
