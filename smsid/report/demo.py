"""The page of ``smsid demo``: from measured data to a cause by name, its gain, and the paper's tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from smsid.description.schema import Description
from smsid.diagnose.diagnose import RATE, Diagnosed
from smsid.diagnose.nominal import nominal
from smsid.estimation.parameter_vector import Point
from smsid.identify.estimate import Estimate, ParameterEstimate
from smsid.recording import Recording
from smsid.report.diagnose import share_sections
from smsid.report.model import Cell, Frame, Link, Links, Provenance, Report, Section, Table, Text, Tone
from smsid.report.numbers import half, number, share, unit
from smsid.report.open_loop import OpenLoop, telling
from smsid.report.parameters import reported
from smsid.report.plain_words import plain_words, quantity, strength
from smsid.report.shares import Shares
from smsid.report.story import story_section
from smsid.report.truth import TrueWorld, described_bodies

QUANTILE = 1.959964
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


@dataclass(frozen=True)
class Paper:
    """The paper's experiments, identified from a guess that is off: estimate, true values by name, notes."""

    estimate: Estimate
    truth: Mapping[str, float]
    notes: Sequence[str] = ()


class PaperRow(Protocol):
    """A row of the paper's Table 2: parameter, true value, the paper's estimate and error [%] as printed."""

    @property
    def label(self) -> str:
        """What the paper calls it, with its unit."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """The estimate's parameters that are averaged."""
        ...

    @property
    def truth(self) -> float:
        """True value."""
        ...

    @property
    def paper(self) -> str:
        """The paper's estimate."""
        ...

    @property
    def paper_error(self) -> str:
        """Its error [%], or what is printed in place of one."""
        ...


def demo_report(
    craft: Craft,
    paper: Paper,
    rows: Sequence[PaperRow],
    links: Sequence[Link],
    origin: Provenance,
    picture: Frame | None = None,
    shares: Shares | None = None,
) -> Report:
    """Return the page of a demonstration.

    Args:
        craft: the craft with something hidden.
        paper: the paper's experiments.
        rows: of the paper's Table 2.
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
    sections.append(paper_section(paper, rows))
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
        shown = telling(seen, DESCRIBED, EXTENDED, 2)
        told = "; ".join(_error_of(seen, c, (DESCRIBED,)) for c in shown)
        if told:
            out.append(
                "What the simulation gets wrong: driven by the same torques, the described craft "
                f"strays. {told}."
            )
    good = [p for p in reported(craft.estimate) if p.status == "identifiable"]
    text = (
        f"Identified: the description is a guess that is off by several per cent. {len(good)} "
        "parameters are found to "
        "better than 10 %"
    )
    if seen is not None:
        told = "; ".join(
            _error_of(seen, c, (DESCRIBED, IDENTIFIED)) for c in telling(seen, DESCRIBED, EXTENDED, 1)
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
            _error_of(seen, c, (DESCRIBED, EXTENDED)) for c in telling(seen, DESCRIBED, EXTENDED, 3)
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
    own = [p for p in reported(craft.estimate) if p.status == "identifiable"]
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


def paper_section(paper: Paper, rows: Sequence[PaperRow]) -> Section:
    """Return the paper's Tables 2 and 3 beside what is found from a guess that is off by several per cent."""
    text = (
        "The experiments of Rekleitis and Papadopoulos, flown in smsid's own simulation with sensor "
        "noise: this shows "
        "what the sensors tell, and proves nothing of the model, which identification shares. It "
        "starts from masses, "
        "inertias, slosh and panel that are 4 to 20 % off, and uses the default method, maximum likelihood. "
        "The paper's errors are from its own simulation."
    )
    more = tuple(paper.notes)
    parts = (
        Text((text,)),
        table_2(paper, rows),
        table_3(paper),
        *((Text(more, bullets=True),) if more else ()),
    )
    return Section("tables", "The paper's Tables 2 and 3", parts, "found from a wrong guess")


def table_2(paper: Paper, rows: Sequence[PaperRow]) -> Table:
    """Return the paper's Table 2 beside an estimate; values given per axis are averaged."""
    out = []
    for row in rows:
        found = [paper.estimate[n] for n in row.names if n in paper.estimate]
        cells = [Cell(row.label), Cell(number(row.truth, 6), row.truth), Cell(unit(row.paper))]
        cells.append(Cell(f"{row.paper_error} %" if row.paper_error[0].isdigit() else row.paper_error))
        if not found:
            out.append((*cells, Cell("–"), Cell("not found"), Cell(""), Cell(""), Cell("")))
            continue
        value = float(np.mean([p.value for p in found]))
        guesses = [p.nominal for p in found if p.nominal is not None]
        width = QUANTILE * float(np.sqrt(np.sum([p.sigma**2 for p in found]))) / len(found)
        # the truth is printed with so many digits, and no more can be asked of an interval
        printed = 0.5 * 10.0 ** -_decimals(row.truth)
        inside = abs(value - row.truth) <= width + printed
        error = abs(value / row.truth - 1.0)
        out.append(
            (
                *cells,
                Cell(number(float(np.mean(guesses)), 4) if guesses else "–"),
                Cell(number(value, 6), value),
                Cell(f"± {number(width, 2)}", width),
                Cell(share(error), error),
                Cell("yes" if inside else "no", tone="good" if inside else "warn"),
            )
        )
    columns = (
        "parameter", "#truth", "#paper", "#its error", "#guess", "#here", "#95 % interval", "#error",
        "truth inside",
    )  # fmt: skip
    return Table("Table 2: mass, slosh and panel", columns, tuple(out), ">> is printed in the paper.")


def _decimals(x: float) -> int:
    text = f"{x:.8f}".rstrip("0")
    return len(text.partition(".")[2])


def table_3(paper: Paper, shown: int = 3) -> Table:
    """Return the best and the worst identifiable inertial combinations, as the paper's Table 3 gives them."""
    usable = [
        (p, t)
        for p in reported(paper.estimate)
        if p.status == "identifiable" and not p.small and (t := paper.truth.get(p.name)) and _inertial(p)
    ]
    ranked = sorted(usable, key=lambda x: abs(x[0].value / x[1] - 1.0))
    few = ranked if len(ranked) <= 2 * shown else [*ranked[:shown], *ranked[-shown:]]
    rows: list[tuple[Cell, ...]] = [
        (
            Cell("paper's best, pi_m(2)"),
            Cell("336028.408"),
            Cell("335988.01"),
            Cell(""),
            Cell("0.01 %"),
            Cell(""),
        ),
        (Cell("paper's worst, pi_m(12)"), Cell("−1.06"), Cell("−1.11"), Cell(""), Cell("4.80 %"), Cell("")),
    ]
    for p, truth in few:
        low, high = p.interval
        error = abs(p.value / truth - 1.0)
        inside = low <= truth <= high
        rows.append(
            (
                Cell(p.name),
                Cell(number(truth, 6), truth),
                Cell(number(p.value, 6), p.value),
                Cell(half(p.value, low, high), 0.5 * (high - low)),
                Cell(share(error), error),
                Cell("yes" if inside else "no", tone="good" if inside else "warn"),
            )
        )
    columns = ("combination", "#truth", "#estimate", "#95 % interval", "#error", "truth inside")
    note = (
        f"Of {len(usable)} identifiable combinations of the arm's inertial parameters that are not "
        "zero; the paper's "
        "pi_m are sums of its own. Those with the bus hold the panel, too, and are left out here."
    )
    return Table("Table 3: the best and the worst inertial combinations", columns, tuple(rows), note)


def _inertial(p: ParameterEstimate) -> bool:
    return p.unit in ("kg m", "kg m^2")


def _glance(craft: Craft, seen: OpenLoop | None) -> tuple[tuple[str, str], ...]:
    d = craft.found.diagnosis
    out: list[tuple[str, str]] = []
    if d.causes:
        value = strength(d.causes[0])
        if value is not None:
            out.append((f"{d.causes[0].label} at {d.causes[0].location}, found", quantity(value)))
        out.append(("hidden", f"{number(craft.hidden['value'], 4)} {unit(craft.hidden['unit'])}"))
    if seen is not None and {DESCRIBED, EXTENDED} <= set(seen.models):
        for c in telling(seen, DESCRIBED, EXTENDED, 2):
            was, now = (number(seen.rms(c, m), 2) for m in (DESCRIBED, EXTENDED))
            out.append((f"{c.name}, error on the other flight", f"{was} → {now} {unit(c.unit)}"))
    return tuple(out)
