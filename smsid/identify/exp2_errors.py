"""What errors of Exp. 1 and of Step A do to the results of Exp. 2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.errors import NotIdentifiableError
from smsid.identify.hidden_states import Modal, hidden_states
from smsid.identify.momentum import HiddenStates, Regression, StepA, step_a, step_b
from smsid.identify.momentum_printed import step_b_printed
from smsid.identify.motion import Motion
from smsid.model.spacecraft import SpacecraftModel

THINNED = 4  # every which sample serves to see how far results move


@dataclass(frozen=True)
class Steps:
    """Step A, Step B, and Step B as printed where it applies."""

    a: StepA
    b: Regression
    printed: Regression | None

    @property
    def names(self) -> tuple[tuple[str, ...], ...]:
        """Names of what each step identifies."""
        printed = self.printed.base.names if self.printed else ()
        return self.a.moments.base.names, self.b.base.names, printed


def slosh_mass(model: SpacecraftModel) -> float:
    """Return the mass of all slosh together [kg]."""
    return float(sum(model.pin.inertias[j.joint].mass for j in model.slosh))


def with_carried_errors(
    found: Steps,
    model: SpacecraftModel,
    motion: Motion,
    mass: float,
    modal: Modal,
    perturbed: Sequence[tuple[SpacecraftModel, float]],
) -> Steps:
    """Add to the covariances what errors of Exp. 1's results do, one direction at a time.

    ``perturbed``: model and M [kg] moved by one standard deviation along each. Step B as printed takes the CM
    from Step A, so the CM's own errors are added there too. Raises `NotIdentifiableError` when the
    identifiable combinations change within these errors.
    """
    coarse = motion.thinned(THINNED)
    basis = _steps(model, coarse, mass, modal, printed=found.printed is not None)
    position = np.diag(found.a.position_sigma**2)
    moments, inertia = found.a.moments.solution.covariance.copy(), found.b.solution.covariance.copy()
    as_printed = found.printed.solution.covariance.copy() if found.printed else np.zeros((0, 0))

    def check(other: Steps) -> Steps:
        if other.names != found.names:
            raise NotIdentifiableError(
                "The identifiable combinations change within the uncertainty of Exp. 1.",
                advice="Fly a richer Exp. 2: some combination is excited only marginally.",
                names=found.names,
            )
        return other

    check(basis)
    for other, total in perturbed:
        moved = check(_steps(other, coarse, total, modal, printed=found.printed is not None))
        position += _square(moved.a.position - basis.a.position)
        moments += _square(moved.a.moments.values - basis.a.moments.values)
        inertia += _square(moved.b.values - basis.b.values)
        if moved.printed and basis.printed:
            as_printed += _square(moved.printed.values - basis.printed.values)
    if found.printed and basis.printed:
        modes = HiddenStates({}, hidden_states(model, coarse, modal).modes)
        for k in range(3):
            centre = basis.a.position + found.a.position_sigma[k] * np.eye(3)[k]
            moved = step_b_printed(model, coarse, modes, mass, slosh_mass(model), centre)
            as_printed += _square(moved.values - basis.printed.values)
    a = replace(
        found.a,
        position_sigma=np.sqrt(np.diag(position)),
        moments=_with_covariance(found.a.moments, moments),
    )
    printed = _with_covariance(found.printed, as_printed) if found.printed else None
    return Steps(a, _with_covariance(found.b, inertia), printed)


def _steps(model: SpacecraftModel, motion: Motion, mass: float, modal: Modal, *, printed: bool) -> Steps:
    hidden = hidden_states(model, motion, modal)
    a = step_a(model, motion, hidden, mass)
    b = step_b(model, motion, hidden, mass, a.position)
    without = HiddenStates({}, hidden.modes)
    third = step_b_printed(model, motion, without, mass, slosh_mass(model), a.position) if printed else None
    return Steps(a, b, third)


def _with_covariance(regression: Regression, covariance: np.ndarray) -> Regression:
    return replace(regression, solution=replace(regression.solution, covariance=covariance))


def _square(x: np.ndarray) -> np.ndarray:
    return np.outer(x, x)
