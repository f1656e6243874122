"""What `Recording.check` refuses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from smsid.errors import InconsistentChannelsError, RecordingError
from smsid.recording._clock import check_order
from smsid.recording._suspicion import suspicions
from smsid.recording.channels import quantity_of

if TYPE_CHECKING:
    from smsid.recording.recording import Recording

NORM_TOLERANCE = 1e-3
"""How far the norm of a quaternion may be from 1: logged digits, not another kind of data."""


def check_clocks(recording: Recording) -> None:
    """Raise `RecordingError` unless every clock is finite and strictly increasing."""
    for clock in recording.clocks:
        check_order(recording.dataset[clock].values, clock)


def check_finite(recording: Recording) -> None:
    """Raise `RecordingError` at the first channel with NaN or infinite samples."""
    for name in recording.channels:
        values = recording[name]
        bad = ~np.isfinite(values)
        if not bad.any():
            continue
        where = tuple(int(k) for k in np.argwhere(bad)[0])
        time = float(recording.time(name)[where[0]])
        rows = int(np.count_nonzero(bad.reshape(values.shape[0], -1).any(axis=1)))
        raise RecordingError(
            f"Channel '{name}' is {values[where]} at index {where[0]} (t = {time:.9g} s); "
            f"{rows} of {values.shape[0]} samples are not finite.",
            advice="Cut them off with window(t0, t1), or leave the channel out.",
            channel=name,
            index=where,
            time=time,
            count=rows,
        )


def check_gaps(recording: Recording) -> None:
    """Raise `RecordingError` when a clock has a gap."""
    gaps = recording.gaps()
    if gaps:
        longest = max(gaps, key=lambda gap: gap.duration)
        raise RecordingError(
            f"Clock '{longest.clock}' has a gap of {longest}; {len(gaps)} in all.",
            advice="Use the stretches between gaps: recording.window(t0, t1). Gaps are listed by gaps().",
            gaps=gaps,
        )


def check_quaternions(recording: Recording) -> None:
    """Raise `RecordingError` when a quaternion's norm is off 1 by more than `NORM_TOLERANCE`."""
    for name in recording.channels:
        if not quantity_of(name, unit=recording.unit(name)).is_quaternion:
            continue
        norms = np.linalg.norm(recording[name], axis=1)
        off = np.abs(norms - 1.0)
        if off.max() > NORM_TOLERANCE:
            index = int(np.flatnonzero(off > NORM_TOLERANCE)[0])
            raise RecordingError(
                f"Channel '{name}': the quaternion at index {index} "
                f"(t = {recording.time(name)[index]:.9g} s) has norm {norms[index]:.6g}; "
                f"{np.count_nonzero(off > NORM_TOLERANCE)} of {norms.size} are off.",
                advice="Are these the quaternion columns? If they are merely unnormalised, normalise them.",
                channel=name,
                index=index,
                norm=float(norms[index]),
            )


def check_components(recording: Recording) -> None:
    """Raise `InconsistentChannelsError` when a component of a channel contradicts another beyond doubt."""
    from smsid.recording.checks import channel_findings

    clear = [finding for finding in channel_findings(recording) if finding.clear]
    if clear:
        first = clear[0]
        raise InconsistentChannelsError(
            " ".join(finding.sentence for finding in clear),
            advice=f"{first.mend} To go on all the same: Recording.unchecked(), or the option --unchecked.",
            channel=first.channel,
            components=first.components,
            numbers=first.numbers,
            mend=first.mend,
            findings=tuple(clear),
        )


def check_units(recording: Recording) -> None:
    """Raise `InconsistentChannelsError` when channels contradict each other by a known unit or a sign."""
    clear = [suspicion for suspicion in suspicions(recording) if suspicion.clear]
    if clear:
        raise InconsistentChannelsError(
            " ".join(suspicion.sentence for suspicion in clear),
            advice="State the right unit, sign or convention in the mapping, or convert the array. "
            "To go on all the same: Recording.unchecked(), or the option --unchecked.",
            channel=clear[0].channel,
            numbers=(clear[0].ratio, clear[0].correlation),
            suspicions=tuple(clear),
        )
