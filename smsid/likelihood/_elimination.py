"""Normal equations without the joints' motion: its coefficients are eliminated in time order, exactly.

The sum of squares of a stretch of nodes is a quadratic form in the state x of the derivatives at its first
node, in what is common to all nodes, and in the coefficients that act there: what earlier ones did - pose,
slosh and panels remember it - is in x. So it is carried from the end to the beginning: coefficients that act
only in later stretches leave the form (their Schur complement), then x at the end of a stretch is put as what
its beginning makes of it. That is what a dense factorisation does with these columns from the last to the
first, at a cost linear in samples. Source: dynamic programming (Bryson and Ho 1975, *Applied Optimal
Control*, chapter 13).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from smsid.errors import NotIdentifiableError
from smsid.likelihood._readings import Agreement

JITTERS = (0.0, 1e-12, 1e-9, 1e-6)  # added to a unit diagonal until it is positive definite


@dataclass(frozen=True)
class Form:
    """z^T H z / 2 - g^T z of a stretch of nodes, z = (x at the first, common columns, coefficients).

    ``information`` H (z, z), ``gradient`` g (z,), ``end`` (n, z): x at the first node of the next stretch.
    ``rows`` of x; ``first`` and ``stop`` number the coefficients, those of one time joint by joint.
    """

    information: np.ndarray
    gradient: np.ndarray
    end: np.ndarray
    rows: int
    first: int
    stop: int

    def with_later(self, later: Form, common: int) -> Form:
        """Return the sum with the form of all later stretches, whose coefficients stop where these do.

        Their x, the first rows, is put as the end of this one; the other columns are among these.
        """
        x, size = self.end, len(self.gradient)
        n = len(x)
        motion = len(later.gradient) - n - common
        keep = np.r_[self.rows : self.rows + common, size - motion : size]
        information, gradient = self.information.copy(), self.gradient + x.T @ later.gradient[:n]
        information += x.T @ later.information[:n, :n] @ x
        cross = x.T @ later.information[:n, n:]
        information[:, keep] += cross
        information[keep] += cross.T
        information[np.ix_(keep, keep)] += later.information[n:, n:]
        gradient[keep] += later.gradient[n:]
        return replace(self, information=information, gradient=gradient)


@dataclass(frozen=True)
class _Followed:
    """Coefficients from ``start`` to ``stop``: ``constant`` less ``by`` (x, common, those from ``first``).

    ``carried`` gives x from (x before, common, coefficients from ``before`` to the start).
    """

    first: int
    start: int
    stop: int
    by: np.ndarray
    constant: np.ndarray
    before: int = 0
    carried: np.ndarray | None = None


@dataclass(frozen=True)
class EliminatedMotion:
    """How the joints' motion (m, joints) follows all else: (pose at the start, common columns).

    ``gain`` is what it alone lowers the sum of squares by.
    """

    shape: tuple[int, int]
    gain: float
    followed: tuple[_Followed, ...]

    def step(self, others: np.ndarray, *, newton: bool = True) -> np.ndarray:
        """Return the step (m, joints) that goes with one of the ``others`` (6 + common,).

        Without ``newton`` what it is whatever the others do is left out.
        """
        out, x, common = np.zeros(self.shape), others[:6], others[6:]
        for own in self.followed:
            if own.carried is not None:
                x = own.carried @ np.concatenate([x, common, out[own.before : own.start].ravel()])
            found = -own.by @ np.concatenate([x, common, out[own.first : own.start].ravel()])
            found = found + own.constant if newton else found
            out[own.start : own.stop] = found.reshape(-1, self.shape[1])
        return out


def eliminate(
    forms: Iterable[Form], common: int, readings: Agreement | None, *, clock: bool
) -> tuple[np.ndarray, np.ndarray, EliminatedMotion | None]:
    """Return information and gradient by (pose at the start, common columns), and how the motion follows.

    ``forms`` from the last stretch to the first, then an empty one whose x is the pose at the start, and
    whose end is x at the first node. ``readings``: what encoders say of the coefficients; of their ``clock``
    too, if that is sought: the last two of the common columns. Without readings there are no coefficients.

    Raises `NotIdentifiableError` when nothing tells a coefficient.
    """
    forms = iter(forms)
    whole, gain, followed = next(forms), 0.0, []
    for form in forms:
        if readings is not None:
            whole, own, more = _without(whole, form.stop, readings, clock=clock)
            followed.append(replace(own, before=form.first, carried=form.end))
            gain += more
        whole = form.with_later(whole, common)
    if readings is None:
        return whole.information, whole.gradient, None
    whole, own, more = _without(whole, 0, readings, clock=clock)
    if clock:
        whole.information[-2:, -2:] += readings.of_clock
        whole.gradient[-2:] += readings.clock_gradient
    motion = EliminatedMotion(readings.gradient.shape, gain + more, (own, *followed[::-1]))
    return whole.information, whole.gradient, motion


def _without(form: Form, start: int, readings: Agreement, *, clock: bool) -> tuple[Form, _Followed, float]:
    """Return a form without its coefficients from ``start`` on, how these follow, and their gain."""
    information, gradient = form.information.copy(), form.gradient.copy()
    joints, size = readings.gradient.shape[1], len(gradient)
    if start == form.stop:
        return form, _Followed(form.first, start, start, np.zeros((0, size)), np.zeros(0)), 0.0
    front, kept = size - joints * (form.stop - form.first), size - joints * (form.stop - start)
    own = np.arange(kept, size).reshape(-1, joints)
    for d in range(readings.bands.shape[1]):
        below = own[max(d - (start - form.first), 0) :]  # there is none before the first
        values = readings.bands[:, d, form.stop - d - len(below) : form.stop - d].T
        information[below, below - joints * d] += values
        if d:
            information[below - joints * d, below] += values
    gradient[kept:] += readings.gradient[start : form.stop].ravel()
    if clock:
        cross = readings.by_clock[start : form.stop].reshape(-1, 2)
        information[kept:, front - 2 : front] += cross
        information[front - 2 : front, kept:] += cross.T
    scale = 1.0 / np.sqrt(np.diag(information)[kept:])
    lower = _factor(information[kept:, kept:] * np.outer(scale, scale))
    right = np.column_stack([information[kept:, :kept], gradient[kept:]])
    half = solve_triangular(lower, scale[:, None] * right, lower=True)
    taken = half.T @ half
    solved = scale[:, None] * solve_triangular(lower, half, lower=True, trans=1)
    left = replace(
        form,
        information=information[:kept, :kept] - taken[:-1, :-1],
        gradient=gradient[:kept] - taken[:-1, -1],
        stop=start,
    )
    return left, _Followed(form.first, start, form.stop, solved[:, :-1], solved[:, -1]), float(taken[-1, -1])


def _factor(scaled: np.ndarray) -> np.ndarray:
    for jitter in JITTERS:
        try:
            return cholesky(scaled + jitter * np.eye(len(scaled)), lower=True)
        except np.linalg.LinAlgError:
            continue  # far off, rounding may leave an eigenvalue below zero
    raise NotIdentifiableError(
        "Neither encoders nor the other sensors tell how the joints moved.",
        advice="Use the part of the recording in which the joints' readings are there.",
    )
