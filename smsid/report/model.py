"""What a report says, before anything is drawn: sections of text, tables and figures, and its origin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from smsid.report._traces import Traces
from smsid.report.heat import HeatMap
from smsid.report.numbers import number
from smsid.report.plot import Plot
from smsid.report.rows import RowChart

Tone = Literal["good", "warn", "bad", "neutral"]


@dataclass(frozen=True)
class Cell:
    """One entry of a table: the text shown, the number behind it (copied as CSV), what it is worth.

    ``spark`` is the path of a small curve in a box 100 wide and 24 high, drawn in place of a text.
    """

    text: str
    value: float | None = None
    tone: Tone = "neutral"
    spark: str = ""


CellValue = Cell | str | int | tuple[float | None, int] | tuple[float | None, int, Tone] | None
"""What `cells` makes a cell of."""


def cells(*values: CellValue) -> tuple[Cell, ...]:
    """Return a row of a table.

    Texts and cells stand as they are; ``(number, digits)`` or ``(number, digits, tone)`` is shown rounded and
    copied whole, a dash where there is none; a count is copied, too; ``None`` leaves a cell empty.
    """
    return tuple(_cell(v) for v in values)


def _cell(v: CellValue) -> Cell:
    if isinstance(v, Cell):
        return v
    if isinstance(v, tuple):
        x = None if v[0] is None else float(v[0])
        return Cell(number(x, v[1]), None if x is None or x != x else x, *v[2:])
    return Cell("" if v is None else str(v), float(v) if isinstance(v, int) else None)


@dataclass(frozen=True)
class Table:
    """A table. ``columns`` starting with ``#`` hold numbers and stand to the right; the first names the row.

    ``picks``: rows choose the trace of that number in the figure ``target`` of the same section.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    note: str = ""
    target: str = ""


@dataclass(frozen=True)
class Figure:
    """A figure with its title and a caption that says what to see in it. ``name`` marks it in the page."""

    name: str
    title: str
    body: Plot | RowChart | HeatMap | Traces
    caption: str = ""


@dataclass(frozen=True)
class Grid:
    """Small figures side by side, as many as fit; ``wide``: two at most."""

    title: str
    figures: Sequence[Figure]
    caption: str = ""
    wide: bool = False


@dataclass(frozen=True)
class Text:
    """Paragraphs, or the items of a list."""

    lines: Sequence[str]
    bullets: bool = False


@dataclass(frozen=True)
class Frame:
    """Another page within this one: its HTML, a title for who does not see it, its height [px], a caption."""

    html: str
    title: str
    height: int = 420
    caption: str = ""


@dataclass(frozen=True)
class Link:
    """A file beside the page: where it is from the page's folder, what it is called, what is in it."""

    target: str
    label: str
    what: str = ""


@dataclass(frozen=True)
class Links:
    """A list of files beside the page."""

    links: Sequence[Link]


Part = Text | Table | Figure | Grid | Links


@dataclass(frozen=True)
class Section:
    """A part that folds. ``name`` is its anchor; ``open``: unfolded at first; ``summary``: one line."""

    name: str
    title: str
    parts: Sequence[Part]
    summary: str = ""
    open: bool = True


def notes_section(notes: Sequence[str], *, open: bool = False) -> list[Section]:
    """Return the section "Notes", each one once; none where there are none."""
    own = list(dict.fromkeys(n for n in notes if n))
    return [Section("notes", "Notes", (Text(own, True),), f"{len(own)}", open)] if own else []


@dataclass(frozen=True)
class Provenance:
    """How a report came to be: versions, command, seed, sha256 sums of the files it was made from."""

    made: str
    command: str
    versions: Mapping[str, str]
    machine: str
    inputs: Mapping[str, str] = field(default_factory=dict)
    seed: str = ""


@dataclass(frozen=True)
class Report:
    """A report: title, the verdict in one sentence, a few figures at a glance, sections, provenance.

    ``picture`` stands above the verdict.
    """

    title: str
    subject: str
    verdict: str
    tone: Tone
    sections: Sequence[Section]
    provenance: Provenance
    glance: Sequence[tuple[str, str]] = ()
    picture: Frame | None = None
