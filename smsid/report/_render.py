"""From a report to one HTML file that needs nothing else, with its origin: versions, files and their sums."""

from __future__ import annotations

import os
import platform
import shlex
import sys
from collections.abc import Iterable
from datetime import UTC, datetime
from functools import cache
from importlib import metadata, resources
from pathlib import Path
from typing import TYPE_CHECKING

from smsid._files import atomic_write, sha256
from smsid._version import __version__
from smsid.report.model import Provenance, Report, Table, cells

if TYPE_CHECKING:
    from jinja2 import Environment

    from smsid.description import Description

FOLDER = "templates"


def write_report(report: Report, path: str | os.PathLike[str]) -> Path:
    """Write a report as one self-contained HTML file, whole or not at all, and return its path.

    Raises `SmsidError` when the folder does not exist.
    """
    return atomic_write(path, render(report))


def render(report: Report) -> str:
    """Return the HTML of a report; style, script and data are in it. All text is escaped."""
    inputs = None
    if report.provenance.inputs:
        rows = [cells(name, digest) for name, digest in report.provenance.inputs.items()]
        inputs = Table("inputs", ("file", "sha256"), rows)
    page = _environment().get_template("report.html")
    return page.render(r=report, inputs=inputs, style=_source("style.css"), script=_source("report.js"))


@cache
def _environment() -> Environment:
    # only who writes a report pays for the templates
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("smsid.report", FOLDER),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )


def _source(name: str) -> str:
    return resources.files("smsid.report").joinpath(FOLDER, name).read_text(encoding="utf-8")


PACKAGES = {"pinocchio": "pin", "numpy": "numpy", "scipy": "scipy", "numba": "numba"}


def provenance(inputs: Iterable[str | os.PathLike[str]] = (), *, seed: object = None) -> Provenance:
    """Return how what is running now came to be; files that a description names are to be given too.

    The machine is told by system and processor, without its name.
    """
    versions = {"smsid": __version__, "python": platform.python_version()}
    for name, package in PACKAGES.items():
        try:
            versions[name] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return Provenance(
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        command=" ".join([Path(sys.argv[0]).name, *(shlex.quote(a) for a in sys.argv[1:])]),
        versions=versions,
        machine=f"{platform.system()} {platform.machine()}",
        inputs={p: sha256(p) if Path(p).is_file() else "not a file" for p in dict.fromkeys(map(str, inputs))},
        seed="" if seed is None else str(seed),
    )


def files_of(description: Description, path: str | os.PathLike[str]) -> list[str]:
    """Return the files a description is made of: its own, and the URDFs it names."""
    named = [description.urdf, *(a.urdf for a in description.arm if a.urdf)]
    found = [str(Path(description.folder, n)) for n in named if Path(description.folder, n).is_file()]
    return [str(path), *found]
