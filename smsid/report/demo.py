"""The page of ``smsid demo``: from measured data to a cause by name, its gain, and the paper's tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from smsid.description.schema import Description
from smsid.diagnose.diagnose import RATE, DiagnosisRun
from smsid.diagnose.priors import nominal
from smsid.diagnose.result import FoundCause, Value
from smsid.estimation.parameter_vector import Point
from smsid.identify.estimate import Estimate, ParameterEstimate
from smsid.identify.estimate_text import asked_for
from smsid.identify.parameter_estimate import parse_combination
from smsid.model import build_model
from smsid.model.regressor import INERTIAL_NAMES, body_names
from smsid.model.rigid_bodies import urdf_bodies
from smsid.recording import Recording
from smsid.report._open_loop import OpenLoop, most_different, story_section
from smsid.report.diagnose import share_sections
from smsid.report.diagnosis_shares import Shares
from smsid.report.diagnosis_tables import plain_words, quantity, strength
from smsid.report.model import Cell, Frame, Link, Links, Provenance, Report, Section, Table, Text, Tone, cells
from smsid.report.numbers import number, unit
from smsid.report.parameters import interval_cell

DESCRIBED, IDENTIFIED, EXTENDED = "as described", "identified", "with the cause"


@dataclass(frozen=True)
class DemoCraft:
    """The craft with something hidden: what was described and measured, and what was found.

    ``estimate`` is of the estimation flight, ``found`` its diagnosis, ``extended`` the description with the
    identified values and the cause; ``engine`` made the flights, ``hidden`` and ``parameters`` are what the
    world was.
    """

    description: Description
    estimation: Recording
    validation: Recording
    estimate: Estimate
    found: DiagnosisRun
    extended: Description
    engine: str
    hidden: Mapping[str, Any]
    parameters: Mapping[str, float]

    def true_value(self, cause: FoundCause, p: Value) -> float | None:
        """Return what was hidden, if a parameter of a cause is what was."""
        h = self.hidden
        wanted = h["effect"], h["location"], h["parameter"]
        return h["value"] if (cause.effect, cause.location, p.name.rpartition(".")[2]) == wanted else None


def demo_report(
    craft: DemoCraft,
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
    title = "smsid, shown on a craft with something hidden"
    subject = "What the simulation gets wrong, and why"
    return Report(title, subject, sentence, tone, sections, origin, _glance(craft, seen), picture)


def verdict(craft: DemoCraft) -> tuple[str, Tone]:
    """Return what was found, in a sentence, and whether it is what was hidden."""
    d = craft.found.diagnosis
    if not d.causes:
        return f"The cause was not found: {d.sentence}", "bad"
    right = found_hidden(craft)
    text = plain_words(d)
    if right is None:
        return f"{text} What was hidden is something else, see below.", "bad"
    return text, "good" if right else "warn"


def found_hidden(craft: DemoCraft) -> bool | None:
    """Return whether the hidden value lies in the interval found; ``None`` where another cause is named."""
    for cause in craft.found.diagnosis.causes:
        for p in cause.parameters:
            if (value := craft.true_value(cause, p)) is not None:
                return p.interval[0] <= value <= p.interval[1]
    return None


def steps(craft: DemoCraft, seen: OpenLoop | None) -> tuple[str, ...]:
    """Return the story in steps, with the figures of this run."""
    d, r = craft.found.diagnosis, craft.estimation
    times = r.time()
    out = [
        f"Measured: a flight of {times[-1] - times[0]:g} s, arm and wheels driven by known torques, "
        f"{len(times)} samples of pose, gyro, accelerometer, encoders and tachometers with their noise. It "
        f"was made by {craft.engine}, whose model shares no code with smsid's. A second flight is kept aside "
        "to judge by."
    ]
    if told := _errors(seen, (DESCRIBED,), 2):
        out.append(
            f"What the simulation gets wrong: driven by the same torques, the described craft strays. {told}."
        )
    good = sum(p.status == "identifiable" for p in asked_for(craft.estimate))
    text = (
        f"Identified: the description is a guess that is off by several per cent. {good} parameters are "
        "found to better than 10 %"
    )
    if told := _errors(seen, (DESCRIBED, IDENTIFIED), 1):
        text += f". Better numbers alone do not mend the simulation: {told} (described → identified)"
    out.append(text + ".")
    if d.causes:
        tried = craft.found.search.candidates if craft.found.search is not None else 0
        sentence = d.sentence.replace("+-", "±")
        out.append(
            f"The cause by name, out of {tried} candidates, told nothing of what was hidden: {sentence}"
        )
    if d.causes and seen is not None:
        told = _errors(seen, (DESCRIBED, EXTENDED), 3)
        out.append(f"The gain, on the flight that was not used (described → with the cause): {told}.")
    return tuple(out)


def _errors(seen: OpenLoop | None, models: Sequence[str], most: int) -> str:
    """Return by how much models are off in the components where the cause tells most."""
    if seen is None:
        return ""
    told = []
    for c in most_different(seen, DESCRIBED, EXTENDED, most):
        values = " → ".join(number(seen.rms(c, m), 2) for m in models if m in seen.models)
        told.append(f"{c.name} is off by {values} {unit(c.unit)}".strip())
    return "; ".join(told)


def cause_section(craft: DemoCraft) -> Section:
    """Return the causes with their intervals beside what was hidden."""
    d, h = craft.found.diagnosis, craft.hidden
    rows = []
    for cause in d.causes:
        for p in cause.parameters:
            hidden = craft.true_value(cause, p)
            label = f"{cause.label} ({cause.effect.replace('_', ' ')})"
            shown = "none" if hidden is None else (hidden, 6)
            rows.append(cells(label, cause.location, (p.value, 6), interval_cell(p), shown, unit(p.unit)))
    parts: list[Text | Table] = [Text((d.sentence.replace("+-", "±"),))]
    if rows:
        columns = ("cause", "where", "#found", "#95 % interval", "#hidden", "unit")
        parts.append(Table("Found, and hidden", columns, rows))
    ending = {
        True: "The interval found holds it.",
        False: "The right cause; the interval found does not hold the value.",
        None: "It was not found.",
    }[found_hidden(craft)]
    hidden = f"{h['parameter']} = {number(h['value'], 6)} {unit(h['unit'])} ({h['effect'].replace('_', ' ')})"
    parts.append(Text((f"What was hidden: {hidden} at {h['location']}. {ending}",)))
    return Section("cause", "The cause, and what was hidden", parts)


def values_section(craft: DemoCraft) -> Section:
    """Return the identified parameters beside the wrong guess and the truth."""
    own = [p for p in asked_for(craft.estimate) if p.status == "identifiable"]
    bodies = described_bodies(craft.description)
    effects = {name: value for name, value in craft.parameters.items() if name not in bodies}
    world = TrueWorld(craft.parameters, bodies, effects)
    truth = world.values_of(own)
    known = [p for p in own if p.name in truth]
    inside, rows = 0, []
    for p in known:
        within = p.interval[0] <= truth[p.name] <= p.interval[1]
        inside += within
        found = (p.value, 5), interval_cell(p), (truth[p.name], 5), unit(p.unit)
        verdict_ = Cell("yes" if within else "no", tone="good" if within else "warn")
        rows.append(cells(p.name, (p.nominal, 5), *found, verdict_))
    columns = ("parameter", "#described", "#identified", "#95 % interval", "#truth", "unit", "truth inside")
    title = "Found to better than 10 % from one flight without thrust"
    note = "A sum is a combination of inertial parameters: its terms alone cannot be told from this motion."
    gist = f"{inside} of {len(known)} intervals hold the truth; 95 % should"
    return Section("values", "Identified values", (Table(title, columns, rows, note),), gist, open=False)


def _glance(craft: DemoCraft, seen: OpenLoop | None) -> tuple[tuple[str, str], ...]:
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


@dataclass(frozen=True)
class TrueWorld:
    """Single parameters of a world by name, beside what the description said of its bodies.

    ``bodies`` are the true inertial parameters of the URDF's bodies, ``described`` the description's, by
    ``<body>.<symbol>``; ``values`` other true values by the names that estimates use. Nothing is said of
    combinations with a body in ``unsaid``: one whose appendages differ, too, say.
    """

    bodies: Mapping[str, float]
    described: Mapping[str, float]
    values: Mapping[str, float] = field(default_factory=dict)
    unsaid: tuple[str, ...] = ()

    def value(self, p: ParameterEstimate) -> float | None:
        """Return the true value of a parameter or of a combination of inertial ones; ``None`` if not known.

        A combination is taken apart: its described value, and for every term by how much the world differs.
        That two groups of an estimate may give one name to different things does no harm.
        """
        if p.name in self.values:
            return self.values[p.name]
        terms = parse_combination(p.name)
        if terms is None or p.nominal is None:
            return None
        known = self.bodies.keys() & self.described.keys()
        if any(n not in known or n.split(".")[0] in self.unsaid for n in terms):
            return None
        return p.nominal + sum(f * (self.bodies[n] - self.described[n]) for n, f in terms.items())

    def values_of(self, parameters: Iterable[ParameterEstimate]) -> dict[str, float]:
        """Return the true values by the parameters' names, of those that are known."""
        found = {p.name: self.value(p) for p in parameters}
        return {name: value for name, value in found.items() if value is not None}


def described_bodies(description: Description) -> dict[str, float]:
    """Return the inertial parameters of the URDF's bodies by ``<body>.<symbol>``, as they stand there."""
    model = build_model(description)
    names = dict(zip(list(model.pin.names)[1:], body_names(model.pin), strict=True))
    return {
        f"{names[joint]}.{symbol}": float(x)
        for joint, theta in urdf_bodies(description).items()
        for symbol, x in zip(INERTIAL_NAMES, theta, strict=True)
    }
