"""Maximum likelihood as a campaign's method."""

from __future__ import annotations

import numpy as np

from smsid.campaign.case import Case
from smsid.campaign.outcome import Findings, Outcome
from smsid.effects.inertial_parameters import pseudo_inertia
from smsid.identify.paper.hidden_states import Modal
from smsid.identify.paper.pipeline import identify
from smsid.likelihood import Refinement, refine
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.refine import reported_parameters
from smsid.model import build_model

GROUP = "physical consistency"


def run_ml(case: Case, *, modal: Modal = "smoother") -> Findings:
    """Fly the experiments, identify by the paper's method, refine, compare with the truth.

    Beside the parameters, every body's ``<body>.consistency``: the smallest eigenvalue of its pseudo-inertia
    relative to the largest, positive exactly when the body can exist. ``modal``: of the linear method that
    the refinement starts from. Raises what flying, identifying and refining raise.
    """
    recordings = case.fly()
    found = refine(case.guess, recordings, identify(case.guess, recordings, modal=modal))
    truth = true_values(case, found)
    outcomes = [Outcome.of(p, truth.get(p.name)) for p in found.estimate.parameters if p.group != "nuisance"]
    for body, theta in found.inertias.items():
        size = np.linalg.eigvalsh(pseudo_inertia(theta))
        name = f"{body}.consistency"
        outcomes.append(Outcome(name=name, value=float(size[0] / size[-1]), unit="1", group=GROUP))
    return Findings(outcomes=tuple(outcomes), notes=found.estimate.notes)


def true_values(case: Case, found: Refinement) -> dict[str, float]:
    """Return the true values of what a refinement reports, by the same names.

    An appendage without a density is reported relative to the starting guess; it has no truth unless the
    guess is right.
    """
    truth = Parameters.of(build_model(case.truth))
    predictions = [
        x for p, x in zip(found.fit.pieces, found.fit.seen.predictions, strict=True) if not p.drive.held
    ]
    combinations, _ = reported_parameters(truth, truth, predictions)
    out = {c.name: c.value for c in combinations if not c.name.endswith(".participation_factor")}
    for effect in case.truth.effect:
        if effect == case.guess.get_effect(effect.name):
            out[f"{effect.name}.participation_factor"] = 1.0
    return out
