"""What a command says and where: results on stdout, progress and warnings on stderr, notes by kind, JSON."""

from __future__ import annotations

import logging
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.progress import Progress

WIDTH = 110  # columns at most, on a terminal and in a file


@dataclass(frozen=True)
class OutputMode:
    """How the command under way was asked to speak: as ``json``, or ``quiet``, or to people."""

    json: bool = False
    quiet: bool = False


_now = OutputMode()


@contextmanager
def output_options(mode: OutputMode) -> Iterator[None]:
    """Speak in this mode inside the block: quiet is quiet about the library's warnings too."""
    global _now
    before, _now = _now, mode
    handlers = [(h, h.level) for h in logging.getLogger().handlers] if mode.quiet else []
    for handler, _ in handlers:
        handler.setLevel(logging.ERROR)
    try:
        yield
    finally:
        _now = before
        for handler, level in handlers:
            handler.setLevel(level)


def asks_json() -> bool:
    """Return whether the result is to be printed as JSON, and nothing for people."""
    return _now.json


def console() -> Console:
    """Return the console for results (stdout); silent where a command runs ``--json`` or ``--quiet``."""
    from rich.console import Console

    wide = Console()
    return Console(width=min(wide.width, WIDTH) if sys.stdout.isatty() else WIDTH)


def say(text: str, *, style: str = "") -> None:
    """Print sentences of a result, wrapped between words; what is longer than a line stays whole: a path."""
    from rich.text import Text

    out = console()
    out.print(Text(wrap_text(text, out.width), style=style), soft_wrap=True)


def print_parts(parts: Iterable[RenderableType]) -> None:
    """Print tables and lines of a result."""
    out = console()
    for part in parts:
        out.print(part, highlight=False)


def wrap_text(text: str, width: int) -> str:
    """Return a text in lines of at most ``width`` characters, broken between words."""
    lines = [
        part
        for line in text.split("\n")
        for part in textwrap.wrap(
            line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
        )
        or [""]
    ]
    return "\n".join(lines)


def error_console() -> Console:
    """Return the console for progress, warnings and errors (stderr)."""
    from rich.console import Console

    return Console(stderr=True)


def warn(text: str) -> None:
    """Print a warning on stderr, unless ``--quiet``."""
    if not _now.quiet:
        error_console().print(
            f"warning: {text}", style="yellow", markup=False, highlight=False, soft_wrap=True
        )


@contextmanager
def show_spinner(label: str) -> Iterator[Callable[[str], None]]:
    """Show on a terminal's stderr that something is under way, for how long, and what the library logs.

    Yields a function that changes the label. Nothing is left on the screen.
    """
    if not _is_watched():  # rich's columns take time to load
        yield lambda text: None
        return
    from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        TextColumn("[dim]{task.fields[news]}"),
    )
    with _bar(*columns) as bar:
        task = bar.add_task(label, total=None, news="")
        with _forward_log(lambda news: bar.update(task, news=news)):
            yield lambda text: bar.update(task, description=text)


@contextmanager
def show_progress(label: str, total: float = 0.0, unit: str = "") -> Iterator[Callable[..., None]]:
    """Show a bar on a terminal's stderr; yields a function that takes how much of ``total`` is done.

    It also takes another ``total``, and a ``note`` behind the label.
    """
    if not _is_watched():
        yield lambda done, total=None, note="": None
        return
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn

    amount = TextColumn("{task.completed:.0f}/{task.total:.0f} " + unit)
    with _bar(TextColumn("{task.description}"), BarColumn(), amount, TimeRemainingColumn()) as bar:
        task = bar.add_task(label, total=total)

        def tell(done: float, total: float | None = None, note: str = "") -> None:
            bar.update(task, completed=done, total=total, description=f"{label}{note}")

        yield tell


def _is_watched() -> bool:
    return not _now.quiet and error_console().is_terminal


def _bar(*columns: object) -> Progress:
    from rich.progress import Progress

    return Progress(
        *columns,  # type: ignore[arg-type]
        console=error_console(),
        transient=True,
        redirect_stdout=False,  # results go where the user sends them, not to stderr
        redirect_stderr=False,
    )


class _Listener(logging.Handler):
    def __init__(self, tell: Callable[[str], None]) -> None:
        super().__init__(logging.INFO)
        self.tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage().replace("[", r"\[")
        self.tell(text if len(text) < 60 else text[:57] + "...")


@contextmanager
def _forward_log(tell: Callable[[str], None]) -> Iterator[None]:
    """Pass on what the library logs at INFO, without printing it."""
    logger, listener = logging.getLogger("smsid"), _Listener(tell)
    before = logger.level
    logger.addHandler(listener)
    logger.setLevel(min(logging.INFO, logger.getEffectiveLevel()))
    try:
        yield
    finally:
        logger.removeHandler(listener)
        logger.setLevel(before)


MOST = 6  # lines of notes, unless everything is asked for

_KINDS = (
    (
        re.compile(r"^only in combination: (?P<item>[^(]+?)(?: \(.*)?$", re.DOTALL),
        "{count} sets are seen only in combination: {items}",
    ),
    (
        re.compile(r"^(?P<item>\S+): noise of (?P<second>\S+) as its residuals show it: .*$"),
        "noise as the residuals show it, of {count} channels of {items}: --all",
    ),
    (re.compile(r"^(?P<item>.+?): .* left out: (?P<rest>.*)$"), "samples left out in {items}: --all"),
    (
        re.compile(r"^'(?P<item>[^']+)' contradicts the other recordings (?!.*One factor).*$", re.DOTALL),
        "{items} contradict each other: were they flown with the same spacecraft? In what, with --all",
    ),
    (
        re.compile(r"^(?P<item>\S+) stands? still .*$"),
        "stand still, their own parameters stay as described: {items}",
    ),
    (re.compile(r"^(?P<item>'.+?') has no mass in the URDF.*$"), "without mass in the URDF: {items}"),
)


def note_lines(notes: Iterable[str], *, everything: bool = False) -> list[str]:
    """Return lines that tell notes: each once, those of one kind together, at most `MOST` lines.

    ``everything``: every note in full, in the order given.
    """
    unique = list(dict.fromkeys(str(n) for n in notes))
    if everything:
        return [f"note: {n}" for n in unique]
    groups: dict[str, list[str]] = {}
    for n in unique:
        groups.setdefault(_kind(n)[0] or n, []).append(n)
    lines = []
    for sentence, own in groups.items():
        text = own[0]
        if len(own) > 1:
            names = list(dict.fromkeys(_kind(n)[1] for n in own))
            several = "; " if any("," in x for x in names) else ", "
            text = sentence.format(count=len(own), items=several.join(names))
        lines.append(clip_line(f"note: {text}"))
    if len(lines) > MOST:
        left = sum(len(own) for own in list(groups.values())[MOST - 1 :])
        lines = [*lines[: MOST - 1], f"note: {left} more with --all"]
    return lines


def clip_line(text: str, width: int = WIDTH) -> str:
    """Return one line of at most ``width`` characters; what is cut stands with ``--all``."""
    text = " ".join(text.split())
    tail = " ... (--all)"
    return text if len(text) <= width else text[: width - len(tail)].rstrip(" ,;(") + tail


def _kind(note: str) -> tuple[str, str]:
    """Return the sentence that notes of one kind share, and what this one is about."""
    for pattern, sentence in _KINDS:
        match = pattern.match(note)
        if match:
            return sentence, match["item"].strip()
    return "", note
