"""From a file to a figure: what is in the file is told from its content, or said by its kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from smsid.campaign.store import read_store
from smsid.campaign.summary import Summary, summarise
from smsid.description import load_description
from smsid.diagnose import load_diagnosis
from smsid.errors import NotIdentifiableError, SmsidError
from smsid.figures.canvas import COLOURS, canvas, legend_above, save
from smsid.figures.diagnosis import diagnosis_figure
from smsid.figures.estimate import estimate_figure
from smsid.identify.estimate import load_estimate
from smsid.model import build_model
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording, load_recording
from smsid.recording._checks import check_clocks
from smsid.report.numbers import unit
from smsid.report.parameters import clip_text
from smsid.report.stabilisation import diagrams

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 4000  # of a curve; more cannot be seen
MOST = 12


@dataclass(frozen=True)
class Request:
    """What to draw: the ``file``, and what some figures need beside it.

    ``description``: TOML of the spacecraft (stabilisation diagram; or truth of an estimate's parameters with
    ``truth``). ``channels``: of a recording, all when empty.
    """

    file: Path
    description: Path | None = None
    channels: tuple[str, ...] = ()
    truth: Path | None = None
    title: str = ""


def draw(kind: str, request: Request, output: Path) -> Path:
    """Draw a figure of a kind (see `KINDS`) and write it; the suffix of ``output`` decides the format.

    Raises `SmsidError` for a kind there is none of, a file that is no such thing, or another suffix;
    `MissingDependencyError` without matplotlib.
    """
    if kind not in KINDS:
        raise SmsidError(f"There is no figure '{kind}'.", advice=f"Choose one of {', '.join(KINDS)}.")
    if not request.file.is_file():
        raise SmsidError(f"The file '{request.file}' does not exist.", advice="Check the path.")
    return save(KINDS[kind](request), output)


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


def campaign_figure(summary: Summary, title: str = "") -> Figure:
    """Return coverage and relative spread by parameter; raises `SmsidError` where no interval was tested."""
    tested = [p for p in summary.parameters if p.coverage is not None and p.coverage_band is not None]
    if not tested:
        raise SmsidError("No interval of the campaign was tested.", advice="It needs a truth and sigmas.")
    places = range(len(tested))
    with canvas(1, 2, height=0.9 + 0.17 * len(tested), sharey=True) as (figure, (left, right)):
        for k, p in zip(places, tested, strict=True):
            _band(left, k, p.coverage, p.coverage_band, p.coverage_holds)
            _band(right, k, p.ratio, p.ratio_band, p.ratio_holds)
        left.axvline(0.95, color="#555", ls="--", lw=0.8)
        right.axvline(1.0, color="#555", ls="--", lw=0.8)
        left.set_yticks(list(places), [clip_text(p.name, 40) for p in tested], fontsize=6.5)
        left.set_ylim(len(tested) - 0.4, -0.6)
        left.set_xlabel("share of runs whose 95 % interval holds the truth")
        right.set_xlabel("spread / predicted standard deviation")
        for ax in (left, right):
            ax.grid(axis="y", visible=False)
        left.set_title(f"{summary.runs} runs; shaded: bands at {summary.level:g} over all parameters")
        if title:
            figure.suptitle(title, fontsize=9)
    return figure


def _band(ax, k: int, value: float | None, band: tuple[float, float] | None, holds: bool | None) -> None:  # type: ignore[no-untyped-def]
    if value is None or band is None:
        return
    ax.barh(k, band[1] - band[0], left=band[0], height=0.6, color="#e9edf2")
    ax.plot(value, k, "o" if holds else "D", color=COLOURS[0 if holds else 1], ms=3.2)


def _estimate(request: Request) -> Figure:
    truth = load_estimate(request.truth) if request.truth is not None else None
    return estimate_figure(load_estimate(request.file), truth, request.title)


def _stabilisation(request: Request) -> Figure:
    if request.description is None:
        raise SmsidError(
            "A stabilisation diagram needs to know which sensor sits on which appendage.",
            advice="Pass the spacecraft's TOML by --description.",
        )
    model = build_model(load_description(request.description))
    return stabilisation_figure(model, load_recording(request.file), request.title)


def _campaign(request: Request) -> Figure:
    header, records = read_store(request.file)
    return campaign_figure(summarise(records), request.title or str(header.plan["name"]))


KINDS: dict[str, Callable[[Request], Figure]] = {
    "recording": lambda r: recording_figure(load_recording(r.file), r.channels, r.title),
    "estimate": _estimate,
    "stabilisation": _stabilisation,
    "diagnosis": lambda r: diagnosis_figure(load_diagnosis(r.file), r.title),
    "campaign": _campaign,
}
