"""The normal equations of all recordings and the prior together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import cho_factor, cho_solve, lapack, solve_triangular

from smsid.errors import NotIdentifiableError
from smsid.likelihood._elimination import EliminatedMotion
from smsid.likelihood.jacobian import normal
from smsid.likelihood.point import Evaluation
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm

ROUNDING = 1e-13  # of information summed over a recording, relative to the largest at unit diagonal
SINGULAR = 1e-14  # of a root at unit diagonal


@dataclass(frozen=True)
class Normal:
    """Information (n, n) of data and prior by (parameters, local ones by piece), and gradient (n,).

    The joints' motion is eliminated: ``motions`` by piece follow a step of all else, each that of its own
    components of the step in units of so many present ones. ``common`` are, by piece, its number of local
    parameters, and what it adds to information (m, m) and gradient (m,) of the m common ones.
    ``pull`` (n,) is the prior's part of the gradient.
    """

    data: np.ndarray
    prior: np.ndarray
    gradient: np.ndarray
    motions: tuple[tuple[np.ndarray, np.ndarray, EliminatedMotion] | None, ...] = ()
    common: tuple[tuple[int, np.ndarray, np.ndarray], ...] = ()
    pull: np.ndarray | float = 0.0

    @property
    def information(self) -> np.ndarray:
        """Of data and prior together, (n, n)."""
        return self.data + self.prior

    def scaled(self, units: np.ndarray) -> Normal:
        """Return them by parameters whose units are so many of the present ones (n,)."""
        both = np.outer(units, units)
        motions = tuple(x and (x[0], x[1] * units[x[0]], x[2]) for x in self.motions)
        m = len(self.gradient) - sum(n for n, _, _ in self.common)
        common = tuple((n, data * both[:m, :m], slope * units[:m]) for n, data, slope in self.common)
        pull = self.pull * units
        return Normal(self.data * both, self.prior * both, self.gradient * units, motions, common, pull)

    def after(self, step: np.ndarray) -> Normal:
        """Return them after a step (n,) with the motion that follows it, as far as they are quadratic."""
        m, common = len(self.gradient) - sum(n for n, _, _ in self.common), []
        for (n, data, slope), own in zip(self.common, self._places, strict=True):
            common.append((n, data, slope - data @ step[:m] - self.data[:m, own] @ step[own]))
        slopes = {"gradient": self.gradient - self.information @ step, "pull": self.pull - self.prior @ step}
        return replace(self, **slopes, common=tuple(common))

    @property
    def _places(self) -> list[slice]:
        """Where the local parameters of the pieces are."""
        ends = np.cumsum(
            [len(self.gradient) - sum(n for n, _, _ in self.common), *(n for n, _, _ in self.common)]
        )
        return [slice(*pair) for pair in pairwise(ends.tolist())]

    def of_pieces(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return by piece information (m, m) and gradient (m,) of its data, as `of_common`."""
        out = []
        for (_, data, slope), own in zip(self.common, self._places, strict=True):
            m = len(slope)
            cross, rest = self.data[:m, own], self.information[own, own]
            mine = np.block([[data, cross], [cross.T, rest]])
            gradient = np.concatenate([slope, self.gradient[own]])
            out.append(Normal(mine, np.zeros_like(mine), gradient).of_common(m))
        return out

    def of_common(self, size: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the data's information (size, size) and gradient once all local parameters are estimated.

        The gradient is that of data and prior, as it is.
        """
        data, gradient = self.data[:size, :size], self.gradient[:size]
        rest = self.information[size:, size:]
        if not len(rest):
            return data, gradient
        scale = 1.0 / np.sqrt(np.diag(rest))
        right = np.column_stack([self.data[size:, :size], self.gradient[size:]])
        solved = cho_solve(cho_factor(rest * np.outer(scale, scale)), scale[:, None] * right)
        taken = self.data[:size, size:] @ (scale[:, None] * solved)
        return data - taken[:, :-1], gradient - taken[:, -1]

    @property
    def motion_gain(self) -> float:
        """What the joints' motion alone lowers the sum of squares by."""
        return sum(x[2].gain for x in self.motions if x)

    def motion_steps(self, step: np.ndarray, *, newton: bool = True) -> list[np.ndarray | None]:
        """Return by piece the step of the joints' motion (m, joints) that goes with one of all else (n,).

        Without ``newton`` only what that step makes of it: along the likelihood's ridge.
        """
        return [x and x[2].step(x[1] * step[x[0]], newton=newton) for x in self.motions]

    @cached_property
    def _roots(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Roots (n, n) of data and prior, by the scale (n,) of their sum's unit diagonal; gradient by it.

        What the data tell less than rounding of what they tell best is nothing, nor is their gradient there:
        beside a long recording's information a prior is less than rounding, too, so the two are never summed
        but as roots.
        """
        scale = 1.0 / np.sqrt(np.diag(self.information))
        size, basis = np.linalg.eigh(self.data * np.outer(scale, scale))
        told = size > ROUNDING * size[-1]
        slope = (
            basis[:, told] @ (basis[:, told].T @ (scale * (self.gradient - self.pull))) + scale * self.pull
        )
        data = np.sqrt(np.where(told, size, 0.0))[:, None] * basis.T
        return data, np.diag(np.sqrt(np.diag(self.prior)) * scale), scale, slope

    @cached_property
    def _factor(self) -> tuple[np.ndarray, np.ndarray]:
        data, known, scale, _ = self._roots
        return _triangular(np.vstack([data, known])), scale

    def solved(self, free: np.ndarray | slice = slice(None), damping: float = 0.0) -> np.ndarray:
        """Return the step (k,) of ``free`` components, ``damping`` added to the unit diagonal."""
        data, known, scale, slope = self._roots
        rows = np.vstack([data, known, np.sqrt(damping) * np.eye(len(scale))])[:, free]
        return scale[free] * cho_solve((_triangular(rows), True), slope[free])

    def common_root(self, size: int) -> np.ndarray:
        """Return a root (size, size) of what the data tell of common parameters, as `of_common`."""
        data, known, scale, _ = self._roots
        own = np.vstack([np.roll(data, -size, axis=1), np.roll(known, -size, axis=1)[size:]])
        upper = np.asarray(np.linalg.qr(own, mode="r"))
        return upper[len(scale) - size :, len(scale) - size :] / scale[:size]

    @cached_property
    def _covariance(self) -> np.ndarray:
        return _inverse(*self._factor)

    def covariance(self) -> np.ndarray:
        """Return the covariance (n, n) of the posterior, Gaussian."""
        return self._covariance

    def covariance_of(self, rows: np.ndarray) -> np.ndarray:
        """Return the covariance (k, k) of linear combinations, ``rows`` (k, m) by the first m unknowns.

        From the factor of the information, not from the covariance: of what is known far better than each of
        its terms, rounding there may be more than all of it.
        """
        lower, scale = self._factor
        whole = np.zeros((len(scale), len(rows)))
        whole[: rows.shape[1]] = (rows * scale[: rows.shape[1]]).T
        part = solve_triangular(lower, whole, lower=True)
        return part.T @ part


@np.errstate(over="ignore", invalid="ignore")  # where a search is lost is told by its values
def normal_at(
    pieces: Sequence[RecordingTerm], seen: Evaluation, prior: Prior, *, with_data: bool = True
) -> Normal:
    """Return the normal equations at a point; the gradient is left out ``with_data=False``."""
    point = seen.point
    size = point.parameters.size
    n = size + sum(p.size for p in pieces)
    (data, known), (gradient, pull) = np.zeros((2, n, n)), np.zeros((2, n))
    residual, jacobian = prior.residual(point.parameters)
    known[:size, :size] = jacobian.T @ jacobian
    first, motions, common = size, [], []
    if with_data:
        pull[:size] -= jacobian.T @ residual
    parts = zip(pieces, point.locals, seen.predictions, seen.residuals, strict=True)
    for piece, local, prediction, residuals in parts:
        found = normal(piece, point.parameters, local, prediction, residuals if with_data else None)
        place = np.concatenate([np.arange(size), np.arange(first, first + piece.size)])
        data[np.ix_(place, place)] += found.information
        gradient[place] += found.gradient
        common.append((piece.size, found.information[:size, :size], found.gradient[:size]))
        mine = slice(first, first + piece.size)
        own, slope, _ = piece.prior(local)
        known[mine, mine] += own
        if with_data:
            pull[mine] += slope
        order = place[found.order]
        motions.append(found.motion and (order, np.ones(len(order)), found.motion))
        first += piece.size
    return Normal(data, known, gradient + pull, tuple(motions), tuple(common), pull)


def inverse(information: np.ndarray) -> np.ndarray:
    """Return the inverse (n, n) of a positive definite matrix, scaled to unit diagonal first.

    Raises `NotIdentifiableError` naming the component when it is singular.
    """
    return _inverse(*_factor_information(information))


def _triangular(root: np.ndarray) -> np.ndarray:
    """Return L (n, n), lower, with L L^T = root^T root."""
    upper = np.linalg.qr(root, mode="r")
    if np.abs(np.diag(upper)).min(initial=1.0) < SINGULAR:
        raise _undetermined_error()
    return (upper * np.sign(np.diag(upper))[:, None]).T


def _undetermined_error() -> NotIdentifiableError:
    return NotIdentifiableError(
        "Neither data nor prior determine all parameters.",
        advice="Give the effect concerned a `prior`, or leave it out.",
    )


def _factor_information(information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return L (n, n), lower, of a matrix that ``scale`` (n,), returned too, brings to unit diagonal."""
    scale = 1.0 / np.sqrt(np.diag(information))
    factor, fault = lapack.dpotrf(information * np.outer(scale, scale), lower=1, overwrite_a=1)
    if fault:
        raise _undetermined_error()
    return factor, scale


def _inverse(factor: np.ndarray, scale: np.ndarray) -> np.ndarray:
    lower = np.tril(lapack.dpotri(factor, lower=1)[0]) * np.outer(scale, scale)
    return lower + np.tril(lower, -1).T
