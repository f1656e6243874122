"""Small changes of forces and readings taken through a filter as it ran, many at once."""

from __future__ import annotations

import numpy as np

from smsid.kernel.covariance import multiply
from smsid.kernel.jit import compile_inner, compiled_and_cached


@compile_inner
def rows_of_accelerations(by_a):
    """Return the readings (r,) that accelerations enter at any sample, of derivatives by_a (N, rows, nv)."""
    n, rows, nv = by_a.shape
    found, count = np.empty(rows, dtype=np.int64), 0
    for r in range(rows):
        there = False
        for k in range(n):
            for c in range(nv):
                there = there or by_a[k, r, c] != 0.0
            if there:
                break
        if there:
            found[count] = r
            count += 1
    return found[:count]


@compiled_and_cached
def carry(filtered, between, at, read, led, now, out):
    """Write the whitened changes (m, N, rows); ``now`` (m, x) is the state's at first, and past the last.

    ``filtered`` are a run's whitening, sensitivity, gain, transition, forcing, by_a and inverse mass matrices
    at the samples and between them. The changes of forces ``between`` samples and ``at`` them, of readings
    (``read``) and of the state at the next sample (``led``) are each values (N, e), the columns (e,) they
    are in, and their places (e,): which force, reading or state.
    """
    whitening, sensitivity, gain, transition, forcing, by_a, inverse, middle_inverse = filtered
    n, rows, width = sensitivity.shape
    nv, both, m = by_a.shape[2], rows + width, len(now)
    shown = rows_of_accelerations(by_a)
    first, many = width + nv, width + nv + len(shown)
    ahead, lost, kept = np.zeros((both, width)), np.zeros((width, rows)), np.empty((width, width))
    pushed, acting = np.empty((width, nv)), np.empty((len(shown), nv))
    # a column's state, forces on the way and readings by accelerations; what these do to whitened
    # predictions, and to the state at the next sample before it is read
    inputs, effects, mixed = np.zeros((m, many)), np.zeros((many, both)), np.empty((m, both))
    inputs[:, :width] = now
    for k in range(n):
        goes_on = k < len(transition)
        multiply(whitening[k], sensitivity[k], ahead[:rows])
        if goes_on:
            multiply(transition[k], gain[k], lost)
            multiply(lost, sensitivity[k], kept)
            multiply(forcing[k], middle_inverse[k], pushed)
            for r in range(width):
                for c in range(width):
                    ahead[rows + r, c] = transition[k, r, c] - kept[r, c]
        for r in range(both):
            for c in range(width):
                effects[c, r] = ahead[r, c]
        for r in range(width):
            for c in range(nv):
                effects[width + c, rows + r] = pushed[r, c]
        for j in range(len(shown)):
            for r in range(rows):
                effects[first + j, r] = whitening[k, r, shown[j]]
            for r in range(width):
                effects[first + j, rows + r] = -lost[r, shown[j]]
            for c in range(nv):
                total = 0.0
                for i in range(nv):
                    total += by_a[k, shown[j], i] * inverse[k, i, c]
                acting[j, c] = total
        inputs[:, width:] = 0.0
        if goes_on:
            for e in range(len(between[1])):
                inputs[between[1][e], width + between[2][e]] += between[0][k, e]
        for e in range(len(at[1])):
            for j in range(len(shown)):
                inputs[at[1][e], first + j] += at[0][k, e] * acting[j, at[2][e]]
        multiply(inputs, effects, mixed)
        for e in range(len(read[1])):
            i, c, x = read[1][e], read[2][e], read[0][k, e]
            for r in range(rows):
                mixed[i, r] += x * whitening[k, r, c]
            for r in range(width):
                mixed[i, rows + r] -= x * lost[r, c]
        for i in range(m):
            for r in range(rows):
                out[i, k, r] = mixed[i, r]
        if goes_on:
            inputs[:, :width] = mixed[:, rows:]
            for e in range(len(led[1])):
                inputs[led[1][e], led[2][e]] += led[0][k, e]
    now[:] = inputs[:, :width]
