"""The report of an identification by a filter: verdict, channels, parameters, how it came to rest."""

from __future__ import annotations

from smsid.description.schema import Description
from smsid.estimation.fit_quality import ChannelFit
from smsid.estimation.identify import Identified
from smsid.report.fit_history import convergence_section
from smsid.report.model import Provenance, Report, Section, Table, Text, Tone, cells, notes_section
from smsid.report.numbers import number
from smsid.report.parameters import Known, parameter_section, reported_parameters

TONES: dict[str, Tone] = {"explained": "good", "roughly": "warn", "not explained": "bad"}


def flights_report(description: Description, found: Identified, origin: Provenance) -> Report:
    """Return the report of an identification that a filter made.

    Args:
        description: what it started from.
        found: the identification.
        origin: versions, command, files.
    """
    estimate, quality = found.estimate, found.quality
    own = reported_parameters(estimate)
    sections: list[Section] = []
    if quality is not None:
        text = [quality.sentence, *(c.sentence for c in found.contradictions)]
        body = (Text(tuple(text), bullets=len(text) > 1), _channels(quality.channels))
        sections.append(Section("fit", "Does the model explain the recordings?", body))
    sections.append(parameter_section(own, Known(), "Mass, effects and single inertial parameters"))
    sections += convergence_section("", estimate.history)
    sections += notes_section(estimate.notes)
    good = [p for p in own if p.status == "identifiable"]
    sentence = quality.sentence if quality is not None else f"{len(own)} parameters are estimated."
    tone: Tone = "neutral" if quality is None else TONES[quality.judgement]
    if found.contradictions:
        sentence, tone = found.contradictions[0].sentence, "bad"
    glance = [
        ("identifiable", f"{len(good)} of {len(own)}"),
        ("recordings", f"{len(estimate.recordings)}"),
        ("time", f"{number(estimate.timing['total'], 3)} s"),
    ]
    title = "Identification by maximum likelihood"
    return Report(title, description.name, sentence, tone, sections, origin, glance)


def _channels(channels: tuple[ChannelFit, ...]) -> Table:
    rows = [
        cells(
            f"{c.recording}: {c.channel}", (c.ratio, 3, TONES[c.judgement]), (c.correlation, 2), c.component
        )
        for c in channels
    ]
    columns = ("channel", "#over its stated noise", "#largest autocorrelation", "worst component")
    note = (
        "1 is the sensors' noise; less where an input that nobody recorded is estimated from sample to sample"
    )
    return Table("What is left of each channel", columns, rows, note=note)
