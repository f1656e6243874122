"""Consistency checks of channels, component by component: what contradicts what, and how to mend it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from smsid.errors import RecordingError
from smsid.recording.checks._consistency import channel_findings
from smsid.recording.checks.sample_faults import SampleFault

if TYPE_CHECKING:
    from smsid.recording.recording import Recording

__all__ = ["SampleFault", "channel_findings", "check_roles", "consistency_notes"]


def check_roles(recordings: Sequence[Recording]) -> None:
    """Raise `RecordingError` where there is no recording to identify from, or one that is for validation."""
    if not recordings:
        raise RecordingError("No recording was given.", advice="Give at least one.")
    for recording in recordings:
        if recording.role == "validation":
            raise RecordingError(
                f"'{recording.name}' is for validation.",
                advice="Identify from recordings in the role estimation.",
            )


def consistency_notes(recordings: Sequence[Recording]) -> list[str]:
    """Refuse recordings whose channels contradict each other beyond doubt; say what else is doubtful.

    Raises:
        RecordingError: as `Recording.check_consistency`.
    """
    return [f"'{r.name}' is doubtful: {said}" for r in recordings for said in r.check_consistency()]
