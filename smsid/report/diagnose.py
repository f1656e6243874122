"""The report of ``smsid diagnose``."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from smsid.description.schema import Description
from smsid.diagnose.diagnose import RATE, Diagnosed
from smsid.diagnose.priors import nominal
from smsid.diagnose.result import Diagnosis
from smsid.diagnose.stepwise import Search
from smsid.errors import SmsidError
from smsid.identify.estimate import Estimate
from smsid.recording import Recording
from smsid.report.diagnosis_candidates import alias_matrix, rescore
from smsid.report.diagnosis_map import LEVEL, Tested, diagnosis_map, evidence
from smsid.report.diagnosis_shares import share_map, share_ranking
from smsid.report.diagnosis_tables import cause_tables, gain_parts, limit_table, remaining_table
from smsid.report.innovations import innovation_traces, open_loop_traces, whitened_groups
from smsid.report.model import Figure, Grid, Provenance, Report, Section, Table, Text, Tone
from smsid.report.numbers import number, share
from smsid.report.plain_words import plain_words
from smsid.report.residuals import residual_table
from smsid.report.shares import Shares, shares_of
from smsid.report.spectra import spectrum_grid
from smsid.report.story import story_section
from smsid.report.torques import torque_sections
from smsid.report.traces import Trace, Traces

LOGGER = logging.getLogger(__name__)
BUDGET = 250_000
MOST_IN_WORDS = 2  # causes that are told in a sentence on top; more stand in the table
NOTE = "Expected: by the noise and by how well the state is known. A ratio of one means nothing else is left."
TONES: dict[str, Tone] = {
    "adequate": "good",
    "explained": "good",
    "unexplained": "bad",
    "not_evaluated": "neutral",
}
TITLES = {
    "adequate": "adequate",
    "explained": "explained",
    "unexplained": "unexplained",
    "not_evaluated": "not evaluated",
}


@dataclass(frozen=True)
class ReportInputs:
    """What a diagnosis was asked: the description, its recordings, the estimate and the held-out ones."""

    description: Description
    recordings: Sequence[Recording]
    estimate: Estimate | None = None
    validation: Sequence[Recording] = ()
    rate: float = RATE


def diagnose_report(
    found: Diagnosed, asked: ReportInputs, origin: Provenance, shares: Shares | None = None
) -> Report:
    """Return the report of a diagnosis; what was not evaluated is said to be so.

    ``shares`` are those of its search, where they are known already.
    """
    d = found.diagnosis
    sections = story_sections(found, asked)
    sections.append(causes_section(d))
    if shares is None and found.search is not None:
        shares = shares_of(found.search)
    if shares is not None and shares.telling:
        sections += share_sections(shares)
    else:  # of a misfit that is mostly noise the shares are all near zero
        sections += map_section(d.tests, LEVEL)
    if found.search is not None:
        sections += search_sections(found.search, asked)
    if found.torques is not None:
        sections += torque_sections(found.torques, asked.recordings[0].name)
    sections += _gain_section(found, asked)
    if d.remaining:
        table = remaining_table(d)
        sections.append(Section("remaining", "What depends on something", (table,), f"{len(d.remaining)}"))
    if d.limits:
        gist = "what this recording could have shown"
        table = limit_table(d)
        sections.append(Section("limits", "Detection limits", (table,), gist, open=False))
    notes = tuple(x for x in (d.priors, *d.notes) if x)
    if notes:
        sections.append(Section("notes", "Notes", (Text(notes, bullets=True),), open=False))
    title = f"Diagnosis of {', '.join(d.recordings[: len(asked.recordings)])}"
    verdict = f"{TITLES[d.verdict].capitalize()}: {shorten(d.sentence)}"
    words = plain_words(d)
    if words and len(d.causes) <= MOST_IN_WORDS:
        verdict = f"{TITLES[d.verdict].capitalize()}. {words}"
    return Report(title, d.description, verdict, TONES[d.verdict], tuple(sections), origin, _glance(d))


def story_sections(found: Diagnosed, asked: ReportInputs) -> list[Section]:
    """Return measured against simulated, before and after, on a held-out recording if there is one."""
    search, d = found.search, found.diagnosis
    if search is None or not search.causes:
        return []
    held = asked.validation
    recording = held[0] if held else asked.recordings[0]
    given = nominal(asked.description, asked.estimate).point
    models = {"as given": given, "with the cause": search.last.point}
    like, rate = search.last.problem, asked.rate
    return [story_section(models, like, recording, seen=not held, rate=rate, gain=d.gain)[0]]


def share_sections(shares: Shares) -> list[Section]:
    """Return where the misfit comes from: the map of places and the ranking of candidates, in shares."""
    parts = [x for x in (share_map(shares), share_ranking(shares)) if x is not None]
    if not parts:
        return []
    return [Section("map", "Where it comes from", tuple(parts), "by place and by candidate")]


def shorten(sentence: str, most: int = 260) -> str:
    """Return a sentence that lists many causes with the first of them; all stand in the table below."""
    parts = sentence.replace("+-", "±").split("; ")
    kept = parts[:1]
    while len(kept) < len(parts) and len("; ".join(kept)) + len(parts[len(kept)]) < most:
        kept.append(parts[len(kept)])
    left = len(parts) - len(kept)
    return "; ".join(kept) + (f"; and {left} more, below." if left else "")


def causes_section(d: Diagnosis) -> Section:
    """Return the causes with their parameters, intervals and aliases; or that there are none."""
    tables: list[Text | Table] = list(cause_tables(d))
    if tables:
        tables.insert(0, Text((d.sentence.replace("+-", "±"),)))
    else:
        why = {
            "adequate": "No cause is needed: nothing significant is left.",
            "not_evaluated": f"Not evaluated: {d.sentence}",
        }
        tables = [Text((why.get(d.verdict, "No cause in the catalogue fits what is left."),))]
    return Section("causes", "Causes", tuple(tables), f"{len(d.causes)} named" if d.causes else "none named")


def map_section(tests: Mapping[str, Sequence[Tested]], level: float) -> list[Section]:
    """Return the maps of equation by dependence, before any cause and with the causes; none without tests."""
    before, after = tests.get("nominal", ()), tests.get("extended", ())
    if not before:
        return []
    changed = [(t.where, t.dependence, t.ratio) for t in before] != [
        (t.where, t.dependence, t.ratio) for t in after
    ]
    caption = (
        "Every equation and sensor channel against what it may depend on. A cell is minus the decimal "
        "logarithm of the chance of as much when nothing is wrong, corrected for the number of tests; framed "
        "cells are significant. Joint and wheel rows are torques, the bus's are forces and torques on it; a "
        "wheel's rate is its speed. The column wheel speed (speed, and what turns with the wheel) is shown "
        "for orientation: the verdict does not count it."
    )
    first = "Before any cause: nominal parameters refitted" if changed else "Nominal parameters refitted"
    maps = [diagnosis_map("map-before", first, before, level=level, caption=caption)]
    if changed:
        maps.append(diagnosis_map("map-after", "With the causes in the model", after, level=level))
    limit = -math.log10(level)
    count = [sum(evidence(t, len(some)) > limit for t in some) for some in (before, after)]
    gist = f"{count[0]} of {len(before)} tests significant"
    gist += f" before, {count[1]} after" if changed else ""
    parts = tuple(m for m in maps if m is not None)
    return [Section("map", "Map of equation by dependence", parts, gist, open=any(count))]


def search_sections(search: Search, asked: ReportInputs) -> list[Section]:
    """Return the candidates, the spectra and the innovations of a search."""
    changed, out = bool(search.causes), []
    scores = rescore(search)
    matrix = alias_matrix(search, scores)
    if matrix is not None:
        gist = f"{search.candidates} tried"
        out.append(Section("candidates", "Candidates that look alike", (matrix,), gist, open=False))
    groups = whitened_groups(search)
    labels = ("before any cause", "with the causes") if changed else ("", "innovations")
    if not changed:
        groups = {c: tuple(_alone(t) for t in own) for c, own in groups.items()}
    grid = spectrum_grid("spectrum", groups, labels=labels)
    out.append(
        Section(
            "spectra",
            "Spectra of the innovations",
            (grid,),
            "before and after" if changed else "",
            open=False,
        )
    )
    traces = [t for own in innovation_traces(search, asked.recordings[0]).values() for t in own]
    traces = traces if changed else [_alone(t) for t in traces]
    parts_ = _explored("traces", traces, "Measured, and predicted one sample ahead",
                       ("measured", "predicted", "error", "error before any cause"))  # fmt: skip
    out.append(
        Section(
            "residuals",
            "Measured against predicted",
            parts_,
            ", ".join(r.name for r in asked.recordings),
            open=not changed,
        )
    )
    return out


def _gain_section(found: Diagnosed, asked: ReportInputs) -> list[Section]:
    d = found.diagnosis
    if d.gain is None:
        reason = d.gain_reason or "no validation recording was given"
        return [
            Section("gain", "Gain on held-out data", (Text((f"Not evaluated: {reason}.",)),), "not evaluated")
        ]
    parts: list[Text | Table | Figure | Grid] = list(gain_parts(d.gain))
    held = asked.validation
    if found.search is not None and held:
        try:
            given = nominal(asked.description, asked.estimate).point
            traces = open_loop_traces(given, found.search.last.point, found.search, held[0], asked.rate)
            flat = [t for own in traces.values() for t in own]
            parts += _explored("open-loop", flat, f"Simulated open loop on {held[0].name}",
                               ("measured", "simulated, extended", "error, extended", "error, as given"),
                               table=False)  # fmt: skip
        except SmsidError as error:
            LOGGER.info("open loop: %s", error)
    return [Section("gain", "Gain on held-out data", tuple(parts), f"on {d.gain.recording}", open=False)]


def _explored(
    name: str, traces: Sequence[Trace], title: str, labels: tuple[str, str, str, str], table: bool = True
) -> tuple[Figure | Table, ...]:
    worst = max(range(len(traces)), key=lambda k: _off(traces[k]))
    body = Traces(tuple(traces), title, worst, labels, "± 2 σ expected", BUDGET)
    caption = "Below: what is left, with the band of two standard deviations expected of it."
    figure = Figure(name, title, body, caption)
    return (figure, residual_table(name, traces, "expected", NOTE)) if table else (figure,)


def _off(t: Trace) -> float:
    was = t.before if t.before is not None else t.residual
    rms = Trace(t.name, t.unit, t.time, t.measured, None, was, t.sigma).whitened_rms
    return rms if rms == rms else 0.0


def _alone(t: Trace) -> Trace:
    return Trace(t.name, t.unit, t.time, t.measured, t.simulated, t.residual, t.sigma)


def _glance(d: Diagnosis) -> tuple[tuple[str, str], ...]:
    out = [("verdict", TITLES[d.verdict])]
    if d.gain is not None and d.gain.explained == d.gain.explained:
        was, now = number(d.gain.whitened_given, 3), number(d.gain.whitened_extended, 3)
        out.append(("prediction error over the noise, held out", f"{was} → {now}"))
        out.append(("excess explained, held out", share(d.gain.explained, 3)))
    elif d.whitened_rms:
        # before the causes it is over the noise as raised for the nominal fit: that says nothing
        out.append(("prediction error over the noise", number(list(d.whitened_rms.values())[-1], 4)))
    if d.timing:
        out.append(("CPU time", f"{number(sum(d.timing.values()), 3)} s"))
    return tuple(out)
