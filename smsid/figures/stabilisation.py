"""The stabilisation diagram of a recording of Exp. 1."""

from __future__ import annotations

from typing import TYPE_CHECKING

from smsid.errors import NotIdentifiableError
from smsid.figures.canvas import COLOURS, canvas, legend_above
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.report.stabilisation import diagrams

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def stabilisation_figure(model: SpacecraftModel, recording: Recording, title: str = "") -> Figure:
    """Return poles over model orders, an axis for each sampling rate modes were read at.

    Raises `NotIdentifiableError` when the recording shows no modes: no thrust that bends an appendage with
    accelerometers on it.
    """
    found = diagrams(model, recording)
    if not found:
        raise NotIdentifiableError(
            f"'{recording.name}' shows no modes of an appendage.",
            advice="Give a recording with thrust and panel accelerometers.",
        )
    with canvas(1, len(found), height=2.6, squeeze=False, sharey=True) as (figure, axes):
        for ax, d in zip(axes[0], found, strict=True):
            for m in d.modes:
                ax.axvline(m.frequency, color=COLOURS[1], ls="--", lw=0.8)
                where = ax.get_xaxis_transform()
                text = f" {m.frequency:.4g} Hz"
                ax.text(
                    m.frequency, 0.01, text, transform=where, size=6.5, rotation=90, va="bottom", ha="left"
                )
            ax.plot(*d.points(False), ".", color=COLOURS[2], ms=3, label="not stable")
            ax.plot(*d.points(True), "o", mfc="none", color=COLOURS[0], ms=4, label="stable pole")
            ax.yaxis.get_major_locator().set_params(integer=True)
            ax.set_xlim(0.0, 0.32 * d.rate)
            ax.set_xlabel(f"frequency [Hz], {d.appendage} sampled at {d.rate:.3g} Hz")
        axes[0, 0].set_ylabel("model order")
        legend_above(axes[0, 0])
        if title:
            figure.suptitle(title, fontsize=9)
    return figure
