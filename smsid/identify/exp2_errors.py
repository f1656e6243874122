"""What errors of Exp. 1 and of Step A do to the results of Exp. 2."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.errors import NotIdentifiableError
from smsid.identify.hidden_states import HiddenStates, Modal, hidden_states
from smsid.identify.momentum import StepA, step_a, step_b
from smsid.identify.momentum_printed import step_b_printed
from smsid.identify.momentum_regression import Regression
from smsid.identify.motion import Motion
from smsid.identify.noise_replicates import covariance_of_moves
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


def slosh_mass(model: SpacecraftModel) -> float:
    """Return the mass of all slosh together [kg]."""
    return float(sum(model.pin.inertias[j.joint].mass for j in model.slosh))


def inflate_covariance(
    found: Steps,
    model: SpacecraftModel,
    motion: Motion,
    mass: float,
    modal: Modal,
    noisier: Callable[[np.random.Generator], Motion],
) -> Steps:
    """Widen the covariances until noise once more moves results by what they say.

    Residuals show errors that come and go within seconds; errors of the slosh state stay for its period and
    look like motion. ``noisier`` gives the motion with the sensors' own noise added; the mean square move
    over replicates and results of a step, in sigmas, is the factor on its covariance, never below 1. Such
    errors go along few directions, so one factor is not enough for those parameters that lie along them: a
    variance is at least what its parameter scatters by, the replicates' small number allowed for, and what
    they move it by on average is added squared, as a bias.

    Step B as printed takes all columns for equally uncertain, so noise in its products biases it most. It is
    left out where the combinations it identifies change with the noise.

    Raises `NotIdentifiableError` when the identifiable combinations change with the noise.
    """
    coarse = motion.thinned(THINNED)
    like = hidden_states(model, coarse, modal)
    with_printed = found.printed is not None
    basis = _steps(model, coarse, mass, modal, printed=with_printed, like=like)
    position_moves: list[np.ndarray] = []
    moment_moves: list[np.ndarray] = []
    moves: list[np.ndarray] = []
    printed_moves: list[np.ndarray] | None = [] if _same_printed(found, basis) else None
    rng = np.random.default_rng(REPLICATES_SEED)
    for _ in range(REPLICATES):
        # weighed by the noise that the motion itself shows, as the results were
        again = replace(noisier(rng).thinned(THINNED), again=coarse.again)
        other = _steps(model, again, mass, modal, printed=printed_moves is not None, like=like)
        if printed_moves is not None and other.printed and basis.printed and _same_printed(found, other):
            printed_moves.append(other.printed.values - basis.printed.values)
        else:
            printed_moves = None
        if unlike := _unlike(other, basis):
            raise NotIdentifiableError(
                f"The identifiable combinations change with the sensors' noise: {'; '.join(unlike)}.",
                advice="Fly a richer Exp. 2: these are excited only marginally.",
                names=unlike,
                marginal=True,
            )
        position_moves.append(other.a.position - basis.a.position)
        moment_moves.append(other.a.moments.values - basis.a.moments.values)
        moves.append(other.b.values - basis.b.values)
    own = [np.diag(found.a.position_sigma**2), found.a.moments.solution.covariance]
    first = _common_factor(zip(own, (position_moves, moment_moves), strict=True))
    second = _common_factor([(found.b.solution.covariance, moves)])
    position = covariance_of_moves(first * own[0], position_moves)
    a = replace(
        found.a,
        position_sigma=np.sqrt(np.diag(position)),
        moments=_with_covariance(found.a.moments, covariance_of_moves(first * own[1], moment_moves)),
    )
    b = _with_covariance(found.b, covariance_of_moves(second * found.b.solution.covariance, moves))
    printed = None
    if found.printed and printed_moves:
        own_printed = found.printed.solution.covariance
        printed = _with_covariance(found.printed, covariance_of_moves(own_printed, printed_moves))
    return Steps(a, b, printed)


def _common_factor(pairs: Iterable[tuple[np.ndarray, Sequence[np.ndarray]]]) -> float:
    """Return the mean square of ``moves`` in standard deviations of their covariance, at least one."""
    z = [(np.array(moves) / np.sqrt(np.diag(own))).ravel() for own, moves in pairs if len(own)]
    return max(1.0, float(np.mean(np.square(np.concatenate(z)))))


def _same_printed(found: Steps, other: Steps) -> bool:
    """Return whether both have Step B as printed, of the same combinations."""
    if found.printed is None or other.printed is None:
        return False
    return not found.printed.base.unlike(other.printed.base)


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
    from Step A, so the CM's own errors are added there too; it is left out where the combinations it
    identifies change within these errors. Raises `NotIdentifiableError` when those of the other steps do.
    """
    coarse = motion.thinned(THINNED)
    like = hidden_states(model, coarse, modal)
    basis = _steps(model, coarse, mass, modal, printed=found.printed is not None, like=like)
    position = np.diag(found.a.position_sigma**2)
    moments, inertia = found.a.moments.solution.covariance.copy(), found.b.solution.covariance.copy()
    as_printed = found.printed.solution.covariance.copy() if found.printed else np.zeros((0, 0))
    kept = True

    def check(other: Steps) -> Steps:
        nonlocal kept
        if other.printed and found.printed:
            kept = kept and not other.printed.base.unlike(found.printed.base)
        else:
            kept = kept and other.printed is found.printed
        if unlike := _unlike(other, found):
            raise NotIdentifiableError(
                "The identifiable combinations change within the uncertainty of Exp. 1: "
                f"{'; '.join(unlike)}.",
                advice="Fly a richer Exp. 2: these are excited only marginally.",
                names=unlike,
                marginal=True,
            )
        return other

    check(basis)
    for other, total in perturbed:
        moved = check(_steps(other, coarse, total, modal, printed=found.printed is not None, like=like))
        position += _square(moved.a.position - basis.a.position)
        moments += _square(moved.a.moments.values - basis.a.moments.values)
        inertia += _square(moved.b.values - basis.b.values)
        if kept and moved.printed and basis.printed:
            as_printed += _square(moved.printed.values - basis.printed.values)
    if kept and found.printed and basis.printed:
        modes = like.without_slosh()
        for k in range(3):
            centre = basis.a.position + found.a.position_sigma[k] * np.eye(3)[k]
            moved = step_b_printed(model, coarse, modes, mass, slosh_mass(model), centre)
            as_printed += _square(moved.values - basis.printed.values)
    a = replace(
        found.a,
        position_sigma=np.sqrt(np.diag(position)),
        moments=_with_covariance(found.a.moments, moments),
    )
    printed = _with_covariance(found.printed, as_printed) if kept and found.printed else None
    return Steps(a, _with_covariance(found.b, inertia), printed)


def _steps(
    model: SpacecraftModel,
    motion: Motion,
    mass: float,
    modal: Modal,
    *,
    printed: bool,
    like: HiddenStates | None = None,
) -> Steps:
    """All steps; ``like`` has the noise of hidden states already, when only the motion or model changes."""
    hidden = hidden_states(model, motion if like is None else replace(motion, again=None), modal)
    if like is not None:
        hidden = replace(hidden, again=like.again)
    a = step_a(model, motion, hidden, mass)
    b = step_b(model, motion, hidden, mass, a.position)
    third = None
    if printed:
        without = hidden.without_slosh()
        third = step_b_printed(model, motion, without, mass, slosh_mass(model), a.position)
    return Steps(a, b, third)


def _unlike(one: Steps, other: Steps) -> tuple[str, ...]:
    """Names of combinations that one of them tells and the other does not."""
    pairs = ((one.a.moments.base, other.a.moments.base), (one.b.base, other.b.base))
    return tuple(name for x, y in pairs for name in x.unlike(y))


def _with_covariance(regression: Regression, covariance: np.ndarray) -> Regression:
    return replace(regression, solution=replace(regression.solution, covariance=covariance))


def _square(x: np.ndarray) -> np.ndarray:
    return np.outer(x, x)
