"""What `Recording.check` refuses."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from smsid._time_text import time_text
from smsid.errors import InconsistentChannelsError, RecordingError
from smsid.recording.channels import quantity_of
from smsid.recording.clock import check_order

if TYPE_CHECKING:
    from smsid.recording.checks import SampleFault
    from smsid.recording.recording import Recording

NORM_TOLERANCE = 1e-3
"""How far the norm of a quaternion may be from 1: logged digits, not another kind of data."""


def check_clocks(recording: Recording) -> None:
    """Raise `RecordingError` unless every clock is finite and strictly increasing."""
    for clock, times in recording.times().items():
        check_order(times, clock)


def check_finite(recording: Recording, *, missing: bool = False, sensors_may_pause: bool = False) -> None:
    """Raise `RecordingError` at the first channel with infinite samples, or NaN where none may be missing.

    Any channel may miss samples where ``missing``, all but commands where ``sensors_may_pause``.
    """
    for name in recording.channels:
        values = recording[name]
        allowed = missing or (sensors_may_pause and not name.startswith("command."))
        bad = np.isinf(values) if allowed else ~np.isfinite(values)
        if not bad.any():
            continue
        where = tuple(int(k) for k in np.argwhere(bad)[0])
        time = float(recording.time(name)[where[0]])
        at = time_text(time, float(recording.time(name)[0]))
        rows = int(np.count_nonzero(bad.reshape(values.shape[0], -1).any(axis=1)))
        raise RecordingError(
            f"Channel '{name}' is {values[where]} at index {where[0]} (t = {at}); "
            f"{rows} of {values.shape[0]} samples are not finite.",
            advice="Cut them off with window(t0, t1), or leave the channel out.",
            channel=name,
            index=where,
            time=time,
            count=rows,
        )


def check_gaps(recording: Recording, clocks: Collection[str]) -> None:
    """Raise `RecordingError` when one of these clocks has a gap."""
    gaps = tuple(g for g in recording.gaps() if g.clock in clocks)
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
        if (off > NORM_TOLERANCE).any():  # missing samples are none of them
            index = int(np.flatnonzero(off > NORM_TOLERANCE)[0])
            at = time_text(recording.time(name)[index], recording.time(name)[0])
            raise RecordingError(
                f"Channel '{name}': the quaternion at index {index} "
                f"(t = {at}) has norm {norms[index]:.6g}; "
                f"{np.count_nonzero(off > NORM_TOLERANCE)} of {norms.size} are off.",
                advice="Are these the quaternion columns? If they are merely unnormalised, normalise them.",
                channel=name,
                index=index,
                norm=float(norms[index]),
            )


@dataclass(frozen=True)
class Contradictions:
    """What contradicts what in a recording."""

    findings: tuple[SampleFault, ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """All that was found, in sentences with the mend."""
        return tuple(f"{f.sentence} {f.mend}" for f in self.findings)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What was found but is not beyond doubt, in sentences."""
        return Contradictions(tuple(f for f in self.findings if not f.clear)).sentences

    def refuse(self) -> None:
        """Raise `InconsistentChannelsError` for what is beyond doubt."""
        clear = [f for f in self.findings if f.clear]
        if clear:
            first = clear[0]
            raise InconsistentChannelsError(
                " ".join(f.sentence for f in clear),
                advice=f"{first.mend} To go on all the same: Recording.unchecked(), or the option "
                "--unchecked.",
                channel=first.channel,
                components=first.components,
                numbers=first.numbers,
                mend=first.mend,
                findings=tuple(clear),
            )


def contradictions_of(recording: Recording) -> Contradictions:
    """Return what contradicts what among the samples that are there."""
    from smsid.recording.checks import channel_findings

    check_clocks(recording)
    whole = finite_part(recording)
    if whole is None:
        return Contradictions(())
    check_quaternions(whole)
    return Contradictions(channel_findings(whole))


def finite_part(recording: Recording) -> Recording | None:
    """Return a recording without samples that are missing or not finite; ``None`` where nothing is left.

    A channel of which less than half is there is left out, and so are the others' samples at its holes.
    """
    missing = {
        name: ~np.isfinite(recording[name]).reshape(len(recording[name]), -1).all(axis=1)
        for name in recording.channels
    }
    if not any(bad.any() for bad in missing.values()):
        return recording
    kept = [name for name, bad in missing.items() if bad.mean() < 0.5]
    if not kept:
        return None
    rows: dict[str, np.ndarray] = {}
    for name in kept:
        clock = recording.clock_of(name)
        rows[clock] = np.asarray(~missing[name] if clock not in rows else rows[clock] & ~missing[name])
    if not all(good.any() for good in rows.values()):
        return None
    left = recording.without(*(n for n in recording.channels if n not in kept))
    return left.at_rows({clock: np.flatnonzero(good) for clock, good in rows.items()})
