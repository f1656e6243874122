"""Where a command reads and writes: no output is an input or another output, each file fits its place."""

from __future__ import annotations

import inspect
import json
import math
import os
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import typer

from smsid._files import check_target, is_same_file, is_signed
from smsid._temporary import remove_orphans
from smsid.cli.file_kind import LOGS, kind_of
from smsid.errors import OutputError, SmsidError

LARGEST_TOML = 4_000_000  # bytes: of a larger one the files it names are not looked up


@dataclass(frozen=True)
class Writes:
    """Mark of a path that a command writes; every other path is one it reads.

    ``suffixes`` it may end in, or ``folder``; ``beside`` gives the other files that are written with it.
    Nobody named those, nor a path that is a default: what is there already is replaced only if smsid wrote it
    and it is of the kind that is written, ``kind`` and ``beside_kind``.
    """

    suffixes: tuple[str, ...] = ()
    folder: bool = False
    kind: str = ""
    beside: Callable[[Path], Sequence[Path]] = lambda _: ()
    beside_kind: str = ""


@dataclass(frozen=True)
class Place:
    """A path of a command with the name it has on the command line."""

    name: str
    path: Path


def output_marks(function: Callable[..., Any]) -> dict[str, Writes]:
    """Return the marks of a command's parameters by name."""
    found = {}
    for name, p in inspect.signature(function, eval_str=True).parameters.items():
        marks = [m for m in get_args(p.annotation) if isinstance(m, Writes)]
        if marks:
            found[name] = marks[-1]
    return found


def is_argument(parameter: inspect.Parameter) -> bool:
    """Return whether a parameter stands on the command line without a name."""
    return any(isinstance(m, typer.models.ArgumentInfo) for m in get_args(parameter.annotation))


def option_name(parameter: inspect.Parameter) -> str:
    """Return what a parameter is called on the command line: ``--report``, or ``DESCRIPTION``."""
    for info in get_args(parameter.annotation):
        # inside Annotated typer keeps the first name where the default would be
        names = [getattr(info, "default", None), *(getattr(info, "param_decls", None) or ())]
        long = [n for n in names if isinstance(n, str) and n.startswith("--")]
        if long:
            return long[0].partition("/")[0]
        if isinstance(info, typer.models.ArgumentInfo):
            return parameter.name.upper()
    return "--" + parameter.name.replace("_", "-")


def check_places(
    function: Callable[..., Any], options: Mapping[str, Any], unnamed: Collection[str] = ()
) -> list[Path]:
    """Check every output of a command before it works; return the inputs, which stay protected while it runs.

    Compared are outputs with each other and with what is read: paths that are given, words that name a file,
    and files that a TOML among them names. Of the options that are ``unnamed`` nobody gave a value. Orphans
    of killed runs beside the outputs are removed.

    Raises:
        OutputError: an output is an input or another output, has a suffix that does not fit, cannot be
            written, or would replace a TOML written by hand, or what smsid did not write at a place that
            nobody named.
    """
    marks = output_marks(function)
    parameters = inspect.signature(function, eval_str=True).parameters
    outputs, inputs = [], []
    for name, value in options.items():
        called = option_name(parameters[name])
        if name in marks:
            if value is not None:
                outputs += _output_places(called, Path(value), marks[name])
        else:
            inputs += [Place(called, path) for path in _read_paths(value)]
    inputs += [Place(f"what {p.path} names", q) for p in inputs for q in _named_files(p.path)]
    for k, out in enumerate(outputs):
        for other in outputs[:k]:
            if is_same_file(out.path, other.path):
                raise _clash(out, f"the same file as {other.name}")
        for source in inputs:
            if is_same_file(out.path, source.path) or _is_inside(out.path, source.path):
                raise _clash(out, f"an input ({source.name})")
    for name in marks:
        if options.get(name) is not None:
            called = option_name(parameters[name])
            _check_replaced(
                called, Path(options[name]), marks[name], name in unnamed, [p.path for p in inputs]
            )
    return [p.path for p in inputs if os.path.isfile(p.path)]


def check_numbers(options: Mapping[str, Any]) -> None:
    """Raise `SmsidError` for an option that is not a number where one is asked for."""
    for name, value in options.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise SmsidError(
                f"--{name.replace('_', '-')} {value} is no finite number.", advice="Give a finite number."
            )


def _clash(out: Place, what: str) -> OutputError:
    return OutputError(
        f"{out.name} '{out.path}' is {what}; writing it would destroy that.",
        advice=f"Give {out.name} another path.",
        path=str(out.path),
    )


def _output_places(called: str, path: Path, mark: Writes) -> list[Place]:
    if path.name.startswith("--"):
        raise OutputError(
            f"{called} is followed by '{path}', which is an option.", advice=f"Give {called} a path first."
        )
    if mark.folder:
        if os.path.isfile(path):
            raise OutputError(f"{called} '{path}' is a file.", advice="Name a folder.", path=str(path))
        return [Place(called, path), *(Place(f"{called} ({p.name})", p) for p in mark.beside(path))]
    target = check_target(path)
    if mark.suffixes and path.suffix.lower() not in mark.suffixes:
        raise OutputError(
            f"{called} '{path}' does not fit what is written: it ends in '{path.suffix}'.",
            advice=f"End it in {' or '.join(mark.suffixes)}.",
            path=str(path),
        )
    places = [Place(called, path)]
    for more in mark.beside(path):
        check_target(more)
        places.append(Place(f"{more.name} beside {called}", more))
    remove_orphans(target.parent)
    return places


def _check_replaced(called: str, path: Path, mark: Writes, is_default: bool, inputs: Sequence[Path]) -> None:
    """Refuse to replace what is there, where it is somebody's work: a TOML written or changed by hand, as a
    drafted mapping that was gone through, or what `_check_default` refuses.
    """
    if not is_default and path.suffix.lower() == ".toml" and path.is_file() and not is_ours(path):
        raise OutputError(
            f"{called} '{path}' is there already and was written or changed by hand.",
            advice=f"Give {called} another path, or remove that file.",
            path=str(path),
        )
    if is_default and mark.kind:
        _check_default(path, mark.kind, f"the default of {called}", inputs)
    for more in mark.beside(path) if mark.beside_kind else ():
        _check_default(more, mark.beside_kind, f"written beside '{path}'", inputs)


def _read_paths(value: Any) -> Iterator[Path]:
    if isinstance(value, Path):
        yield value
    elif isinstance(value, str):
        if value and os.path.isfile(Path(value)):  # a word may name a file; a folder of that name is chance
            yield Path(value)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _read_paths(item)


def _named_files(path: Path) -> Iterator[Path]:
    """Yield the files that a TOML names anywhere, as a description its URDF; they are inputs as well."""
    if path.suffix.lower() != ".toml" or not os.path.isfile(path) or path.stat().st_size > LARGEST_TOML:
        return
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError, RecursionError):
        return  # the command that reads it says what is wrong
    for word in _words(tables):
        file = path.parent / word
        if os.path.isfile(file):
            yield file


def _words(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for item in value.values():
            yield from _words(item)
    elif isinstance(value, list):
        for item in value:
            yield from _words(item)


def _is_inside(path: Path, folder: Path) -> bool:
    """Return whether something that is there lies in an input that is a folder, as a bag is."""
    there = os.path.exists(path) and os.path.isdir(folder)
    return there and path.resolve().is_relative_to(folder.resolve())


LOG = "a log"
KINDS = {
    ".nc": "a recording",
    ".toml": "a TOML (description, experiment or mapping)",
    ".urdf": "a URDF",
    ".xacro": "a xacro",
    ".sdf": "an SDF",
    ".mjcf": "an MJCF",
    ".xml": "an MJCF",
    ".json": "a JSON (estimate, diagnosis or controller)",
    ".jsonl": "the store of a campaign",
    **dict.fromkeys(LOGS, LOG),
}
"""What a file is by its suffix."""

ROBOTS = (".toml", ".urdf", ".xacro", ".sdf", ".mjcf", ".xml")
WANTED = {
    "description": ("description (TOML or URDF)", ROBOTS),
    "experiment": ("experiment (TOML or a name)", (".toml",)),
    "recordings": ("recordings (.nc)", (".nc", ".h5", ".hdf5")),
    "recording": ("recording (.nc)", (".nc", ".h5", ".hdf5")),
    "validate": ("recordings (.nc)", (".nc", ".h5", ".hdf5")),
    "estimate": ("estimate (JSON)", (".json",)),
    "second": ("estimate (JSON)", (".json",)),
    "truth": ("estimate (JSON)", (".json",)),
    "mapping": ("mapping (TOML)", (".toml",)),
    "plan": ("plan (TOML)", (".toml",)),
    "arm": ("description (TOML or URDF)", ROBOTS),
}
"""What a parameter takes by its name, and the suffixes that fit."""

ORDINALS = ("first", "second", "third")


def check_kinds(function: Callable[..., Any], options: Mapping[str, Any]) -> None:
    """Raise `SmsidError` where a file is given in the place of another kind, and say which goes where."""
    parameters = inspect.signature(function, eval_str=True).parameters
    order = [name for name, p in parameters.items() if is_argument(p)]
    # a robot by its name stands in the description's place: the first argument is a recording then
    wants = WANTED | {"description": WANTED["recordings"]} if options.get("robot") else WANTED
    for name, value in options.items():
        if name not in wants:
            continue
        wanted, fitting = wants[name]
        for path in value if isinstance(value, list | tuple) else [value]:
            suffix = Path(path).suffix.lower() if isinstance(path, str | Path) else ""
            if suffix not in KINDS or suffix in fitting:
                continue
            if name in order:
                verb = "come" if "recordings" in wanted else "comes"
                place = f"the {wanted} {verb} {ORDINALS[order.index(name)]}"
                usage = " ".join(n.upper() for n in order)
            else:
                place = f"{option_name(parameters[name])} takes the {wanted}"
                usage = f"{option_name(parameters[name])} {Path('FILE').with_suffix(fitting[0])}"
            advice = f"Give {usage}."
            if KINDS[suffix] == LOG and "recording" in wanted:
                advice = "Turn it into a recording with `smsid import` first."
            raise SmsidError(f"'{path}' is {KINDS[suffix]}; {place}.", advice=advice, path=str(path))


FIGURE, PAGE = "figure", "page"
MARKED = {
    ".png": (FIGURE, b"Software\0smsid"),
    ".html": (PAGE, b'<meta name="generator" content="smsid'),
}
"""Kinds that are known by a mark near the beginning of the file."""
MARKED_WITHIN = 4096  # bytes


def is_ours(path: Path) -> bool:
    """Whether a text is there that smsid wrote, and nobody changed since."""
    try:
        return is_signed(path.read_text(encoding="utf-8"))
    except (ValueError, OSError):
        return False


def _check_default(path: Path, kind: str, told: str, inputs: Sequence[Path]) -> None:
    """Refuse to replace a file of somebody else's, or measured data, at a place that nobody named.

    ``told`` says why it would be written there, ``inputs`` are the files the command reads. Refused is what
    was not written by smsid, is of another kind, was changed by hand, or holds a recording imported from a
    log that is none of the inputs.
    """
    if path.is_file() and (reason := _why_not(path, kind, inputs)):
        raise OutputError(
            f"'{path}' ({told}) is there already and {reason}.",
            advice="Name the output by --output (-o), or move that file.",
            path=str(path),
        )


def _why_not(path: Path, kind: str, inputs: Sequence[Path]) -> str:
    found = _written_kind(path)
    if not found:
        changed = ", or was changed since" if path.suffix == ".toml" else ""
        return f"is no {kind.replace('_', ' ')} that smsid wrote{changed}"
    if found != kind:
        return f"is {_article(found)}, not {_article(kind)}"
    log = _imported_from(path) if kind == "recording" else ""
    if log and log not in [p.name for p in inputs]:
        return f"holds what was measured in '{log}'"
    return ""


def _article(kind: str) -> str:
    return f"{'an' if kind[0] in 'aeiou' else 'a'} {kind.replace('_', ' ')}"


def _written_kind(path: Path) -> str:
    """Return the kind of a file that smsid wrote and nobody changed; nothing of another."""
    suffix = path.suffix.lower()
    if suffix in MARKED:
        kind, mark = MARKED[suffix]
        with path.open("rb") as stream:
            return kind if mark in stream.read(MARKED_WITHIN) else ""
    try:
        kind = kind_of(path)
    except SmsidError:
        return ""
    if suffix == ".toml" and not is_ours(path):
        return ""
    from smsid.recording.storage import file_attribute

    return kind if suffix != ".nc" or file_attribute(path, "schema").startswith("smsid.") else ""


def _imported_from(path: Path) -> str:
    """Return the name of the log that a recording was imported from and is still whole of."""
    from smsid.recording.storage import file_attribute

    try:
        made = json.loads(file_attribute(path, "provenance"))
        return "" if made.get("steps") else str(made["imported"]["file"])
    except (ValueError, LookupError, TypeError, AttributeError):
        return ""
