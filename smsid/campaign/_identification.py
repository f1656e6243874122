"""The identification methods of a campaign: the paper's linear one, and maximum likelihood from there."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from smsid.campaign._case import Case
from smsid.campaign.outcome import Findings, Outcome
from smsid.effects.appendage import Appendage
from smsid.effects.inertial_parameters import pseudo_inertia
from smsid.identify.momentum_rows import carried_by_bus
from smsid.identify.paper.hidden_states import Modal
from smsid.identify.paper.momentum_regression import Regression
from smsid.identify.paper.pipeline import Identification, identify
from smsid.likelihood import Refinement, refine
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.refine import reported_parameters
from smsid.model import SpacecraftModel, build_model
from smsid.model.regressor import Regressor

GROUP = "physical consistency"


def run_ml(case: Case, *, modal: Modal = "smoother") -> Findings:
    """Fly the experiments, identify by the paper's method, refine, compare with the truth.

    Beside the parameters, every body's ``<body>.consistency``: the smallest eigenvalue of its pseudo-inertia
    relative to the largest, positive exactly when the body can exist. ``modal``: of the linear method that
    the refinement starts from. Raises what flying, identifying and refining raise.
    """
    recordings = case.fly()
    found = refine(case.guess, recordings, identify(case.guess, recordings, modal=modal))
    truth = true_refined(case, found)
    outcomes = [Outcome.of(p, truth.get(p.name)) for p in found.estimate.parameters if p.group != "nuisance"]
    for body, theta in found.inertias.items():
        size = np.linalg.eigvalsh(pseudo_inertia(theta))
        name = f"{body}.consistency"
        outcomes.append(Outcome(name=name, value=float(size[0] / size[-1]), unit="1", group=GROUP))
    return Findings(outcomes=tuple(outcomes), notes=found.estimate.notes)


def true_refined(case: Case, found: Refinement) -> dict[str, float]:
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


def run_paper(case: Case, *, modal: Modal = "smoother") -> Findings:
    """Fly the experiments, identify by `smsid.identify.paper.pipeline.identify`, compare with the truth.

    ``modal`` as there. Raises what flying and identifying raise.
    """
    found = identify(case.guess, case.fly(), modal=modal)
    truth = true_linear(case, found)
    outcomes = tuple(
        Outcome.of(p, None if p.group == "exp2.step_b_printed" else truth.get(p.name))
        for p in found.estimate.parameters
    )
    return Findings(outcomes=outcomes, notes=found.estimate.notes)


def true_linear(case: Case, found: Identification) -> dict[str, float]:
    """Return the true values by parameter name, in the units of the estimate.

    Parameters without a truth of their own are left out: coupled frequencies, and Step B as printed, whose
    parameters are products.
    """
    truth = build_model(case.truth)
    out = {"total.mass": truth.mass}
    for effect in case.truth.effect:
        out.update({p.name: p.value for p in effect.parameters()})
        panel = effect.as_appendage()
        if panel is not None:
            out.update(_appendage(panel, case))
    if found.momentum is not None:
        floating = [e for e in case.experiments if e.force is None]
        if floating:
            q = floating[0].start(truth)
            centre = pin.centerOfMass(truth.pin, truth.data, q) - q[:3]
            out.update({f"system_cm.{axis}": float(centre[k]) for k, axis in enumerate("xyz")})
        step_a = _base(truth, found.momentum.a.moments, carried=False)
        out.update({f"step A: {name}": value for name, value in step_a.items()})
        out.update(_base(truth, found.momentum.b, carried=True))
    return out


def _appendage(effect: Appendage, case: Case) -> dict[str, float]:
    out: dict[str, float] = {}
    heavy = effect.mass_parameter()
    if heavy.unit != "1" or effect == case.guess.get_effect(effect.name):  # a factor is relative to the guess
        out[heavy.name] = heavy.value
    for k, mode in enumerate(effect.described_modes(case.truth.effect), start=1):
        out[f"{effect.name}.mode{k}.frequency"] = mode.frequency
        out[f"{effect.name}.mode{k}.damping"] = mode.damping
    return out


def _base(truth: SpacecraftModel, found: Regression, *, carried: bool) -> dict[str, float]:
    regressor = Regressor(truth)
    theta = regressor.parameters + (carried_by_bus(truth, regressor) if carried else 0.0)
    if not len(found.base):
        return {}
    chosen = np.array([regressor.names.index(n) for n in found.theta_names])
    values = found.base.values(theta[chosen])
    return dict(zip(found.base.names, map(float, values), strict=True))
