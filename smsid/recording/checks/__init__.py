"""Consistency checks of channels, component by component: what contradicts what, and how to mend it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from smsid.recording.checks.consistency import channel_findings
from smsid.recording.checks.sample_faults import SampleFault

if TYPE_CHECKING:
    from smsid.recording.recording import Recording

__all__ = ["SampleFault", "channel_findings", "consistency_notes"]


def consistency_notes(recordings: Sequence[Recording]) -> list[str]:
    """Refuse recordings whose channels contradict each other beyond doubt; say what else is doubtful.

    Raises:
        RecordingError: as `Recording.check_consistency`.
    """
    return [f"'{r.name}' is doubtful: {said}" for r in recordings for said in r.check_consistency()]
