"""What candidates explain if they begin at any sample: all beginnings at once, by one pass backwards.

What an effect does from a time on is linear in its changes from then on. With the costate of a vector along
the filter, its product with a column that begins at any time is a sum from there on; the squares of such
columns follow from the information that later readings have of a state. A pass costs what it costs to take
the columns through the filter once, for one beginning.

Source: Willsky and Jones, IEEE Trans. Automatic Control 21 (1976) 108 (generalised likelihood ratio);
costates as in de Jong and Penzer, J. Am. Stat. Assoc. 93 (1998) 796.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from smsid.diagnose.score_test import EXCITED
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.map_estimate import MapFit
from smsid.estimation.sensitivities import Places, Sensitivity

ROOM = 1e7  # whitened values that are held at once: as fast as all of them, and they fit in memory


def onset_ratios(
    found: MapFit, groups: Sequence[Sequence[Sensitivity]], one_sided: Sequence[bool]
) -> list[np.ndarray]:
    """Return the likelihood ratios (2 N - 1,) of groups of changes that begin at samples and middles.

    The fitted parameters are free beside them; directions that are hardly excited are left out, and of those
    ``one_sided`` what a negative coefficient would explain.
    """
    run, (n, rows, _) = found.run, found.run.by_a.shape
    q, _ = found.factors
    own = np.concatenate([run.innovations[:, :, None], q[: n * rows].reshape(n, rows, -1)], axis=2)
    read, moved = costates(run, own)
    at = np.matmul(np.matmul(run.by_a, run.inverse).transpose(0, 2, 1), read)
    middle = np.matmul(run.middle_inverse, moved)
    within = q.T @ found.residual
    out: list[np.ndarray] = []
    first = 0
    while first < len(groups):
        widths = np.cumsum([len(g) for g in groups[first:]])
        last = first + max(1, int(np.searchsorted(widths, ROOM / (n * rows), side="right")))
        some = groups[first:last]
        changes = [c for g in some for c in g]
        direct, pushed = _inputs(run, changes)
        squares = _squares(run, direct, pushed, [len(g) for g in some])
        start = 0
        for group, square, sign in zip(some, squares, one_sided[first:last], strict=True):
            mine = slice(start, start + len(group))
            start = mine.stop
            parts = np.zeros((2 * n - 1, own.shape[2], len(group)))
            for i, c in enumerate(group):
                parts[::2, :, i] = _along(c.at, at, c.dofs) + _along(c.reading, read, c.rows)
                parts[1::2, :, i] = _along(c.middle, middle, c.dofs)
            along = np.cumsum(parts[::-1], axis=0)[::-1]
            out.append(_ratios(square, along, within, sign))
        first = last
    return out


def _along(values: np.ndarray | None, costate: np.ndarray, where: Places) -> np.ndarray | float:
    """Return products (N, k) of values (N, j) with their costates, some of (N, places, k)."""
    return 0.0 if values is None else np.einsum("nj,njk->nk", values, costate[:, where])


def costates(run: FilterRun, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how products with columns (N, rows, k) change with readings (N, rows, k) at the samples, and
    with accelerations (N - 1, nv, k) between them.
    """
    n, rows, k = columns.shape
    at, middle = np.empty((n, rows, k)), np.empty((n - 1, run.by_a.shape[2], k))
    state = np.zeros((run.gain.shape[1], k))
    for i in range(n - 1, -1, -1):
        white = run.whitening[i].T @ columns[i]
        if i < n - 1:
            middle[i] = run.forcing[i].T @ state
            state = run.transition[i].T @ state
            white -= run.gain[i].T @ state
        at[i] = white
        state = state + run.sensitivity[i].T @ white
    return at, middle


def _inputs(run: FilterRun, changes: Sequence[Sensitivity]) -> tuple[np.ndarray, np.ndarray]:
    """Return what changes do at once to readings (N, rows, k), and accelerations (N - 1, nv, k) between."""
    n, rows, nv = run.by_a.shape
    direct, pushed = np.zeros((n, rows, len(changes))), np.zeros((n - 1, nv, len(changes)))
    for i, change in enumerate(changes):
        if change.at is not None:
            direct[:, :, i] = _times(run.by_a, _times(run.inverse[:, :, change.dofs], change.at))
        if change.reading is not None:
            direct[:, change.rows, i] += change.reading
        if change.middle is not None:
            pushed[:, :, i] = _times(run.middle_inverse[:, :, change.dofs], change.middle)
    return direct, pushed


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return products (N, i) of matrices (N, i, j) with vectors (N, j)."""
    return np.matmul(matrices, vectors[:, :, None])[:, :, 0]


def _squares(
    run: FilterRun, direct: np.ndarray, pushed: np.ndarray, widths: Sequence[int]
) -> list[np.ndarray]:
    """Return products (2 N - 1, d, d) of the columns of each group with each other, by when they begin."""
    n, states = len(direct), run.gain.shape[1]
    ends = np.cumsum([0, *widths])
    own = [np.arange(first, last) for first, last in pairwise(ends)]
    one, two = np.hstack([[np.repeat(x, len(x)), np.tile(x, len(x))] for x in own])
    out, now = np.zeros((2 * n - 1, len(one))), np.zeros(len(one))
    known, state = np.zeros((states, states)), np.zeros((states, direct.shape[2]))

    def begin(change: np.ndarray, seen: np.ndarray) -> None:
        """Add changes of the state at one of them, whose later columns go with ``state``."""
        nonlocal now, state
        shown = known @ change
        more = np.einsum("ip,ip->p", change[:, one], (state + shown)[:, two])
        now = now + more + np.einsum("ip,ip->p", state[:, one], change[:, two])
        now += np.einsum("ip,ip->p", seen[:, one], seen[:, two])
        state = state + shown

    nothing = np.zeros((0, direct.shape[2]))
    for i in range(n - 1, -1, -1):
        whitening, white = run.whitening[i], run.whitening[i] @ run.sensitivity[i]
        seen = whitening @ direct[i]
        if i < n - 1:
            begin(run.forcing[i] @ pushed[i], nothing)
            out[2 * i + 1] = now
            lost = run.transition[i] @ run.gain[i]
            begin(-(lost @ direct[i]), seen)
            kept = run.transition[i] - lost @ run.sensitivity[i]
            state, known = kept.T @ state, kept.T @ known @ kept
        else:
            begin(np.zeros_like(state), seen)
        out[2 * i] = now
        state = state + white.T @ seen
        known = known + white.T @ white
    every = np.split(out, np.cumsum(np.square(widths))[:-1], axis=1)
    return [x.reshape(2 * n - 1, w, w) for x, w in zip(every, widths, strict=True)]


def _ratios(square: np.ndarray, along: np.ndarray, within: np.ndarray, one_sided: bool) -> np.ndarray:
    """Return likelihood ratios (E,) from products of columns with each other (E, d, d), and with residual and
    parameters (E, 1 + m, d); ``within`` (m,) are those of the residual with the parameters.
    """
    own = along[:, 1:]
    slope = along[:, 0] - np.einsum("emd,m->ed", own, within)
    gram = square - np.matmul(own.transpose(0, 2, 1), own)
    raw = np.einsum("edd->ed", square)
    size = np.sqrt(np.where(raw > 0.0, raw, 1.0))
    values, vectors = np.linalg.eigh(gram / (size[:, :, None] * size[:, None, :]))
    keep = values > EXCITED
    scaled = np.einsum("edk,ed->ek", vectors, slope / size)
    ratios = np.where(keep, scaled**2 / np.where(keep, values, 1.0), 0.0).sum(axis=1)
    return np.where(slope[:, 0] > 0.0, ratios, 0.0) if one_sided else ratios
