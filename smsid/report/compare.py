"""The report of ``smsid compare``."""

from __future__ import annotations

from smsid.comparison.result import Comparison, Finding
from smsid.report.model import Cell, Provenance, Report, Section, Table, Text
from smsid.report.numbers import number


def compare_report(found: Comparison, origin: Provenance) -> Report:
    """Return the report of a comparison: findings with their numbers, then every parameter."""
    findings = tuple(
        part
        for f in found.findings
        for part in (Text((f.sentence,)), *([_numbers(f)] if f.quantities else []))
    )
    sections = [Section("findings", "What it means", findings)] if findings else []
    sections.append(Section("parameters", "Every parameter", (_parameters(found),)))
    if found.not_comparable:
        rows = tuple((Cell(n.name), Cell(n.estimate), Cell(n.reason)) for n in found.not_comparable)
        table = Table("not comparable", ("parameter", "estimate", "why"), rows)
        sections.append(Section("not_comparable", "Not comparable", (table,), open=False))
    if found.notes:
        sections.append(Section("notes", "Notes", (Text(found.notes, bullets=True),)))
    glance = [("changed", f"{sum(p.changed for p in found.parameters)} of {len(found.parameters)}")]
    if found.statistic is not None:
        glance.append(("chi-squared", f"{number(found.statistic)} of {found.freedom}"))
    return Report(
        "Comparison of two estimates",
        f"{found.first} and {found.second}",
        found.sentence,
        "warn" if found.changed else "good",
        tuple(sections),
        origin,
        tuple(glance),
    )


def _numbers(finding: Finding) -> Table:
    rows = tuple(
        (
            Cell(q.name),
            Cell(number(q.value, 5), q.value),
            Cell(number(1.96 * q.sigma, 2), 1.96 * q.sigma),
            Cell(q.unit),
            Cell("" if q.told else "not told", tone="neutral" if q.told else "warn"),
        )
        for q in finding.quantities
    )
    return Table(finding.subject or "numbers", ("quantity", "#value", "#± 95 %", "unit", ""), rows)


def _parameters(found: Comparison) -> Table:
    rows = tuple(
        (
            Cell(p.name),
            Cell(number(p.before, 6), p.before),
            Cell(number(p.after, 6), p.after),
            Cell(number(p.change, 3), p.change),
            Cell(number(1.96 * p.sigma, 2), 1.96 * p.sigma),
            Cell(number(p.deviations, 3), p.deviations),
            Cell(p.unit),
            Cell("changed" if p.changed else "", tone="warn" if p.changed else "neutral"),
        )
        for p in sorted(found.parameters, key=lambda p: p.p_value)
    )
    columns = ("parameter", "#before", "#after", "#change", "#± 95 %", "#sigma", "unit", "")
    return Table("parameters, those that changed most first", columns, rows)
