"""From a file to a figure: what is in the file is told from its content, or said by its kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from smsid.campaign.store import read_store
from smsid.campaign.summary import Summary, summarise
from smsid.description import load_description
from smsid.diagnose import load_diagnosis
from smsid.diagnose.result import Diagnosis
from smsid.errors import NotIdentifiableError, SmsidError
from smsid.figures._canvas import COLOURS, picture, save
from smsid.identify.estimate import Estimate, load_estimate
from smsid.identify.estimate_text import asked_for
from smsid.model import build_model
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording, load_recording
from smsid.recording.channel_checks import check_clocks
from smsid.report.axes import Axis
from smsid.report.campaign import coverage_figures
from smsid.report.diagnosis_map import diagnosis_map
from smsid.report.model import Figure as Chart
from smsid.report.numbers import unit
from smsid.report.parameters import identifiability
from smsid.report.plot import Curve, Plot
from smsid.report.stabilisation import diagrams, stabilisation_figures

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
    along = Axis.over("time [s]", [recording.time(c)[[0, -1]] for c in chosen], room=0.0)
    charts = []
    for name in chosen:
        time = recording.time(name)
        every = slice(None, None, max(1, len(time) // POINTS))
        values = recording[name].reshape(len(time), -1)[every]
        labels = component_labels(recording, name, values.shape[1])
        pairs = enumerate(zip(labels, values.T, strict=True))
        curves = [Curve(label, time[every], x, k % len(COLOURS)) for k, (label, x) in pairs]
        plot = Plot(along, Axis.over(unit(recording.unit(name)), [values]), curves, name, 105)
        charts.append(Chart(name, name, plot))
    return picture(charts, title)


def component_labels(recording: Recording, name: str, width: int) -> tuple[str, ...]:
    """Return names of a channel's components: its labels, or axes."""
    labels = recording.labels
    for key in ("joint", "wheel"):
        known = labels.get(f"{name.partition('.')[0]}.{key}", labels.get(key, ()))
        if name.partition(".")[2].startswith(key) and len(known) == width:
            return tuple(known)
    return tuple("xyzw"[:width]) if width in (3, 4) else tuple(str(k + 1) for k in range(width))


def estimate_figure(estimate: Estimate, truth: Estimate | None = None, title: str = "") -> Figure:
    """Return bars of 95 % half-widths relative to size, with the distance from what is known.

    ``truth``: an estimate whose values are true; without it the distance is that from the description. Raises
    `NotIdentifiableError` when no parameter has an interval.
    """
    own = asked_for(estimate)
    if truth is not None:
        own = [replace(p, nominal=truth[p.name].value if p.name in truth else None) for p in own]
    chart = identifiability("estimate", own, beside="the description" if truth is None else "the true value")
    if not chart.body.rows:  # type: ignore[union-attr]
        raise NotIdentifiableError("No parameter of the estimate has an interval.", advice="See its notes.")
    return picture([chart], title)


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
    return picture(stabilisation_figures(found), title)


def diagnosis_figure(diagnosis: Diagnosis, title: str = "") -> Figure:
    """Return the maps of a diagnosis; raises `SmsidError` for one that holds no tests."""
    before, after = (diagnosis.tests.get(key, ()) for key in ("nominal", "extended"))
    named = {"before any cause": before, "with the causes": after}
    named = {"nominal parameters refitted": before} if before == after else named
    maps = [diagnosis_map(name, name, tests) for name, tests in named.items()]
    if not any(maps):
        raise SmsidError(
            f"The diagnosis holds no tests: {diagnosis.sentence}",
            advice="Make it again with `smsid diagnose`; one that is not evaluated has no map.",
        )
    return picture([m for m in maps if m is not None], title)


def campaign_figure(summary: Summary, title: str = "") -> Figure:
    """Return coverage and relative spread by parameter; raises `SmsidError` where no interval was tested."""
    charts = coverage_figures(summary)
    if not charts:
        raise SmsidError("No interval of the campaign was tested.", advice="It needs a truth and sigmas.")
    return picture(charts, title)


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
