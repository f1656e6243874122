"""The report of ``smsid diagnose``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from smsid.description.schema import Description
from smsid.diagnose.diagnose import RATE, DiagnosisRun
from smsid.diagnose.priors import nominal
from smsid.diagnose.result import Diagnosis, SignificantTest
from smsid.diagnose.stepwise import Search
from smsid.diagnose.torque.search import TorqueSearch
from smsid.estimation.joint_problem import by_own_clock
from smsid.identify.estimate import Estimate
from smsid.recording import Recording
from smsid.report._open_loop import OpenLoop, story_section
from smsid.report._residuals import trace_explorer
from smsid.report._spectra import spectrum_grid
from smsid.report._traces import Trace, rotation_vectors
from smsid.report.diagnosis_map import LEVEL, diagnosis_map, evidence
from smsid.report.diagnosis_shares import Shares, alias_matrix, rescore, share_map, share_ranking, shares_of
from smsid.report.diagnosis_tables import cause_tables, gain_parts, limit_table, plain_words, remaining_table
from smsid.report.model import Part, Provenance, Report, Section, Table, Text, Tone, notes_section
from smsid.report.numbers import number, share

MOST_IN_WORDS = 2  # causes that are told in a sentence on top; more stand in the table
NOTE = "Expected: by the noise and by how well the state is known. A ratio of one means nothing else is left."
EXPECTED: dict[str, Any] = {"band": "± 2 σ expected", "scale": "expected", "note": NOTE}
BELOW = "Below: what is left, with the band of two standard deviations expected of it."
TONES: dict[str, Tone] = {
    "adequate": "good",
    "explained": "good",
    "unexplained": "bad",
    "not_evaluated": "neutral",
}
GIVEN, EXTENDED = "as given", "with the cause"


@dataclass(frozen=True)
class DiagnosisInputs:
    """What a diagnosis was asked: the description, its recordings, the estimate and the held-out ones."""

    description: Description
    recordings: Sequence[Recording]
    estimate: Estimate | None = None
    validation: Sequence[Recording] = ()
    rate: float = RATE


def diagnose_report(
    found: DiagnosisRun, asked: DiagnosisInputs, origin: Provenance, shares: Shares | None = None
) -> Report:
    """Return the report of a diagnosis; what was not evaluated is said to be so.

    ``shares`` are those of its search, where they are known already.
    """
    d = found.diagnosis
    sections, loop = story_sections(found, asked)
    sections.append(causes_section(d))
    if shares is None and found.search is not None:
        shares = shares_of(found.search)
    if shares is not None and shares.telling:
        sections += share_sections(shares)
    else:  # of a misfit that is mostly noise the shares are all near zero
        sections += map_section(d.tests)
    if found.search is not None:
        sections += search_sections(found.search, asked)
    if found.torques is not None:
        sections += torque_sections(found.torques, asked.recordings[0].name)
    sections.append(_gain_section(found, asked, loop))
    if d.remaining:
        table = remaining_table(d)
        sections.append(Section("remaining", "What depends on something", (table,), f"{len(d.remaining)}"))
    if d.limits:
        gist = "what this recording could have shown"
        table = limit_table(d)
        sections.append(Section("limits", "Detection limits", (table,), gist, open=False))
    sections += notes_section((d.priors, *d.notes))
    title = f"Diagnosis of {', '.join(d.recordings[: len(asked.recordings)])}"
    words = plain_words(d) if len(d.causes) <= MOST_IN_WORDS else ""
    verdict = d.verdict.replace("_", " ").capitalize()
    verdict += f". {words}" if words else f": {shorten(d.sentence)}"
    return Report(title, d.description, verdict, TONES[d.verdict], sections, origin, _glance(d))


def story_sections(found: DiagnosisRun, asked: DiagnosisInputs) -> tuple[list[Section], OpenLoop | None]:
    """Return measured against simulated, before and after, on a held-out recording if there is one.

    And what it is made from: the held-out recording as the models simulate it.
    """
    search, held = found.search, asked.validation
    if search is None or not (search.causes or (held and found.diagnosis.gain)):
        return [], None
    recording = held[0] if held else asked.recordings[0]
    extended = by_own_clock(search.last.point, search.last.problem) if found.point is None else found.point
    models = {GIVEN: nominal(asked.description, asked.estimate).point, EXTENDED: extended}
    like, gain = search.last.problem, found.diagnosis.gain
    story, loop = story_section(models, like, recording, seen=not held, rate=asked.rate, gain=gain)
    return [story] if search.causes else [], loop if held else None


def share_sections(shares: Shares) -> list[Section]:
    """Return where the misfit comes from: the map of places and the ranking of candidates, in shares."""
    parts = [x for x in (share_map(shares), share_ranking(shares)) if x is not None]
    return [Section("map", "Where it comes from", parts, "by place and by candidate")] if parts else []


def shorten(sentence: str) -> str:
    """Return a sentence that lists many causes with the first of them; all stand in the table below."""
    parts = sentence.replace("+-", "±").split("; ")
    kept = parts[:1]
    while len(kept) < len(parts) and len("; ".join(kept)) + len(parts[len(kept)]) < 260:
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
    return Section("causes", "Causes", tables, f"{len(d.causes)} named" if d.causes else "none named")


def map_section(tests: Mapping[str, Sequence[SignificantTest]]) -> list[Section]:
    """Return the maps of equation by dependence, before any cause and with the causes; none without tests."""
    before, after = tests.get("nominal", ()), tests.get("extended", ())
    if not before:
        return []
    was, now = ([(t.where, t.dependence, t.ratio) for t in some] for some in (before, after))
    changed = was != now
    caption = (
        "Every equation and sensor channel against what it may depend on. A cell is minus the decimal "
        "logarithm of the chance of as much when nothing is wrong, corrected for the number of tests; framed "
        "cells are significant. Joint and wheel rows are torques, the bus's are forces and torques on it; a "
        "wheel's rate is its speed. The column wheel speed (speed, and what turns with the wheel) is shown "
        "for orientation: the verdict does not count it."
    )
    first = "Before any cause: nominal parameters refitted" if changed else "Nominal parameters refitted"
    maps = [diagnosis_map("map-before", first, before, caption=caption)]
    if changed:
        maps.append(diagnosis_map("map-after", "With the causes in the model", after))
    limit = -math.log10(LEVEL)
    count = [sum(evidence(t, len(some)) > limit for t in some) for some in (before, after)]
    gist = f"{count[0]} of {len(before)} tests significant"
    gist += f" before, {count[1]} after" if changed else ""
    parts = [m for m in maps if m is not None]
    return [Section("map", "Map of equation by dependence", parts, gist, open=any(count))]


def search_sections(search: Search, asked: DiagnosisInputs) -> list[Section]:
    """Return the candidates, the spectra and the innovations of a search."""
    changed, out = bool(search.causes), []
    scores = rescore(search)
    matrix = alias_matrix(search, scores)
    if matrix is not None:
        gist = f"{search.candidates} tried"
        out.append(Section("candidates", "Candidates that look alike", (matrix,), gist, open=False))
    groups = whitened_groups(search)
    labels = ("before any cause", "with the causes") if changed else ("", "innovations")
    traces = [t for own in innovation_traces(search, asked.recordings[0]).values() for t in own]
    if not changed:
        groups = {c: tuple(t.alone() for t in own) for c, own in groups.items()}
        traces = [t.alone() for t in traces]
    grid, gist = spectrum_grid("spectrum", groups, labels=labels), "before and after" if changed else ""
    out.append(Section("spectra", "Spectra of the innovations", (grid,), gist, open=False))
    named = ("measured", "predicted", "error", "error before any cause")
    parts = trace_explorer(traces, "Measured, and predicted one sample ahead", BELOW, named, **EXPECTED)
    recordings = ", ".join(r.name for r in asked.recordings)
    out.append(Section("residuals", "Measured against predicted", parts, recordings, open=not changed))
    return out


def _gain_section(found: DiagnosisRun, asked: DiagnosisInputs, loop: OpenLoop | None) -> Section:
    d, title = found.diagnosis, "Gain on held-out data"
    if d.gain is None:
        reason = d.gain_reason or "no validation recording was given"
        return Section("gain", title, (Text((f"Not evaluated: {reason}.",)),), "not evaluated")
    parts: list[Part] = list(gain_parts(d.gain, extends=bool(d.causes)))
    if loop is not None and {GIVEN, EXTENDED} <= set(loop.models):
        labels = ("measured", "simulated, extended", "error, extended", "error, as given")
        title_, traces = f"Simulated open loop on {loop.recording}", loop.traces(GIVEN, EXTENDED)
        parts += trace_explorer(traces, title_, BELOW, labels, name="open-loop", **EXPECTED)[:1]
    return Section("gain", title, parts, f"on {d.gain.recording}", open=False)


def _glance(d: Diagnosis) -> list[tuple[str, str]]:
    out = [("verdict", d.verdict.replace("_", " "))]
    if d.gain is not None and d.gain.explained == d.gain.explained:
        was, now = number(d.gain.whitened_given, 3), number(d.gain.whitened_extended, 3)
        out.append(("prediction error over the noise, held out", f"{was} → {now}"))
        if d.causes and d.gain.explained >= 0.0:
            out.append(("excess explained, held out", share(d.gain.explained, 3)))
    elif d.whitened_rms:
        # before the causes it is over the noise as raised for the nominal fit: that says nothing
        out.append(("prediction error over the noise", number(list(d.whitened_rms.values())[-1], 4)))
    if d.timing:
        out.append(("CPU time", f"{number(sum(d.timing.values()), 3)} s"))
    return out


def innovation_traces(found: Search, recording: Recording) -> dict[str, tuple[Trace, ...]]:
    """Return measured and predicted a sample ahead by channel, residuals after and before the causes."""
    data, run, before = found.last.problem.data, found.last.run, found.nominal.run
    times = found.last.problem.own_times
    out: dict[str, tuple[Trace, ...]] = {}
    for block in data.blocks:
        attitude = block.quantity == "attitude"
        turned = rotation_vectors(data.attitude[block.channel]) if attitude else np.zeros((0, 0))
        unit = "rad" if attitude else recording.units.get(block.channel, "")
        own = []
        for k, row in enumerate(range(block.rows.start, block.rows.stop)):
            values = (turned[:, k], None) if attitude else (data.values[:, row], run.predicted[:, row])
            error = np.where(run.used[:, row], run.errors[:, row], np.nan)
            # what a sample is expected to be off by: its noise and what the state is uncertain by
            used = run.used[:, row] & (np.abs(run.normalised[:, row]) > 1e-12)
            shares = np.abs(run.errors[used, row] / run.normalised[used, row])
            sigma = float(np.median(shares)) if used.any() else float(data.sigma[row])
            name = data.names[row].replace(".", " ", 1).replace("_", " ")
            own.append(Trace(name, unit, times, *values, error, sigma, before.errors[:, row]))
        out[block.channel] = tuple(own)
    return out


def whitened_groups(found: Search) -> dict[str, tuple[Trace, ...]]:
    """Return whitened innovations by channel, after and before the causes, for their spectra."""
    data, times = found.last.problem.data, found.last.problem.own_times
    settle = len(times) // 50
    left, was = found.last.run.innovations[settle:], found.nominal.run.innovations[settle:]
    return {
        b.channel: tuple(
            Trace(data.names[k], "1", times[settle:], left[:, k], None, left[:, k], 1.0, was[:, k])
            for k in range(b.rows.start, b.rows.stop)
        )
        for b in data.blocks
    }


OF_TORQUES = "Noise: the torque's white noise within the band that is compared."


def torque_sections(found: TorqueSearch, recording: str) -> list[Section]:
    """Return measured against predicted torques, and the spectra of what is left."""
    traces = torque_traces(found)
    labels = ("measured", "predicted", "residual", "residual before any cause")
    caption = "Low-passed alike on both sides."
    parts = trace_explorer(traces, "Measured and predicted torque", caption, labels, note=OF_TORQUES)
    groups = {t.name: (t,) for t in traces}
    grid = spectrum_grid("spectrum", groups, labels=("before any cause", "with the causes"))
    return [
        Section("residuals", "Measured against predicted", parts, recording),
        Section("spectra", "Spectra of the residuals, before and after", (grid,)),
    ]


def torque_traces(found: TorqueSearch) -> tuple[Trace, ...]:
    """Return a trace per joint of the recording that was searched."""
    fit, before = found.last, found.nominal.residual if found.causes else None
    equations = fit.equations
    out = []
    for k, joint in enumerate(equations.names):
        measured, left = equations.torque[:, k], fit.residual[:, k]
        values, was = (measured, measured - left, left), None if before is None else before[:, k]
        noise = float(equations.noise[k])
        out.append(Trace(f"torque of {joint}", "N m", equations.time, *values, noise, was))
    return tuple(out)
