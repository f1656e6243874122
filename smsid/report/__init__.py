"""Reports: one self-contained HTML from each command, a verdict on top, everything behind it below."""

from smsid._callable import make_callable
from smsid.report.heat import HeatCell, HeatMap
from smsid.report.model import Cell, Figure, Grid, Provenance, Report, Section, Table, Text
from smsid.report.plot import Band, Curve, Plot, Rule
from smsid.report.render import files_of, provenance, render, write_report
from smsid.report.rows import Bar, Mark, Row, RowChart
from smsid.report.traces import Trace, Traces

__all__ = [
    "Band",
    "Bar",
    "Cell",
    "Curve",
    "Figure",
    "Grid",
    "HeatCell",
    "HeatMap",
    "Mark",
    "Plot",
    "Provenance",
    "Report",
    "Row",
    "RowChart",
    "Rule",
    "Section",
    "Table",
    "Text",
    "Trace",
    "Traces",
    "files_of",
    "provenance",
    "render",
    "write_report",
]

make_callable(__name__)  # smsid.report(...) is that of smsid.api
