"""The maximum of the likelihood by Gauss and Newton, damped after Levenberg and Marquardt.

Noise levels are part of the likelihood: at their best they are those of the residuals, so the sum of squares
is weighted anew after every step (a decrease at the old weights is one of the likelihood, as the logarithm is
concave). Far from the maximum the residuals are errors of the model: taken as noise they leave to the prior
what cannot be told yet, and the search does not run off along weak directions.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smsid.errors import NotIdentifiableError, SimulationError
from smsid.identify.estimate import Iteration
from smsid.likelihood.normal import Normal, normal_at
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import Evaluation, SearchPoint, step_point
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm

logger = logging.getLogger(__name__)

ITERATIONS = 100
NEAR = 1e-4  # a step counts as none when it would gain this much in the sum of squares: 0.01 sigma
LAST = 1e-3  # extrapolated from the last two steps: what the next would gain, so that it can be left out
LONGEST_STEP = 3.0  # a factor of 20 in a scalar, three times a body's size
CLOSE = 0.01  # share of the sum of squares still to gain below which the joints' motion is estimated too
NEARBY = 5.0  # sum of squares a sample, at the noise samples show, up to which a start is near the maximum
SAME_NOISE = 0.01  # relative change of the variance of a noise that needs no further step


class ConvergenceError(NotIdentifiableError):
    """A search did not come to rest: where it was, and what it had been by (nothing if it had not begun)."""

    pieces: tuple[RecordingTerm, ...] = ()
    seen: Evaluation | None = None
    visits: tuple[Iterate, ...] = ()

    def at(
        self, pieces: Sequence[RecordingTerm], seen: Evaluation, visits: Sequence[Iterate]
    ) -> ConvergenceError:
        """Return it with where the search was."""
        self.pieces, self.seen, self.visits = tuple(pieces), seen, tuple(visits)
        return self


@dataclass(frozen=True)
class Fit:
    """A maximum: what is seen there, the pieces with their final noise, the normal equations (or nearly).

    ``visits`` are the points the search came by, in order; the last is the maximum.
    """

    seen: Evaluation
    pieces: tuple[RecordingTerm, ...]
    normal: Normal
    cost: float
    samples: int
    iterations: int
    visits: tuple[Iterate, ...]

    @property
    def point(self) -> SearchPoint:
        """Where it is."""
        return self.seen.point


@dataclass(frozen=True)
class Minimum:
    """Where a search at given noise levels ended: point, normal equations, sum of squares, steps taken."""

    point: SearchPoint
    normal: Normal
    cost: float
    iterations: int


def fit(
    pieces: Sequence[RecordingTerm],
    start: SearchPoint,
    prior: Prior,
    patience: int = ITERATIONS,
    *,
    seen: Evaluation | None = None,
    known: Normal | None = None,
) -> Fit:
    """Return the maximum of the likelihood near ``start``, noise levels estimated with it.

    What may be there already: ``seen`` at the start, and ``known``, the normal equations there.

    Raises `ConvergenceError` when the search does not come to rest in ``patience`` iterations.
    """
    pieces, here = tuple(pieces), seen or Evaluation.at(pieces, start)
    damping, cost, gain, past = 0.0, np.inf, np.inf, np.inf
    found, there, spent = None, start.parameters, False
    visits: list[Iterate] = []
    walked: np.ndarray | None = None
    moved = np.zeros(0)
    samples = sum(c.values.shape[0] * c.width for p in pieces for c in p.channels)
    # then the noise that samples show between each other is the better guess of the levels
    nearby = here.cost(pieces, prior) < NEARBY * samples
    for iteration in range(patience):
        before = pieces
        if gain < CLOSE * cost or (iteration == 0 and nearby):
            pieces, here = here.following(pieces)
            pieces, here = here.cleaned(pieces)
        if iteration or not nearby:
            pieces = here.reweighed(pieces)
        change = _change(before, pieces) if iteration else np.inf
        settled = change < SAME_NOISE and all(p.follows for p in pieces if p.drive.joints is not None)
        cost = here.cost(pieces, prior)
        visits.append(Iterate.of(here, pieces, cost, walked))
        if not (settled and spent and found is not None):
            found = known if known and not iteration else normal_at(pieces, here, prior)
            there, moved = here.point.parameters, np.zeros(len(found.gradient))
            if not (np.isfinite(found.gradient).all() and np.isfinite(found.information).all()):
                raise _stuck(cost, np.inf, iteration).at(pieces, here, visits)
            gain = found.motion_gain + float(found.gradient @ found.solved())
        own = gain - found.motion_gain  # what is not the joints' motion alone
        said = "%d: cost %.8g, gain %.3g, %.2g of parameters, noise %.2g, damping %.1e"
        logger.info(said, iteration, cost, gain, own, change, damping)
        if settled and (spent or gain < NEAR):
            found = _by_steps_at(here.point.parameters, there, found.after(moved))
            return Fit(here, pieces, found, cost, samples, iteration, tuple(visits))
        try:
            step = _find_step(pieces, here, found, cost, prior, None, damping)
        except ConvergenceError as stuck:
            raise stuck.at(pieces, here, visits) from None
        if step is None:
            spent = True  # as good as rounding allows
            walked = np.zeros(here.point.parameters.size)
            continue
        off = abs(cost - step.cost - gain)
        # of the joints' motion alone is no matter: of what parameters gain, by its share in the last two
        # steps, or by the share of what was predicted, which is about that of the step, that did not come
        left = own * min(own / past, 1.0) if np.isfinite(past) else own * (off / gain) ** 2
        past = own
        logger.info("gained %.6g of %.6g, left %.2g", cost - step.cost, gain, left)
        spent = left < LAST and off < 0.2 * gain
        here, damping, moved = step.seen, step.damping, step.step
        walked = moved[: here.point.parameters.size]
    raise _stuck(cost, gain, patience).at(pieces, here, visits)


def _by_steps_at(now: Parameters, before: Parameters, found: Normal) -> Normal:
    """Return normal equations found a last step before by the units that steps have now.

    A step in a logarithm is worth another amount there, and what the data see of a sum is told from what they
    do not to many digits.
    """
    units = np.ones(len(found.gradient))
    pairs = zip(now.scalars, before.scalars, strict=True)
    units[now.inertias.size : now.size] = [a.slope / b.slope for a, b in pairs]
    return found.scaled(units)


def minimise(
    pieces: Sequence[RecordingTerm], start: SearchPoint, prior: Prior, fixed: np.ndarray | None
) -> Minimum:
    """Return the minimum of the sum of squares at given noise levels.

    ``fixed`` (k,) are components of the parameter step held where they are. Raises `NotIdentifiableError`
    when the search does not come to rest.
    """
    here, damping, cost, gain = Evaluation.at(pieces, start), 0.0, np.inf, np.inf
    for iteration in range(ITERATIONS):
        found = normal_at(pieces, here, prior)
        cost = here.cost(pieces, prior)
        free = _free(len(found.gradient), fixed)
        gradient = found.gradient[free]
        gain = float(gradient @ found.solved(free))
        gain += found.motion_gain
        if gain < NEAR:
            return Minimum(here.point, found, cost, iteration)
        step = _find_step(pieces, here, found, cost, prior, fixed, damping)
        if step is None:
            return Minimum(here.point, found, cost, iteration)
        here, damping = step.seen, step.damping
    raise _stuck(cost, gain, ITERATIONS)


@dataclass(frozen=True)
class _Step:
    seen: Evaluation
    step: np.ndarray
    cost: float
    damping: float


def _find_step(
    pieces: Sequence[RecordingTerm],
    here: Evaluation,
    found: Normal,
    cost: float,
    prior: Prior,
    fixed: np.ndarray | None,
    damping: float,
) -> _Step | None:
    """Return a step that lowers the cost, None when there is nothing left to gain but rounding."""
    free = _free(len(found.gradient), fixed)
    information, gradient = found.information[np.ix_(free, free)], found.gradient[free]
    step = np.zeros(len(free))
    gain = np.inf
    while damping < 1e10:
        step[free] = own = found.solved(free, damping)
        gain = found.motion_gain + float(2.0 * gradient @ own - own @ information @ own)
        trial, new = None, np.inf
        if np.abs(step[: here.point.parameters.size]).max() < LONGEST_STEP:
            try:
                there = step_point(pieces, here.point, step, found.motion_steps(step))
                trial = Evaluation.at(pieces, there)
                new = trial.cost(pieces, prior)
            except SimulationError:
                trial = None
        if trial is not None and new < cost:
            ratio = (cost - new) / gain
            if ratio > 0.75:
                damping = damping / 100.0 if damping > 1e-7 else 0.0
            elif ratio < 0.25:
                damping = max(4.0 * damping, 1e-6)
            return _Step(trial, step, new, damping)
        logger.debug("refused: damping %.1e, longest %.2g, cost %.8g", damping, np.abs(step).max(), new)
        # where knots lie as close as nodes, derivatives by the joints' motion are not exact: it may not gain
        if gain - found.motion_gain < 100 * NEAR and trial is not None:
            return None
        damping = max(10.0 * damping, 1e-6)
    raise _stuck(cost, gain, 0)


def _free(size: int, fixed: np.ndarray | None) -> np.ndarray:
    free = np.ones(size, dtype=bool)
    if fixed is not None:
        free[fixed] = False
    return free


def _change(before: Sequence[RecordingTerm], after: Sequence[RecordingTerm]) -> float:
    """Largest relative change of a noise level's variance."""
    return max(
        float(np.abs(np.diag(a.covariance) / np.diag(b.covariance) - 1.0).max())
        for new, old in zip(after, before, strict=True)
        for a, b in zip(new.channels, old.channels, strict=True)
    )


def _stuck(cost: float, gain: float, iteration: int) -> ConvergenceError:
    return ConvergenceError(
        f"The maximum-likelihood search did not come to rest in {iteration} iterations "
        f"(sum of squares {cost:.4g}, still to gain {gain:.2g}).",
        advice="Start it from the linear method's result, or check the description against the recording.",
        cost=cost,
        gain=gain,
    )


@dataclass(frozen=True)
class Iterate:
    """A point of a search, as much of it as its cost at other noise levels needs.

    ``squares`` are the mean products r r^T (k, k) of the residuals by piece and channel, ``known`` is what
    priors and encoders add, ``step`` (size,) led here in the common parameters; ``None`` where a search
    starts.
    """

    squares: tuple[tuple[np.ndarray, ...], ...]
    known: float
    step: np.ndarray | None

    @classmethod
    def of(
        cls, seen: Evaluation, pieces: Sequence[RecordingTerm], cost: float, step: np.ndarray | None
    ) -> Iterate:
        """Return the visit to a point whose sum of squares is ``cost`` with the pieces' noise.

        ``step`` (size,) of the common parameters led there.
        """
        squares = tuple(tuple(r.T @ r / len(r) for r in own) for own in seen.residuals)
        return cls(squares, cost - _whitened_squares(squares, pieces), step)

    def cost(self, pieces: Sequence[RecordingTerm]) -> float:
        """Return its sum of squares with the noise of these pieces.

        Samples that were left out later count as the mean of all.
        """
        return _whitened_squares(self.squares, pieces) + self.known


def history_of(
    visits: Sequence[Iterate], pieces: Sequence[RecordingTerm], samples: int, sigma: np.ndarray
) -> tuple[Iteration, ...]:
    """Return the history of the searches that ended with these pieces.

    ``sigma`` (size,) are the standard deviations of the common parameters, steps are told in them; costs are
    per sample. While a search runs the noise is estimated anew after every step, so that its own sum of
    squares is always near the number of samples: by the noise at the end costs can be compared.
    """
    out = []
    for visit in visits:
        longest = None if visit.step is None else float(np.abs(visit.step / sigma).max())
        out.append(Iteration(visit.cost(pieces) / samples, longest))
    return tuple(out)


def _whitened_squares(squares: Sequence[Sequence[np.ndarray]], pieces: Sequence[RecordingTerm]) -> float:
    total = 0.0
    for piece, own in zip(pieces, squares, strict=True):
        for c, mean in zip(piece.channels, own, strict=True):
            total += len(c.times) * float(np.sum((c.whitening @ mean) * c.whitening))
    return total
