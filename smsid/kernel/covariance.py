"""What a Kalman filter does to covariances: square roots, corrections, transitions."""

from __future__ import annotations

from math import log, sqrt

import numpy as np

from smsid.kernel._spatial import cross, three
from smsid.kernel.jit import compile_inner

LONGEST, MOST = 0.5, 12  # of the fastest motion's time constant that a step may be; halvings of it


@compile_inner
def multiply(a, b, out):
    """Write the product of two matrices; all three are contiguous by rows."""
    np.dot(a, b, out)


@compile_inner
def inverse_of_root(s, low, inverse):
    """Write L and its inverse, with L L' = s (n, n), lower triangles; return whether there is one."""
    for j in range(len(s)):
        total = s[j, j]
        for k in range(j):
            total -= low[j, k] ** 2
        if not total > 0.0:
            return False
        low[j, j] = sqrt(total)
        scale = 1.0 / low[j, j]
        for i in range(j + 1, len(s)):
            total = s[i, j]
            for k in range(j):
                total -= low[i, k] * low[j, k]
            low[i, j] = total * scale
    for i in range(len(s)):
        inverse[i, :] = 0.0
        scale = 1.0 / low[i, i]
        for k in range(i):
            factor = low[i, k] * scale
            for j in range(k + 1):
                inverse[i, j] -= factor * inverse[k, j]
        inverse[i, i] = scale
    return True


@compile_inner
def transposed_into(a, out):
    """Write the transpose of a matrix."""
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            out[j, i] = a[i, j]


@compile_inner
def symmetrise(p):
    """Make a matrix its own symmetric part."""
    for i in range(len(p)):
        for j in range(i):
            p[i, j] = 0.5 * (p[i, j] + p[j, i])
            p[j, i] = p[i, j]


@compile_inner
def correct(p, rows, variance, off, errors, sensitivity, innovations, normalised, whitening, gain, step):
    """Take in the readings of ``rows`` (n,), whitened in that order; write the step (x,) of the state.

    Changes the covariance p (x, x), and ``errors`` (rows,) by what the state is ``off`` (x,). Returns the
    log-likelihood without constants, not a number where there is none.
    """
    n, width = len(rows), len(p)
    h, across, turned = np.empty((n, width)), np.empty((n, width)), np.empty((width, n))
    s, low, inverse = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    for i in range(n):
        row = rows[i]
        for j in range(width):
            h[i, j] = sensitivity[row, j]
            errors[row] -= h[i, j] * off[j]
        if not np.isfinite(errors[row]):
            return np.nan
    across[:], s[:] = 0.0, 0.0
    for i in range(n):  # most sensors read a few coordinates only; p is symmetric
        for j in range(width):
            if h[i, j] != 0.0:
                for k in range(width):
                    across[i, k] += h[i, j] * p[j, k]
    transposed_into(across, turned)
    for i in range(n):
        for j in range(width):
            if h[i, j] != 0.0:
                for k in range(n):
                    s[i, k] += h[i, j] * turned[j, k]
        s[i, i] += variance[rows[i]]
    if not inverse_of_root(s, low, inverse):
        return np.nan
    root, own = np.empty((n, width)), np.empty((n, width))
    multiply(inverse, across, root)
    transposed_into(root, turned)
    loss = np.empty((width, width))
    multiply(turned, root, loss)
    p -= loss
    symmetrise(p)
    likely = 0.0
    step[:] = 0.0
    back = np.empty((n, n))
    transposed_into(inverse, back)
    multiply(back, root, own)  # the gain, transposed
    for i in range(n):
        row, white = rows[i], 0.0
        for j in range(i + 1):
            white += inverse[i, j] * errors[rows[j]]
            whitening[row, rows[j]] = inverse[i, j]
        innovations[row] = white
        normalised[row] = errors[row] / sqrt(s[i, i])
        likely -= 0.5 * white**2 + log(low[i, i])
        for j in range(width):
            gain[j, row] = own[i, j]
            step[j] += root[i, j] * white
    return likely


@compile_inner
def halvings(h, by_q, by_v):
    """Return how often a step h [s] is halved until a series of fourth order holds for the fastest motion.

    Its rate is at most that of all springs and dampers together.
    """
    springs, dampers, count = 0.0, 0.0, 0
    for i in range(len(by_q)):
        springs += abs(by_q[i, i])
        dampers += abs(by_v[i, i])
    share = h * (sqrt(springs) + dampers)
    while share > LONGEST and count < MOST:
        share, count = 0.5 * share, count + 1
    return count


@compile_inner
def transition(h, v, by_q, by_v, free, out, forcing):
    """Write exp(A h) (2 nv, 2 nv), and the part (2 nv, nv) of its integral for forces.

    To fourth order over a step that is short enough, and squared: Golub and Van Loan, Matrix Computations,
    9.3.
    """
    nv = len(v)
    squared = halvings(h, by_q, by_v)
    h = h / 2.0**squared
    width = 2 * nv
    lower, psi, product = np.empty((nv, width)), np.eye(width), np.empty((width, width))
    for r in range(nv):
        for c in range(nv):
            lower[r, c], lower[r, nv + c] = by_q[r, c], by_v[r, c]
    u, w = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if free:
        u, w = three(v, 0), three(v, 3)
    for order in range(4, 0, -1):  # psi <- 1 + h / order A psi
        scale = h / order
        multiply(lower, psi, product[nv:])
        for r in range(nv):
            for c in range(width):
                product[r, c] = psi[nv + r, c]
        if free:  # - v x, of the bus's tangent
            for c in range(width):
                x, y = (psi[0, c], psi[1, c], psi[2, c]), (psi[3, c], psi[4, c], psi[5, c])
                a, b, d = cross(w, x), cross(u, y), cross(w, y)
                for r in range(3):
                    product[r, c] -= a[r] + b[r]
                    product[3 + r, c] -= d[r]
        for r in range(width):
            if order == 1:
                for c in range(nv):
                    forcing[r, c] = h * psi[r, nv + c]
            for c in range(width):
                psi[r, c] = scale * product[r, c]
        for r in range(width):
            psi[r, r] += 1.0
    more = np.empty((width, nv))
    for _ in range(squared):
        multiply(psi, forcing[:width], more)
        forcing[:width] += more
        multiply(psi, psi, product)
        psi[:] = product
    for r in range(width):
        for c in range(width):
            out[r, c] = psi[r, c]


@compile_inner
def carry_trends(p, change, first, trends, steep, h):
    """Let states, from ``first`` on, change by their trends (k, 2) for h [s]: in the covariance (x, x)
    and the transition (x, x).
    """
    for k in range(len(trends)):
        own, by, factor = first + trends[k, 0], first + trends[k, 1], steep[k] * h
        change[own, by] = factor
        for c in range(len(p)):
            p[own, c] += factor * p[by, c]
        for c in range(len(p)):
            p[c, own] += factor * p[c, by]


@compile_inner
def spread(p, change, forcing, inverse, noise, walk, rates, h):
    """Take the covariance (x, x) on through a transition (x, x) of h [s].

    The first 2 nv rows of ``forcing`` (x, nv) take accelerations there; ``noise`` (nv,) is that of forces,
    ``walk`` (3, k) that of unknown inputs (`smsid.estimation.problem.UnknownForces`).
    """
    nv, width, acts = len(noise), len(p), walk.shape[1]
    inner = 2 * nv
    carried, back = np.empty((inner, width)), np.empty((width, inner))
    multiply(change[:inner], p, carried)
    transposed_into(change[:inner], back)
    spread_out, noisy, scaled = np.empty((inner, inner)), np.empty((inner, nv)), np.empty((nv, inner))
    multiply(carried, back, spread_out)
    multiply(forcing[:inner], inverse, noisy)
    for r in range(inner):
        for c in range(nv):
            scaled[c, r] = noisy[r, c] * noise[c]
    added = np.empty((inner, inner))
    multiply(noisy, scaled, added)
    for r in range(inner):
        for c in range(inner):
            p[r, c] = spread_out[r, c] + added[r, c]
        for c in range(inner, width):
            p[r, c] = carried[r, c]
            p[c, r] = carried[r, c]
    for i in range(acts):
        own, end, common, mean = inner + i, walk[0, i] * h, walk[1, i] * h, walk[2, i] * h
        p[own, own] += end
        for r in range(inner):
            p[r, own] += common * change[r, own]
            p[own, r] = p[r, own]
            for c in range(inner):
                p[r, c] += mean * change[r, own] * change[c, own]
    for i in range(len(rates)):
        p[inner + acts + i, inner + acts + i] += rates[i] * h
    symmetrise(p)


@compile_inner
def add_square(p, by_force, force):
    """Add to the covariance (x, x) that of a change by ``by_force`` (y, nv) of forces that err by ``force``
    (nv,), all together.
    """
    moved = np.zeros(len(by_force))
    for c in range(len(force)):
        if force[c] != 0.0:
            for r in range(len(moved)):
                moved[r] += by_force[r, c] * force[c]
    for r in range(len(moved)):
        if moved[r] != 0.0:
            for c in range(len(moved)):
                p[r, c] += moved[r] * moved[c]
