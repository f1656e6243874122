"""The report of ``smsid demo``: both experiments identified, beside the paper's tables and the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from smsid.description.schema import Description
from smsid.identify.estimate import Estimate
from smsid.identify.pipeline import Identification
from smsid.recording import Recording
from smsid.report.identify import identify_sections, worst_ratio
from smsid.report.model import Provenance, Report, Section, Tone
from smsid.report.numbers import number, share
from smsid.report.parameters import Known, reported
from smsid.report.residuals import Residuals, residuals_of

BUDGET = 180_000


@dataclass(frozen=True)
class Shown:
    """One identification of the demonstration: what its recordings are, and what came out."""

    key: str
    title: str
    recordings: Sequence[Recording]
    identification: Identification


def demo_report(
    description: Description, shown: Sequence[Shown], paper: Mapping[str, float], origin: Provenance
) -> Report:
    """Return the report of a demonstration.

    Args:
        description: the paper's spacecraft, whose values are the truth.
        shown: the identifications, the most telling last.
        paper: the paper's relative errors by parameter [1].
        origin: versions, command, files.
    """
    sections: list[Section] = []
    tested: list[tuple[Shown, Sequence[Residuals]]] = []
    for s in shown:
        estimate = s.identification.estimate
        truth = {p.name: p.nominal for p in estimate.parameters if p.nominal is not None}
        known = Known(truth, paper)
        left = residuals_of(description, s.recordings, s.identification, None)
        tested.append((s, left))
        own = identify_sections(
            description, s.recordings, s.identification, None, known, left, prefix=f"{s.key}-", budget=BUDGET
        )
        many = len(shown) > 1
        sections += [
            replace(x, title=f"{s.title}: {x.title[0].lower()}{x.title[1:]}") if many else x for x in own
        ]
    sentence, tone = verdict(tested, paper)
    glance = []
    for s, left in tested:
        estimate = s.identification.estimate
        for name, label in (("total.mass", "M"), ("tank.mass", "m_s")):
            if name in estimate:
                error = share(_error(estimate, name), 2)
                glance.append((f"{label}, {s.title}: error", error))
        worst = worst_ratio(left)
        if worst is not None:
            glance.append((f"residual / noise, {s.title}", number(worst[1], 3)))
    return Report(
        "Demonstration", description.name, sentence, tone, tuple(sections), origin, tuple(glance[:8])
    )


def verdict(
    tested: Sequence[tuple[Shown, Sequence[Residuals]]], paper: Mapping[str, float]
) -> tuple[str, Tone]:
    """Return one sentence on the last identification shown, and what it is worth."""
    s, _ = tested[-1]
    estimate = s.identification.estimate
    own = [p for p in reported(estimate) if p.nominal is not None]
    good = [p for p in own if p.status == "identifiable"]
    inside = sum(p.interval[0] <= (p.nominal or 0.0) <= p.interval[1] for p in good)
    better = [n for n in paper if n in estimate and _error(estimate, n) <= paper[n]]
    counted = [n for n in paper if n in estimate]
    sentence = (
        f"From recordings of {s.title}, {len(good)} of {len(own)} parameters are identified to better than "
        f"10 %, {inside} of them with the truth inside the 95 % interval; {len(better)} of the "
        f"{len(counted)} parameters of the paper's Table 2 come out nearer to the truth than in the paper."
    )
    return sentence, "good" if good and inside >= 0.9 * len(good) else "warn"


def _error(estimate: Estimate, name: str) -> float:
    p = estimate[name]
    return p.relative_error(p.nominal) if p.nominal else float("nan")
