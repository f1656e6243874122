"""Consistency checks of channels, component by component: what contradicts what, and how to mend it."""

from smsid.recording.checks.consistency import channel_findings
from smsid.recording.checks.finding import Finding

__all__ = ["Finding", "channel_findings"]
