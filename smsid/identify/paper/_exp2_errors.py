"""What sensors' noise, and errors of Exp. 1 and of Step A, do to the results of Exp. 2."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.errors import NotIdentifiableError
from smsid.identify.paper._momentum_printed import step_b_printed
from smsid.identify.paper.hidden_states import HiddenStates, Modal, hidden_states
from smsid.identify.paper.momentum import StepA, step_a, step_b
from smsid.identify.paper.momentum_regression import Regression
from smsid.identify.paper.motion import MeasuredMotion
from smsid.identify.paper.noise_replicates import covariance_of_moves
from smsid.model.spacecraft import SpacecraftModel

THINNED = 4  # every which sample serves to see how far results move
REPLICATES = 8
REPLICATES_SEED = 1  # the same data give the same interval


@dataclass(frozen=True)
class Steps:
    """Step A, Step B, and Step B as printed where it applies."""

    a: StepA
    b: Regression
    printed: Regression | None

    @property
    def values(self) -> list[np.ndarray]:
        """Values of the CM's position (3,), Step A's moments (a,), Step B (b,) and, if it is there, Step B as
        printed (p,).
        """
        regressions = [self.a.moments, self.b, *([self.printed] if self.printed else [])]
        return [self.a.position, *(r.values for r in regressions)]

    @property
    def covariances(self) -> list[np.ndarray]:
        """Covariances of `values`, square; of the position (3, 3) only the variances are kept."""
        regressions = [self.a.moments, self.b, *([self.printed] if self.printed else [])]
        return [np.diag(self.a.position_sigma**2), *(r.solution.covariance for r in regressions)]

    def with_covariances(self, covariances: Sequence[np.ndarray], *, printed: bool) -> Steps:
        """Return the steps with other ``covariances``, (3, 3), (a, a), (b, b) and (p, p) as there.

        ``printed``: whether Step B as printed is kept.
        """

        def changed(of: Regression, covariance: np.ndarray) -> Regression:
            return replace(of, solution=replace(of.solution, covariance=covariance))

        a = replace(
            self.a,
            position_sigma=np.sqrt(np.diag(covariances[0])),
            moments=changed(self.a.moments, covariances[1]),
        )
        third = changed(self.printed, covariances[3]) if self.printed and printed else None
        return Steps(a, changed(self.b, covariances[2]), third)

    def same_printed(self, other: Steps) -> bool:
        """Return whether both have Step B as printed, of the same combinations."""
        if self.printed is None or other.printed is None:
            return False
        return not self.printed.base.unlike(other.printed.base)

    def refuse_others(self, other: Steps, when: str) -> None:
        """Raise `NotIdentifiableError` for combinations that one of them tells and the other does not."""
        pairs = ((self.a.moments.base, other.a.moments.base), (self.b.base, other.b.base))
        unlike = tuple(name for x, y in pairs for name in x.unlike(y))
        if unlike:
            raise NotIdentifiableError(
                f"The identifiable combinations change {when}: {'; '.join(unlike)}.",
                advice="Fly a richer Exp. 2: these are excited only marginally.",
                names=unlike,
                marginal=True,
            )


def slosh_mass(model: SpacecraftModel) -> float:
    """Return the mass of all slosh together [kg]."""
    return float(sum(model.pin.inertias[j.joint].mass for j in model.slosh))


def with_errors(
    found: Steps,
    model: SpacecraftModel,
    motion: MeasuredMotion,
    mass: float,
    modal: Modal,
    noisier: Callable[[np.random.Generator], MeasuredMotion],
    perturbed: Sequence[tuple[SpacecraftModel, float]],
) -> Steps:
    """Widen the covariances by what noise once more moves, and add what errors of Exp. 1 do.

    Residuals show errors that come and go within seconds; errors of the slosh state stay for its period and
    look like motion. ``noisier`` gives the motion with the sensors' own noise added; the mean square move
    over replicates and results of a step, in sigmas, is the factor on its covariance, never below 1. Such
    errors go along few directions, so one factor is not enough for those parameters that lie along them: a
    variance is at least what its parameter scatters by, the replicates' small number allowed for, and what
    they move it by on average is added squared, as a bias.

    ``perturbed``: model and M [kg] moved by one standard deviation of Exp. 1's results in one direction after
    the other. Step B as printed takes the CM from Step A, so the CM's own errors are added there too; and all
    columns for equally uncertain, so noise in its products biases it most. It is left out where the
    combinations it identifies change with the noise or within these errors.

    Raises `NotIdentifiableError` when the identifiable combinations of the other steps do.
    """
    coarse = motion.thinned(THINNED)
    like = hidden_states(model, coarse, modal)
    basis = _steps(model, coarse, mass, modal, like, printed=found.printed is not None)
    found.refuse_others(basis, "with the sampling rate")
    printed = found.same_printed(basis)
    replicates: list[Steps] = []
    rng = np.random.default_rng(REPLICATES_SEED)
    for _ in range(REPLICATES):
        # weighed by the noise that the motion itself shows, as the results were
        again = replace(noisier(rng).thinned(THINNED), again=coarse.again)
        other = _steps(model, again, mass, modal, like, printed=printed)
        basis.refuse_others(other, "with the sensors' noise")
        printed = printed and found.same_printed(other)
        replicates.append(other)
    count = 4 if printed else 3
    moves = [[r.values[i] - basis.values[i] for r in replicates] for i in range(count)]
    own = found.covariances[:count]
    first, second = _common_factor(own[:2], moves[:2]), _common_factor(own[2:3], moves[2:3])
    factors = (first, first, second, 1.0)
    covariances = [covariance_of_moves(f * c, m) for f, c, m in zip(factors, own, moves, strict=False)]
    sigma = np.sqrt(np.diag(covariances[0]))  # what Exp. 1 does to the CM moves the products as well
    for changed, total in perturbed:
        other = _steps(changed, coarse, total, modal, like, printed=printed)
        found.refuse_others(other, "within the uncertainty of Exp. 1")
        printed = printed and found.same_printed(other)
        for i in range(4 if printed else 3):
            covariances[i] = covariances[i] + _square(other.values[i] - basis.values[i])
    if printed and basis.printed:
        for k in range(3):
            centre = basis.a.position + sigma[k] * np.eye(3)[k]
            other = step_b_printed(model, coarse, like.without_slosh(), mass, slosh_mass(model), centre)
            covariances[3] = covariances[3] + _square(other.values - basis.printed.values)
    return found.with_covariances(covariances, printed=printed)


def _common_factor(own: Sequence[np.ndarray], moves: Sequence[Sequence[np.ndarray]]) -> float:
    """Return the mean square of ``moves`` in standard deviations of their covariance, at least one."""
    pairs = zip(own, moves, strict=True)
    z = [(np.array(m) / np.sqrt(np.diag(c))).ravel() for c, m in pairs if len(c)]
    return max(1.0, float(np.mean(np.square(np.concatenate(z)))))


def _steps(
    model: SpacecraftModel,
    motion: MeasuredMotion,
    mass: float,
    modal: Modal,
    like: HiddenStates,
    *,
    printed: bool,
) -> Steps:
    """All steps; ``like`` has the noise of hidden states already: only the motion or the model changes."""
    hidden = replace(hidden_states(model, replace(motion, again=None), modal), again=like.again)
    a = step_a(model, motion, hidden, mass)
    b = step_b(model, motion, hidden, mass, a.position)
    third = None
    if printed:
        without = hidden.without_slosh()
        third = step_b_printed(model, motion, without, mass, slosh_mass(model), a.position)
    return Steps(a, b, third)


def _square(x: np.ndarray) -> np.ndarray:
    return np.outer(x, x)
