"""Steps of Dormand and Prince, fifth order, from one sample of held inputs to the next."""

from __future__ import annotations

from math import sqrt

import numpy as np
from scipy.integrate import RK45

from smsid.kernel._motion import chart_velocity, move, start_of_chart
from smsid.kernel._tree import acceleration, workspace
from smsid.kernel.columns import FREE, TIME
from smsid.kernel.jit import compile_inner, compiled_and_cached

SHORT = 0.5  # of the planned step: an end nearer than that is reached by the fifth order
STEP_ANGLE = 1.0  # [rad] turn of the bus in one step at most
PARTS, MOST_ERROR = 1.2, 500.0  # steps of fifth order per stretch: safety, error of one beyond which none do
STAGES = 6
A, ENDS = np.ascontiguousarray(RK45.A), np.ascontiguousarray(RK45.B)
PLACES = np.append(RK45.C, 1.0)
ERRORS, POLYNOMIAL = np.ascontiguousarray(RK45.E), np.ascontiguousarray(RK45.P)


@compile_inner
def combine(weights, count, k, scale, out):
    """Write ``scale`` times the sum of ``count`` rows of ``k`` by their weights into ``out``."""
    out[:] = 0.0
    for j in range(count):
        weight = scale * weights[j]
        for i in range(len(out)):
            out[i] += weight * k[j, i]


@compile_inner
def short_step(tree, bodies, root, q, v, tau, t, h, latest, scratch, k, y):
    """Take a step of Dormand and Prince from q (nq,), v (nv,); (xi, v) at its end are in ``y`` (2 nv,).

    ``k`` (7, 2 nv) are the rates at the stages and the end. Times [s] beyond ``latest`` are taken as that.
    """
    work, angles, moved = scratch
    nv = len(v)
    gravity = start_of_chart(tree, root, q, angles)
    for s in range(STAGES + 1):
        combine(A[s] if s < STAGES else ENDS, s, k, h, y)
        for i in range(nv):
            y[nv + i] += v[i]
        root[TIME] = min(t + PLACES[s] * h, latest)
        chart_velocity(tree, bodies, root, angles, gravity, y[:nv], y[nv:], tau, moved, work, k[s])


@compile_inner
def step_error(k, v, y, h, relative, absolute, scratch):
    """Return the error of a step in units of the tolerance."""
    nv, size = len(v), 0.0
    combine(ERRORS, STAGES + 1, k, h, scratch)
    for i in range(2 * nv):
        before = abs(v[i - nv]) if i >= nv else 0.0
        size += (scratch[i] / (absolute + relative * max(before, abs(y[i])))) ** 2
    return sqrt(size / (2.0 * nv))


@compiled_and_cached
def short_steps(tree, bodies, root, times, q, v, tau, parts, step, relative, absolute):
    """Go from time to time (N + 1,) [s] under held tau (N, nv), each stretch in a few steps of fifth order.

    q (N + 1, nq) and v (N + 1, nv) are filled from their first row, and ``parts`` (N,) with the number of
    equal steps. ``step`` [s] is what the eighth-order method would take. Returns how many stretches were done
    and ``step``: it stops before a stretch that is not short or where the error is beyond the tolerance.
    """
    nq, nv, n = q.shape[1], v.shape[1], len(tree)
    free = root[FREE] > 0.0
    scratch = workspace(n), np.empty(n), np.empty(n)
    k, y, spare = np.empty((STAGES + 1, 2 * nv)), np.empty(2 * nv), np.empty(2 * nv)
    place, speed = np.empty((2, nq)), np.empty(nv)
    for at in range(len(times) - 1):
        h, latest = times[at + 1] - times[at], np.nextafter(times[at + 1], times[at])
        spin = sqrt(v[at, 3] ** 2 + v[at, 4] ** 2 + v[at, 5] ** 2) if free else 0.0
        bound = min(step, STEP_ANGLE / spin) if spin > 0.0 else step
        if not h < SHORT * bound:
            return at, step
        count = 1
        while True:
            place[0], speed[:] = q[at], v[at]
            error = 0.0
            for part in range(count):
                here, there = part % 2, (part + 1) % 2
                t = times[at] + part * (h / count)
                short_step(
                    tree, bodies, root, place[here], speed, tau[at], t, h / count, latest, scratch, k, y
                )
                error = step_error(k, speed, y, h / count, relative, absolute, spare)
                if not error < 1.0:
                    break
                move(tree, root, place[here], y[:nv], place[there])
                speed[:] = y[nv:]
            if error < 1.0:
                break
            if count > 1 or not error < MOST_ERROR:
                return at, step
            count = 1 + int(PARTS * error**0.2)
        parts[at], step = count, bound
        q[at + 1], v[at + 1] = place[count % 2], speed
    return len(times) - 1, step


@compiled_and_cached
def short_states(tree, bodies, root, times, q, v, tau, parts, wanted, forces, out_q, out_v, out_a):
    """Write the states at times ``wanted`` (M,) [s] between those of `short_steps`, by taking steps again.

    ``out_q`` (M, nq), ``out_v`` and the accelerations ``out_a`` (M, nv) under ``forces`` (M, nv).
    """
    nq, nv, n = q.shape[1], v.shape[1], len(tree)
    scratch = workspace(n), np.empty(n), np.empty(n)
    k, y, weights = np.empty((STAGES + 1, 2 * nv)), np.empty(2 * nv), np.empty(STAGES + 1)
    place, speed = np.empty((2, nq)), np.empty((2, nv))
    known, done = -1, 0
    for m in range(len(wanted)):
        at = min(max(np.searchsorted(times, wanted[m], side="right") - 1, 0), len(times) - 2)
        if wanted[m] == times[at]:
            out_q[m], out_v[m] = q[at], v[at]
        else:
            count = parts[at]
            h = (times[at + 1] - times[at]) / count
            part = min(int((wanted[m] - times[at]) / h), count - 1)
            if at != known or part + 1 < done:
                known, done = at, 0
                place[0], speed[0] = q[at], v[at]
            while done < part + 1:
                here, there = done % 2, (done + 1) % 2
                t, latest = times[at] + done * h, np.nextafter(times[at + 1], times[at])
                short_step(tree, bodies, root, place[here], speed[here], tau[at], t, h, latest, scratch, k, y)
                move(tree, root, place[here], y[:nv], place[there])
                speed[there] = y[nv:]
                done += 1
            x = (wanted[m] - times[at]) / h - part
            for s in range(STAGES + 1):
                weights[s] = 0.0
                for p in range(POLYNOMIAL.shape[1] - 1, -1, -1):
                    weights[s] = (weights[s] + POLYNOMIAL[s, p]) * x
            here = part % 2
            combine(weights, STAGES + 1, k, h, y)
            move(tree, root, place[here], y[:nv], out_q[m])
            for i in range(nv):
                out_v[m, i] = speed[here, i] + y[nv + i]
        root[TIME] = wanted[m]
        g = start_of_chart(tree, root, out_q[m], scratch[1])
        acceleration(tree, bodies, root, scratch[1], out_v[m], forces[m], g, scratch[0], out_a[m])
