"""The report of an identification by a filter: verdict, channels, parameters, how it came to rest."""

from __future__ import annotations

from smsid.description.schema import Description
from smsid.estimation.fit_quality import ChannelFit
from smsid.estimation.identify import Identified
from smsid.report.fit_history import convergence_section
from smsid.report.model import Cell, Provenance, Report, Section, Table, Text, Tone
from smsid.report.numbers import number
from smsid.report.parameters import Known, identifiability, parameter_table, reported_parameters

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
    single, mixed = [p for p in own if " " not in p.name], [p for p in own if " " in p.name]
    parts: list[Text | Table] = []
    sections: list[Section] = []
    if quality is not None:
        text = [quality.sentence, *(c.sentence for c in found.contradictions)]
        body = (Text(tuple(text), bullets=len(text) > 1), _channels(quality.channels))
        sections.append(Section("fit", "Does the model explain the recordings?", body))
    figures = []
    for key, title, some in (
        ("single", "Mass, effects and single inertial parameters", single),
        ("mixed", "Combinations of inertial parameters that the motion depends on", mixed),
    ):
        if some:
            figures.append(identifiability(f"known-{key}", some, Known()))
            parts.append(parameter_table(title, some, Known()))
    sections.append(Section("parameters", "Parameters", (*figures, *parts), f"{len(own)} with intervals"))
    sections += convergence_section("", estimate.history)
    sections.append(
        Section("notes", "Notes", (Text(estimate.notes, bullets=True),), f"{len(estimate.notes)}", open=False)
    )
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
    return Report(
        "Identification by maximum likelihood",
        description.name,
        sentence,
        tone,
        tuple(sections),
        origin,
        tuple(glance),
    )


def _channels(channels: tuple[ChannelFit, ...]) -> Table:
    rows = tuple(
        (
            Cell(f"{c.recording}: {c.channel}"),
            Cell(number(c.ratio, 3), c.ratio, TONES[c.judgement]),
            Cell(number(c.correlation, 2), c.correlation),
            Cell(c.component),
        )
        for c in channels
    )
    return Table(
        "What is left of each channel",
        ("channel", "#over its stated noise", "#largest autocorrelation", "worst component"),
        rows,
        note="1 is the sensors' noise; less where an input that nobody recorded is estimated from sample to "
        "sample",
    )
