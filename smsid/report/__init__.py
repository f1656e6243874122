"""Reports: one self-contained HTML from each command, a verdict on top, everything behind it below."""

from smsid._callable import make_callable
from smsid.report._render import files_of, provenance, render, write_report
from smsid.report.model import Cell, Figure, Grid, Provenance, Report, Section, Table, Text

__all__ = [
    "Cell",
    "Figure",
    "Grid",
    "Provenance",
    "Report",
    "Section",
    "Table",
    "Text",
    "files_of",
    "provenance",
    "render",
    "write_report",
]

make_callable(__name__)  # smsid.report(...) is that of smsid.api
