"""What commands read, and the report of what they made of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from smsid.cli.output import working

if TYPE_CHECKING:
    from smsid.description import Description
    from smsid.identify.estimate import Estimate
    from smsid.recording import Recording
    from smsid.report import Provenance, Report


def read_recordings(paths: Iterable[Path], unchecked: bool = False) -> list[Recording]:
    """Return recordings; ``unchecked`` ones are used although channels contradict each other."""
    from smsid.recording import load_recording

    found = (load_recording(path) for path in paths)
    return [recording.unchecked() if unchecked else recording for recording in found]


def read_estimate(path: Path | None) -> Estimate | None:
    """Return an estimate, if one is given."""
    from smsid.identify.estimate import load_estimate

    return None if path is None else load_estimate(path)


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
    with working("writing the report"):
        return [write_report(make(provenance([*named, *files], seed=seed)), path)]
