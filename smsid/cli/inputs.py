"""What commands read, and what several of them write and print of what they made of it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from smsid.cli.output import print_parts, say, show_spinner

if TYPE_CHECKING:
    from smsid.description import Description
    from smsid.diagnose import Diagnosis
    from smsid.identify.estimate import Estimate
    from smsid.recording import Recording
    from smsid.report import Provenance, Report


def read_recordings(paths: Collection[Path], unchecked: bool = False) -> list[Recording]:
    """Return recordings, those without a name called as their files.

    ``unchecked`` ones are used although channels contradict each other.
    """
    from smsid.recording import load_recording

    found = [load_recording(path) for path in paths]
    found = [r if r.name else r.with_name(path.stem) for r, path in zip(found, paths, strict=True)]
    return [recording.unchecked() if unchecked else recording for recording in found]


def read_estimate(path: Path | None) -> Estimate | None:
    """Return an estimate, if one is given."""
    from smsid.identify.estimate import load_estimate

    return None if path is None else load_estimate(path)


def write_diagnosis(diagnosis: Diagnosis, path: Path) -> Path:
    """Write and print a diagnosis of a laboratory test; return where it is."""
    from smsid.cli.diagnose import diagnosis_parts
    from smsid.diagnose.result import save_diagnosis

    save_diagnosis(diagnosis, path)
    print_parts(diagnosis_parts(diagnosis))
    return path


def print_estimate(estimate: Estimate, more: Sequence[str] = (), *, everything: bool = False) -> None:
    """Print the parameters and notes of an estimate, and ``more`` notes."""
    from smsid.cli.output import note_lines
    from smsid.cli.tables import estimate_parts

    print_parts(estimate_parts(estimate, everything=everything))
    for line in note_lines((*estimate.notes, *more), everything=everything):
        say(line)


def write_page(
    path: Path | None,
    make: Callable[[Provenance], Report],
    inputs: Sequence[Path | None],
    described: Description | None = None,
    *,
    seed: object = None,
) -> list[Path]:
    """Write the report where one was asked for, and return its path.

    ``make`` returns it, ``inputs`` are the files it is made from; ``described`` is the description that the
    first of them holds, whose URDFs are inputs as well.
    """
    if path is None:
        return []
    from smsid.report import files_of, provenance, write_report

    files = [f for f in inputs if f is not None]
    named = files_of(described, files[0]) if described is not None and files else []
    with show_spinner("writing the report"):
        return [write_report(make(provenance([*named, *files], seed=seed)), path)]
