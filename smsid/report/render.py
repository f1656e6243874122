"""From a report to one HTML file that needs nothing else: no network, no server, no Python."""

from __future__ import annotations

import os
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from smsid._files import atomic_write
from smsid.report.model import Report, Table, cells

if TYPE_CHECKING:
    from jinja2 import Environment

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
