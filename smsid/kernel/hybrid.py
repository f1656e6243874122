"""Motion of what is free while the rest moves as prescribed, by the fixed-step Runge-Kutta of predictions."""

from __future__ import annotations

from math import isfinite, sqrt

import numpy as np

from smsid.kernel._motion import start_of_chart
from smsid.kernel._tree import assemble, workspace
from smsid.kernel.columns import COUPLED, FREE
from smsid.kernel.jit import compile_inner, compiled_and_cached


@compile_inner
def free_block(tree, base, free, work, out):
    """Write the lower triangle of the mass matrix of ``free`` (f,) indices in v into ``out`` (f, f).

    ``base``: how many velocities the bus has. The mass matrix is as `assemble` leaves it in ``work``.
    """
    mass, coupling, whole = work[7], work[8], work[9]
    for r in range(len(free)):
        i = free[r] - base
        for c in range(r + 1):
            j = free[c] - base
            if i < 0:
                out[r, c] = whole[free[r], free[c]]
            elif j < 0:
                out[r, c] = coupling[i, free[c]]
            else:
                above = i
                while above > j:  # parents come before their children
                    above = tree[above, COUPLED]
                out[r, c] = mass[i, j] if above == j else 0.0


@compile_inner
def solve_symmetric(a, b):
    """Solve a x = b by Cholesky's factorisation, in place; ``False`` where a is not positive definite.

    ``a`` (n, n): its lower triangle; ``b`` (n,).
    """
    n = len(b)
    for j in range(n):
        for k in range(j):
            a[j, j] -= a[j, k] * a[j, k]
        if not a[j, j] > 0.0:
            return False
        a[j, j] = sqrt(a[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                a[i, j] -= a[i, k] * a[j, k]
            a[i, j] /= a[j, j]
    for i in range(n):
        for k in range(i):
            b[i] -= a[i, k] * b[k]
        b[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= a[k, i] * b[k]
        b[i] /= a[i, i]
    return True


@compiled_and_cached
def hybrid_motion(tree, bodies, root, motion, applied, places, counts, h, y, stages, weights):
    """Fill in what is free at all evaluations; return the first that is not finite, or -1.

    ``motion``: q (E, nq), v, a (E, nv), prescribed parts filled in and free ``a`` zero. ``applied`` (E, f)
    generalised forces; ``places``: indices of the free velocities in v (f,), of free joints in q (r,), and in
    v; ``counts`` (segments,), ``h`` (steps,) [s]; ``y`` (r + f,) the start: free joints, free velocities;
    ``stages`` (s, s) and ``weights`` (s,) of the method. Evaluations: those of every step, then segments'
    ends.
    """
    q, v, a = motion
    free, rest = places
    size, joints, count = len(free), len(rest), len(weights)
    base = 6 if root[FREE] > 0.0 else 0
    work = workspace(len(tree))
    angles, tau, out = np.empty(len(tree)), np.zeros(v.shape[1]), np.empty(v.shape[1])
    block, x = np.empty((size, size)), np.empty(size)
    slopes, now = np.empty((count, len(y))), np.empty(len(y))
    e, step, total = 0, 0, len(h) * count
    for segment in range(len(counts)):
        for last in range(counts[segment] + 1):
            end = last == counts[segment]  # its only evaluation is that of the segment's end
            for stage in range(1 if end else count):
                at = total + segment if end else e
                for i in range(len(y)):
                    now[i] = y[i]
                    for k in range(stage):
                        now[i] += h[step] * stages[stage, k] * slopes[k, i]
                for i in range(joints):
                    q[at, rest[i]] = now[i]
                for i in range(size):
                    v[at, free[i]] = now[joints + i]
                    tau[free[i]] = applied[at, i]
                work[10][: v.shape[1]] = a[at]
                gravity = start_of_chart(tree, root, q[at], angles)
                assemble(tree, bodies, root, angles, v[at], tau, gravity, work, out)
                free_block(tree, base, free, work, block)
                for i in range(size):
                    x[i] = out[free[i]]
                if not solve_symmetric(block, x):
                    return at
                for i in range(size):
                    if not isfinite(x[i]):
                        return at
                    a[at, free[i]] = x[i]
                    slopes[stage, joints + i] = x[i]
                for i in range(joints):
                    slopes[stage, i] = now[size + i]
                e += 0 if end else 1
            if not end:
                for i in range(len(y)):
                    for k in range(count):
                        y[i] += h[step] * weights[k] * slopes[k, i]
                step += 1
    return -1
