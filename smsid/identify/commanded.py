"""What acts of what was commanded: effects may stand between command and thruster."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.effects.base import Effect
from smsid.errors import RecordingError
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

FEW = 0.02  # share of samples at which a force may change and still count as made of steps


@dataclass(frozen=True)
class BusWrench:
    """Force [N] and torque [N m] on the bus (N, 6) in body axes at ``times`` (N,) [s].

    ``steps``: the value holds until the next time; otherwise it is smooth between them.
    """

    times: np.ndarray
    values: np.ndarray
    steps: bool


def excited_axes(recording: Recording) -> str:
    """Return the body axes along which thrust acted, as letters of 'xyz'."""
    if "command.force" not in recording:
        return ""
    peak = np.abs(recording["command.force"]).max(axis=0)
    return "".join(
        a for a, f in zip("xyz", peak, strict=True) if f > 1e-6 * max(peak.max(), 1e-30) and f > 0.0
    )


def actual_thrust(model: SpacecraftModel, recording: Recording, *, torque: bool = False) -> BusWrench:
    """Return the thrust of a recording after every effect's `drive`; with the commanded ``torque``, or zero.

    Raises `RecordingError` for commands that are not finite or not on one clock.
    """
    times = recording.time("command.force")
    values = np.zeros((len(times), 6))
    values[:, :3] = recording["command.force"]
    if torque and "command.torque" in recording:
        if len(recording["command.torque"]) != len(times):
            raise RecordingError(
                "'command.force' and 'command.torque' are on different clocks.",
                advice="Resample one of them.",
            )
        values[:, 3:] = recording["command.torque"]
    if not np.isfinite(values).all():
        raise RecordingError("'command.force' is not finite everywhere.", advice="Log what was commanded.")
    changes = np.count_nonzero(np.any(np.diff(values, axis=0) != 0.0, axis=1))
    commanded = BusWrench(times, values, bool(changes <= FEW * len(times)))
    if all(type(e).drive is Effect.drive for e in model.description.effect) or not values.any():
        return commanded
    return _wrench_of_actuators(model, commanded)


def _wrench_of_actuators(model: SpacecraftModel, commanded: BusWrench) -> BusWrench:
    # simulation is not needed without such effects, hence the imports here
    from smsid.inputs.inputs import Inputs
    from smsid.inputs.signals import Sampled

    times, degree = commanded.times, 0 if commanded.steps else 3
    force, torque = (Sampled.from_samples(times, x, degree) for x in np.split(commanded.values, 2, axis=1))
    driven = Inputs(force=force, torque=torque).driven(model)
    signals = [driven.force, driven.torque]
    # a held signal jumps at every sample of its own; only what jumps between them is new
    more = [b for s in signals if s is not None for b in s.breakpoints if times[0] < b < times[-1]]
    at = np.union1d(times, more)
    step = float(np.median(np.diff(times)))
    at = at[np.concatenate([[True], np.diff(at) > 1e-6 * step])]
    values = [np.array([s(t) for t in at]) if s is not None else np.zeros((len(at), 3)) for s in signals]
    return BusWrench(at, np.hstack(values), commanded.steps)
