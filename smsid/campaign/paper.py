"""The paper's linear identification as a campaign's method."""

from __future__ import annotations

from smsid.campaign.case import Case
from smsid.campaign.outcome import Findings, Outcome
from smsid.campaign.truth import true_values
from smsid.identify.paper.hidden_states import Modal
from smsid.identify.paper.pipeline import identify


def run_paper(case: Case, *, modal: Modal = "smoother") -> Findings:
    """Fly the experiments, identify by `smsid.identify.paper.pipeline.identify`, compare with the truth.

    ``modal`` as there. Raises what flying and identifying raise.
    """
    found = identify(case.guess, case.fly(), modal=modal)
    truth = true_values(case, found)
    outcomes = tuple(
        Outcome.of(p, None if p.group == "exp2.step_b_printed" else truth.get(p.name))
        for p in found.estimate.parameters
    )
    return Findings(outcomes=outcomes, notes=found.estimate.notes)
