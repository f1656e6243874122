"""Total least squares of the momentum's equations, block by block: memory does not grow with the motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid.identify._tls import TlsSolution
from smsid.identify.momentum_rows import CORRELATION_TIME
from smsid.identify.paper.hidden_states import HiddenStates
from smsid.identify.paper.motion import MeasuredMotion
from smsid.identify.paper.square_root_information import RowSums, ScoreSums
from smsid.model.identifiable import BaseParameters, base_parameters

BLOCK = 4096  # samples whose equations are held at a time

Equations = Callable[[MeasuredMotion, HiddenStates], tuple[np.ndarray, np.ndarray]]
"""Rows (N, kinds, n) and right-hand sides (N, kinds) of a motion's N samples."""


@short_repr
@dataclass(frozen=True)
class Regression:
    """Base parameters of a linear regression and their total-least-squares estimate.

    ``shares`` (b,): norm of each column times its value, relative to that of the right-hand side, both in the
    first three kinds of equation: those of the angular momentum in Step B.
    """

    base: BaseParameters
    solution: TlsSolution
    theta_names: tuple[str, ...]
    shares: np.ndarray

    @property
    def values(self) -> np.ndarray:
        """Estimated base parameters (b,)."""
        return self.solution.x

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations (b,)."""
        return self.solution.standard_deviation


NOTHING = BaseParameters((), (), np.zeros(0, dtype=int), np.zeros((0, 0)), (), 1.0)
"""The base parameters of a spacecraft without arms in Step A."""


def blocks_of(motion: MeasuredMotion, hidden: HiddenStates) -> list[tuple[MeasuredMotion, HiddenStates]]:
    """Return a motion and its hidden states in blocks of `BLOCK` samples; views, nothing is copied."""
    if len(motion) <= BLOCK:
        return [(motion, hidden)]
    cuts = [slice(k, k + BLOCK) for k in range(0, len(motion), BLOCK)]
    return [(motion.only(cut), hidden.only(cut)) for cut in cuts]


def regress(
    motion: MeasuredMotion,
    hidden: HiddenStates,
    equations: Equations,
    names: Sequence[str],
    units: Sequence[str],
    beside: Sequence[str] = (),
    *,
    reweight: bool = False,
) -> tuple[Regression, TlsSolution]:
    """Return the base parameters of equations by total least squares, and the solution with what is beside.

    The equations' first columns are those of the sought parameters ``names`` in ``units``, the last those of
    ``beside``, which are kept as they are. Columns are brought to the length of the right-hand side. Where
    ``motion.again`` has the sensors' noise once more, what that changes tells how large the errors of the
    columns are and how they go together; without it all columns, at equal length, count as equally uncertain.
    ``reweight``: each kind of equation by what it leaves. The covariance allows for equation errors that are
    correlated over `CORRELATION_TIME` (Newey and West 1987).

    Raises `NotIdentifiableError` as `smsid.identify._tls.solve_factor`.
    """
    blocks, made = blocks_of(motion, hidden), []
    sums: RowSums | None = None
    for part, states in blocks:
        rows, rhs = equations(part, states)
        again = equations(part.again, states.again or states) if part.again is not None else None
        sums = sums or RowSums(rows.shape[1])
        sums.add(rows, rhs, again)
        made = [(rows, rhs)] if len(blocks) == 1 else []
    assert sums is not None
    count, kinds = len(names), range(sums.kinds)
    base = base_parameters(sums.columns(kinds, range(count)), names, units) if count else NOTHING
    kept = [*base.independent.tolist(), *range(count, count + len(beside))]
    labels, weights = [*base.names, *beside], np.ones(sums.kinds)
    solution, root = sums.solved(kept, weights, labels)
    if reweight:
        size = sums.residual(kept, solution.x)
        weights = 1.0 / np.maximum(size, 1e-9 * size.max())
        solution, root = sums.solved(kept, weights, labels)
    scores = ScoreSums(max(1, round(CORRELATION_TIME / motion.step)))
    for rows, rhs in made or (equations(*block) for block in blocks):
        own = rows[:, :, kept]
        scores.add(own * weights[:, None], (rhs - own @ solution.x) * weights)
    solution = replace(solution, covariance=scores.covariance(root))
    lengths = np.linalg.norm(sums.columns(kinds[:3], [*base.independent.tolist(), -1]), axis=0)
    shares = lengths[:-1] * np.abs(solution.x[: len(base)]) / lengths[-1]
    sought = slice(0, len(base))
    own_solution = replace(solution, x=solution.x[sought], covariance=solution.covariance[sought, sought])
    return Regression(base, own_solution, tuple(names), shares), solution
