"""Channels of a recording over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from smsid.figures.canvas import COLOURS, canvas
from smsid.recording import Recording
from smsid.recording._checks import check_clocks
from smsid.report.numbers import unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 4000  # of a curve; more cannot be seen
MOST = 12


def recording_figure(recording: Recording, channels: Sequence[str] = (), title: str = "") -> Figure:
    """Return a figure with one axis per channel, a curve per component.

    Without ``channels`` all but hidden truths are drawn, at most twelve. Raises `RecordingError` for a
    channel that is not there or a clock that is none.
    """
    recording.require(*channels)
    check_clocks(recording)
    chosen = list(channels) or [c for c in recording.channels if not c.startswith("truth")][:MOST]
    with canvas(len(chosen), height=0.4 + 1.05 * len(chosen), sharex=True, squeeze=False) as (figure, axes):
        for ax, name in zip(axes[:, 0], chosen, strict=True):
            time, values = recording.time(name), recording[name]
            flat = values.reshape(len(time), -1)
            every = max(1, len(time) // POINTS)
            labels = component_labels(recording, name, flat.shape[1])
            for k in range(flat.shape[1]):
                label = labels[k] if k < len(labels) else None
                ax.plot(time[::every], flat[::every, k], color=COLOURS[k % len(COLOURS)], label=label, lw=0.8)
            shown = unit(recording.unit(name))
            ax.set_title(name + (f" [{shown}]" if shown else ""))
            if 1 < flat.shape[1] <= 6:
                ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, handlelength=1.0)
        axes[-1, 0].set_xlabel("time [s]")
        times = [recording.time(c) for c in chosen]
        axes[-1, 0].set_xlim(min(t[0] for t in times), max(t[-1] for t in times))
        if title:
            figure.suptitle(title, fontsize=9)
    return figure


def component_labels(recording: Recording, name: str, width: int) -> tuple[str, ...]:
    """Return names of a channel's components: its labels, or axes."""
    labels = recording.labels
    for key in ("joint", "wheel"):
        known = labels.get(f"{name.partition('.')[0]}.{key}", labels.get(key, ()))
        if name.partition(".")[2].startswith(key) and len(known) == width:
            return tuple(known)
    return tuple("xyzw"[:width]) if width in (3, 4) else tuple(str(k + 1) for k in range(width))
