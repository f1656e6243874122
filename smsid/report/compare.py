"""The report of ``smsid compare``."""

from __future__ import annotations

from smsid.comparison.result import Comparison, Finding
from smsid.report.model import Cell, Provenance, Report, Section, Table, Text, Tone, cells, notes_section
from smsid.report.numbers import number


def compare_report(found: Comparison, origin: Provenance) -> Report:
    """Return the report of a comparison: findings with their numbers, then every parameter."""
    findings = tuple(
        part
        for f in found.findings
        for part in (Text((f.sentence,)), *([numbers_table(f)] if f.quantities else []))
    )
    sections = [Section("findings", "What it means", findings)] if findings else []
    sections.append(Section("parameters", "Every parameter", (parameters_table(found),)))
    if found.not_comparable:
        rows = [cells(n.name, n.estimate, n.reason) for n in found.not_comparable]
        table = Table("not comparable", ("parameter", "estimate", "why"), rows)
        sections.append(Section("not_comparable", "Not comparable", (table,), open=False))
    sections += notes_section(found.notes, open=True)
    glance = [("changed", f"{sum(p.changed for p in found.parameters)} of {len(found.parameters)}")]
    if found.statistic is not None:
        glance.append(("chi-squared", f"{number(found.statistic)} of {found.freedom}"))
    title, subject = "Comparison of two estimates", f"{found.first} and {found.second}"
    tone: Tone = "warn" if found.changed else "good"
    return Report(title, subject, found.sentence, tone, sections, origin, glance)


def numbers_table(finding: Finding) -> Table:
    """Return the numbers of a finding with their intervals."""
    rows = [
        cells(q.name, (q.value, 5), (1.96 * q.sigma, 2), q.unit, "")
        if q.told
        else cells(q.name, "", "", q.unit, Cell("not told", tone="warn"))
        for q in finding.quantities
    ]
    return Table(finding.subject or "numbers", ("quantity", "#value", "#± 95 %", "unit", ""), rows)


def parameters_table(found: Comparison) -> Table:
    """Return every parameter before and after, those that changed most first."""
    rows = []
    for p in sorted(found.parameters, key=lambda p: p.p_value):
        change = (p.before, 6), (p.after, 6), (p.change, 3), (1.96 * p.sigma, 2), (p.deviations, 3)
        rows.append(cells(p.name, *change, p.unit, Cell("changed", tone="warn") if p.changed else ""))
    columns = ("parameter", "#before", "#after", "#change", "#± 95 %", "#sigma", "unit", "")
    return Table("parameters, those that changed most first", columns, rows)
