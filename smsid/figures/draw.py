"""From a file to a figure: what is in the file is told from its content, or said by its kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from smsid.errors import SmsidError
from smsid.figures.canvas import save

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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


def _recording(request: Request) -> Figure:
    from smsid.figures.recording import recording_figure
    from smsid.recording import load_recording

    return recording_figure(load_recording(request.file), request.channels, request.title)


def _estimate(request: Request) -> Figure:
    from smsid.figures.estimate import estimate_figure
    from smsid.identify.estimate import load_estimate

    truth = load_estimate(request.truth) if request.truth is not None else None
    return estimate_figure(load_estimate(request.file), truth, request.title)


def _stabilisation(request: Request) -> Figure:
    from smsid.description import load_description
    from smsid.figures.stabilisation import stabilisation_figure
    from smsid.model import build_model
    from smsid.recording import load_recording

    if request.description is None:
        raise SmsidError(
            "A stabilisation diagram needs to know which sensor sits on which appendage.",
            advice="Pass the spacecraft's TOML by --description.",
        )
    model = build_model(load_description(request.description))
    return stabilisation_figure(model, load_recording(request.file), request.title)


def _diagnosis(request: Request) -> Figure:
    from smsid.diagnose import load_diagnosis
    from smsid.figures.diagnosis import diagnosis_figure

    return diagnosis_figure(load_diagnosis(request.file), request.title)


def _campaign(request: Request) -> Figure:
    from smsid.campaign.store import read_store
    from smsid.campaign.summary import summarise
    from smsid.figures.campaign import campaign_figure

    header, records = read_store(request.file)
    return campaign_figure(summarise(records), request.title or str(header.plan["name"]))


KINDS: dict[str, Callable[[Request], Figure]] = {
    "recording": _recording,
    "estimate": _estimate,
    "stabilisation": _stabilisation,
    "diagnosis": _diagnosis,
    "campaign": _campaign,
}
