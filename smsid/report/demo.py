"""The page of ``smsid demo``: from measured data to a cause by name, its gain, and the paper's tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from smsid.description.schema import Description
from smsid.diagnose.diagnose import RATE, Diagnosed
from smsid.diagnose.priors import nominal
from smsid.estimation.parameter_vector import Point
from smsid.identify.estimate import Estimate
from smsid.recording import Recording
from smsid.report.diagnose import share_sections
from smsid.report.model import Cell, Frame, Link, Links, Provenance, Report, Section, Table, Text, Tone
from smsid.report.numbers import half, number, unit
from smsid.report.open_loop import OpenLoop, most_different
from smsid.report.parameters import reported_parameters
from smsid.report.plain_words import plain_words, quantity, strength
from smsid.report.shares import Shares
from smsid.report.story import story_section
from smsid.report.truth import TrueWorld, described_bodies

DESCRIBED, IDENTIFIED, EXTENDED = "as described", "identified", "with the cause"


@dataclass(frozen=True)
class Craft:
    """The craft with something hidden: what was described and measured, and what was found.

    ``estimate`` is of the estimation flight, ``found`` its diagnosis, ``extended`` the description with the
    identified values and the cause, ``engine`` what made the flights,
    ``hidden`` and ``parameters`` what the world was.
    """

    description: Description
    estimation: Recording
    validation: Recording
    estimate: Estimate
    found: Diagnosed
    extended: Description
    engine: str
    hidden: Mapping[str, Any]
    parameters: Mapping[str, float]


def demo_report(
    craft: Craft,
    paper: Section,
    links: Sequence[Link],
    origin: Provenance,
    picture: Frame | None = None,
    shares: Shares | None = None,
) -> Report:
    """Return the page of a demonstration.

    Args:
        craft: the craft with something hidden.
        paper: the paper's tables beside what was found (`smsid.paper.tables`).
        links: files beside the page.
        origin: versions, command, files.
        picture: of the craft in motion, if it could be drawn.
        shares: of the misfit, where it was searched.
    """
    search = craft.found.search
    story, seen = None, None
    if search is not None:
        models = {
            DESCRIBED: nominal(craft.description, None).point,
            IDENTIFIED: nominal(craft.description, craft.estimate).point,
            EXTENDED: Point.of(craft.extended),
        }
        like = search.last.problem
        story, seen = story_section(models, like, craft.validation, seen=False, rate=RATE)
    sections = [Section("steps", "From data to the cause", (Text(steps(craft, seen), bullets=True),))]
    sections += [story] if story is not None else []
    sections.append(cause_section(craft))
    sections += share_sections(shares) if shares is not None else []
    sections.append(values_section(craft))
    sections.append(paper)
    sections.append(Section("files", "Look further", (Links(tuple(links)),)))
    sentence, tone = verdict(craft)
    return Report(
        "smsid, shown on a craft with something hidden",
        "What the simulation gets wrong, and why",
        sentence,
        tone,
        tuple(sections),
        origin,
        _glance(craft, seen),
        picture,
    )


def verdict(craft: Craft) -> tuple[str, Tone]:
    """Return what was found, in a sentence, and whether it is what was hidden."""
    d = craft.found.diagnosis
    if not d.causes:
        return f"The cause was not found: {d.sentence}", "bad"
    right = found_hidden(craft)
    text = plain_words(d)
    if right is None:
        return f"{text} What was hidden is something else, see below.", "bad"
    return text, "good" if right else "warn"


def found_hidden(craft: Craft) -> bool | None:
    """Return whether the hidden value lies in the interval found; ``None`` where another cause is named."""
    h = craft.hidden
    for cause in craft.found.diagnosis.causes:
        for p in cause.parameters:
            same = (cause.effect, cause.location) == (h["effect"], h["location"])
            if same and p.name.rpartition(".")[2] == h["parameter"]:
                return p.interval[0] <= h["value"] <= p.interval[1]
    return None


def steps(craft: Craft, seen: OpenLoop | None) -> tuple[str, ...]:
    """Return the story in steps, with the figures of this run."""
    d, r = craft.found.diagnosis, craft.estimation
    times = r.time()
    out = [
        f"Measured: a flight of {times[-1] - times[0]:g} s, arm and wheels driven by known torques, "
        f"{len(times)} samples "
        "of pose, gyro, accelerometer, encoders and tachometers with their noise. It was made by "
        f"{craft.engine}, "
        "whose model shares no code with smsid's. A second flight is kept aside to judge by."
    ]
    if seen is not None:
        shown = most_different(seen, DESCRIBED, EXTENDED, 2)
        told = "; ".join(_error_of(seen, c, (DESCRIBED,)) for c in shown)
        if told:
            out.append(
                "What the simulation gets wrong: driven by the same torques, the described craft "
                f"strays. {told}."
            )
    good = [p for p in reported_parameters(craft.estimate) if p.status == "identifiable"]
    text = (
        f"Identified: the description is a guess that is off by several per cent. {len(good)} "
        "parameters are found to "
        "better than 10 %"
    )
    if seen is not None:
        told = "; ".join(
            _error_of(seen, c, (DESCRIBED, IDENTIFIED)) for c in most_different(seen, DESCRIBED, EXTENDED, 1)
        )
        text += (
            f". Better numbers alone do not mend the simulation: {told} (described → identified)"
            if told
            else ""
        )
    out.append(text + ".")
    if d.causes:
        tried = craft.found.search.candidates if craft.found.search is not None else 0
        out.append(
            f"The cause by name, out of {tried} candidates, told nothing of what was hidden: "
            f"{d.sentence}".replace("+-", "±")
        )
    if d.causes and seen is not None:
        told = "; ".join(
            _error_of(seen, c, (DESCRIBED, EXTENDED)) for c in most_different(seen, DESCRIBED, EXTENDED, 3)
        )
        out.append(f"The gain, on the flight that was not used (described → with the cause): {told}.")
    return tuple(out)


def _error_of(seen: OpenLoop, c: Any, models: Sequence[str]) -> str:
    there = [m for m in models if m in seen.models]
    values = " → ".join(f"{number(seen.rms(c, m), 2)}" for m in there)
    return f"{c.name} is off by {values} {unit(c.unit)}".strip()


def cause_section(craft: Craft) -> Section:
    """Return the causes with their intervals beside what was hidden."""
    d = craft.found.diagnosis
    h = craft.hidden
    rows = []
    for cause in d.causes:
        for p in cause.parameters:
            low, high = p.interval
            same = (cause.effect, cause.location) == (h["effect"], h["location"])
            hidden = h["value"] if same and p.name.rpartition(".")[2] == h["parameter"] else None
            rows.append(
                (
                    Cell(f"{cause.label} ({cause.effect.replace('_', ' ')})"),
                    Cell(cause.location),
                    Cell(number(p.value, 6), p.value),
                    Cell(half(p.value, low, high), 0.5 * (high - low)),
                    Cell("none" if hidden is None else number(hidden, 6), hidden),
                    Cell(unit(p.unit)),
                )
            )
    parts: list[Text | Table] = [Text((d.sentence.replace("+-", "±"),))]
    if rows:
        columns = ("cause", "where", "#found", "#95 % interval", "#hidden", "unit")
        parts.append(Table("Found, and hidden", columns, tuple(rows)))
    right = found_hidden(craft)
    ending = {
        True: "The interval found holds it.",
        False: "The right cause; the interval found does not hold the value.",
        None: "It was not found.",
    }[right]
    parts.append(
        Text(
            (
                f"What was hidden: {h['parameter']} = {number(h['value'], 6)} {unit(h['unit'])} "
                f"({h['effect'].replace('_', ' ')}) at {h['location']}. {ending}",
            )
        )
    )
    return Section("cause", "The cause, and what was hidden", tuple(parts))


def values_section(craft: Craft) -> Section:
    """Return the identified parameters beside the wrong guess and the truth."""
    own = [p for p in reported_parameters(craft.estimate) if p.status == "identifiable"]
    world = TrueWorld(craft.parameters, described_bodies(craft.description), _effects(craft))
    truth = world.values_of(own)
    known = [p for p in own if p.name in truth]
    inside = sum(p.interval[0] <= truth[p.name] <= p.interval[1] for p in known)
    rows = []
    for p in known:
        low, high = p.interval
        within = low <= truth[p.name] <= high
        rows.append(
            (
                Cell(p.name),
                Cell("–" if p.nominal is None else number(p.nominal, 5), p.nominal),
                Cell(number(p.value, 5), p.value),
                Cell(half(p.value, low, high), 0.5 * (high - low)),
                Cell(number(truth[p.name], 5), truth[p.name]),
                Cell(unit(p.unit)),
                Cell("yes" if within else "no", tone="good" if within else "warn"),
            )
        )
    columns = ("parameter", "#described", "#identified", "#95 % interval", "#truth", "unit", "truth inside")
    title = "Found to better than 10 % from one flight without thrust"
    note = "A sum is a combination of inertial parameters: its terms alone cannot be told from this motion."
    gist = f"{inside} of {len(known)} intervals hold the truth; 95 % should"
    return Section(
        "values", "Identified values", (Table(title, columns, tuple(rows), note),), gist, open=False
    )


def _effects(craft: Craft) -> dict[str, float]:
    bodies = described_bodies(craft.description)
    return {name: value for name, value in craft.parameters.items() if name not in bodies}


def _glance(craft: Craft, seen: OpenLoop | None) -> tuple[tuple[str, str], ...]:
    d = craft.found.diagnosis
    out: list[tuple[str, str]] = []
    if d.causes:
        value = strength(d.causes[0])
        if value is not None:
            out.append((f"{d.causes[0].label} at {d.causes[0].location}, found", quantity(value)))
        out.append(("hidden", f"{number(craft.hidden['value'], 4)} {unit(craft.hidden['unit'])}"))
    if seen is not None and {DESCRIBED, EXTENDED} <= set(seen.models):
        for c in most_different(seen, DESCRIBED, EXTENDED, 2):
            was, now = (number(seen.rms(c, m), 2) for m in (DESCRIBED, EXTENDED))
            out.append((f"{c.name}, error on the other flight", f"{was} → {now} {unit(c.unit)}"))
    return tuple(out)
