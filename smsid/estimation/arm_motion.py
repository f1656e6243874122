"""A welded arm from how it moves under its commanded torques, by the filter, as a spacecraft is.

Equations of torques (`smsid.arm`) are linear and fast, but need accelerations, and know only what enters
torques linearly. The likelihood of the motion takes every effect: delays, backlash, errors of encoders and
clocks - whatever a diagnosis finds of an arm. Torques are believed as commanded, where an effect does not say
otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from smsid.description.schema import Description
from smsid.errors import DescriptionError, RecordingError
from smsid.estimation.flight import FlightOptions
from smsid.estimation.identify import IdentificationRun
from smsid.estimation.identify_flights import identify_flights
from smsid.likelihood.prior import Cad
from smsid.recording import Recording

TORQUES = "command.joint_torque"


def why_by_motion(description: Description, method: str) -> str:
    """Return why an arm is identified by its motion: asked for, or effects that equations of torques do not
    know; empty if by its torques.
    """
    if method == "filter":
        return "asked for"
    others = [e.name for e in description.effect if not e.by_torques]
    verb = "does" if len(others) == 1 else "do"
    return f"{', '.join(others)} {verb} not enter torques linearly" if others else ""


def identify_arm_motion(
    description: Description,
    recordings: Sequence[Recording],
    *,
    reason: str,
    cad: Cad | None = None,
    options: FlightOptions | None = None,
    tell: Callable[[str], None] | None = None,
) -> IdentificationRun:
    """Estimate the bodies and listed effects of a welded arm, jointly from all recordings.

    Args:
        description: with ``root = "fixed"``; its values are the first guess, its priors what is known.
        recordings: with commanded torques, in the role estimation.
        reason: why so, for the notes.
        cad: what is known of rigid bodies, as in `smsid.likelihood.refine`.
        options: how a recording is taken; joints follow their commands in any case.
        tell: hears lines of progress.

    Raises:
        DescriptionError: it is no welded arm.
        RecordingError: torques were not commanded, or as `identify_flights`.
        NotIdentifiableError: as `identify_flights`.
        SimulationError: as `identify_flights`.
    """
    if description.root != "fixed":
        raise DescriptionError(
            f"'{description.name}' is no welded arm.", advice="Use `smsid.estimation.identify_spacecraft`."
        )
    silent = [r.name for r in recordings if TORQUES not in r]
    if silent:
        raise RecordingError(
            f"'{silent[0]}' has no commanded torques ({TORQUES}), which an arm's motion is predicted from: "
            f"{reason}.",
            advice="Import the commanded torques; or identify by measured ones (--method ml), with effects "
            "alone that enter torques linearly.",
            channels=tuple(c for r in recordings for c in r.channels),
        )
    driven = replace(options or FlightOptions(), drive="command")
    found = identify_flights(description, recordings, cad=cad, options=driven, tell=tell)
    first, *others = found.estimate.notes
    notes = (first, f"fitted to the motion under commanded torques: {reason}", *others)
    estimate = replace(found.estimate, notes=notes)
    return IdentificationRun(estimate, None, None, found, reason, found.quality, found.contradictions)
