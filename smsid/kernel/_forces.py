"""Forces that few coordinates decide, in compiled form: what `smsid.effects.force_laws` adds.

Their tables stand in ``root`` from `FIRST` on, one after the other: length of the table, number of the law,
time [s] from which it acts, number n of degrees of freedom, their places in v (n,), and the law's numbers.
"""

from __future__ import annotations

from math import cos, exp, sin, sqrt, tanh

import numpy as np

from smsid.kernel._spatial import cross, dot, plus, six, three, times_vector
from smsid.kernel.columns import ATTITUDE, FIRST, FORCES, FREE, MASS, TIME
from smsid.kernel.jit import compile_inner

LAW, START, COUNT, ROWS = 1, 2, 3, 4  # in a table
FRICTION, CONSTANT, INERTIAL, SPRING, DRIFT, CENTRAL, SHARED, PLAY, TIDE, GROWTH, TRANSMITTED = range(11)
LAWS = (
    "friction", "constant", "inertial", "spring", "drift", "central", "shared", "play", "tide", "growth",
    "transmitted",
)  # fmt: skip
"""Names of the laws, in the order of their numbers."""
UNITS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
PROBE = 1e-6  # step of the differences, as of nonlinear forces elsewhere


@compile_inner
def friction(root, k, angle, rate, load):
    """Return the torque against the motion of the laws of friction whose numbers begin at ``k``."""
    sign = tanh(rate / root[k + 10])
    dry = root[k + 1] + root[k + 3] * sign + root[k + 7] * abs(load)
    dry += root[k + 8] * cos(angle) + root[k + 9] * sin(angle)
    if root[k + 6] != 0.0:
        dry += root[k + 6] * exp(-(abs(rate / root[k + 11]) ** root[k + 12]))
    wet = root[k] + root[k + 2] * sign + root[k + 4] * abs(rate) + root[k + 5] * rate**2
    return wet * rate + dry * sign


@compile_inner
def in_body_axes(root, x):
    """Return a vector of inertial axes in those of the bus."""
    a, s = three(root, ATTITUDE), root[ATTITUDE + 3]
    y = cross(x, a)  # by the conjugate quaternion
    return plus(plus(x, 2.0 * s, y), 2.0, cross(y, a))


@compile_inner
def add_force(root, at, angles, v, tau, sign, out):
    """Add the force whose table begins at ``at``, times a sign, to ``out`` (nv,)."""
    if root[TIME] < root[at + START]:
        return
    law, n = int(root[at + LAW]), int(root[at + COUNT])
    start = 6 if root[FREE] > 0.0 else 0
    first, k = int(root[at + ROWS]), at + ROWS + n
    if law == FRICTION:
        out[first] -= sign * friction(root, k, angles[first - start], v[first], tau[first])
    elif law == CONSTANT:
        for j in range(n):
            out[int(root[at + ROWS + j])] += sign * root[k + j]
    elif law == INERTIAL:
        f, m = in_body_axes(root, three(root, k)), in_body_axes(root, three(root, k + 3))
        m = plus(m, 1.0, cross(three(root, k + 6), f))
        for c in range(3):
            out[c] += sign * f[c]
            out[3 + c] += sign * m[c]
    elif law == SPRING:
        out[first] -= sign * root[k] * (angles[first - start] - root[k + 1])
    elif law == DRIFT:
        grown = root[k + 1] * max(root[TIME] - root[k + 2], 0.0)
        out[first] -= sign * root[k] * grown * (2.0 + grown) * angles[first - start]
    elif law == CENTRAL:
        far, fast = 0.0, 0.0
        for j in range(n):
            i = int(root[at + ROWS + j])
            far += angles[i - start] ** 2
            fast += v[i] ** 2
        far, fast = sqrt(far), sqrt(fast)
        wall = root[k + 4] * (1.0 - root[k + 3] / far) if far > root[k + 3] else 0.0
        for j in range(n):
            i = int(root[at + ROWS + j])
            x, rate = angles[i - start], v[i]
            stretch, speed = (x, abs(rate)) if root[k] > 0.0 else (far, fast)
            out[i] -= sign * ((root[k + 1] * stretch**2 + wall) * x + root[k + 2] * speed * rate)
    elif law == SHARED:
        rate = 0.0
        for j in range(n):
            rate += root[k + 3 + j] * v[int(root[at + ROWS + j])]
        torque = root[k] * rate + root[k + 1] * tanh(rate / root[k + 2])
        for j in range(n):
            out[int(root[at + ROWS + j])] -= sign * root[k + 3 + j] * torque
    elif law == PLAY:
        x = angles[first - start]
        if abs(x) > root[k]:
            side = 1.0 if x > 0.0 else -1.0
            out[first] -= sign * (root[k + 1] * (x - side * root[k]) + root[k + 2] * v[first])
    elif law == TRANSMITTED:
        out[first] += sign * tau[int(root[at + ROWS + 1])]


@compile_inner
def add_forces(root, angles, v, tau, sign, out):
    """Add all forces, times a sign, to ``out`` (nv,)."""
    at = FIRST
    for _ in range(int(root[FORCES])):
        add_force(root, at, angles, v, tau, sign, out)
        at += int(root[at])


@compile_inner
def add_tides(root, work, sign, out):
    """Add the gradients of gravity, times a sign, to ``out`` (nv,).

    The inertias in ``work`` have to be composite: of each body with all that it carries.
    """
    axes, inertias, n, at = work[2], work[6], len(work[2]), FIRST
    for _ in range(int(root[FORCES])):
        k = at + ROWS
        if int(root[at + LAW]) == TIDE and root[TIME] >= root[at + START]:
            size, turned = sign * root[k], root[k + 1] * root[TIME]
            down, ahead = in_body_axes(root, three(root, k + 2)), in_body_axes(root, three(root, k + 5))
            c, s = cos(turned), sin(turned)
            r = plus((c * down[0], c * down[1], c * down[2]), s, ahead)
            whole = inertias[n]
            centre = whole[1] / whole[0], whole[2] / whole[0], whole[3] / whole[0]
            for i in range(n + 1):
                own = inertias[i]
                h, (xx, xy, yy, xz, yz, zz) = three(own, 1), six(own, 4)
                away = plus(h, -own[0], centre)
                pull = 3.0 * dot(r, away)
                spread = times_vector(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)), r)
                twist = cross(r, plus(spread, dot(r, centre), h))
                across = cross(h, centre)
                if i < n:
                    for j in range(3):
                        force, moment = pull * r[j] - away[j], 3.0 * twist[j] + across[j]
                        out[len(out) - n + i] += size * (axes[i, j] * force + axes[i, 3 + j] * moment)
                else:
                    for j in range(3):
                        out[j] += size * (pull * r[j] - away[j])
                        out[3 + j] += size * (3.0 * twist[j] + across[j])
        at += int(root[at])


@compile_inner
def grow(bodies, root):
    """Give bodies whose inertia grows in time what they have now: a row, -1 the bus, the time that it has
    grown until now, and what it grows by in a second (10,).
    """
    at = FIRST
    for _ in range(int(root[FORCES])):
        if int(root[at + LAW]) == GROWTH:
            k = at + ROWS
            row, grown = int(root[k]), max(root[TIME] - root[at + START], 0.0)
            more = grown - root[k + 1]
            for c in range(10):
                if row < 0:
                    root[c] += more * root[k + 2 + c]
                else:
                    bodies[row, MASS + c] += more * root[k + 2 + c]
            root[k + 1] = grown
        at += int(root[at])


@compile_inner
def take_differences(root, at, angles, v, tau, here, then, x, start, out):
    """Take away how a force that is ``here`` (nv,) changes with ``x``, which is ``angles`` or ``v``."""
    n = int(root[at + COUNT])
    for j in range(n):
        i = int(root[at + ROWS + j])
        kept = x[i - start]
        x[i - start] = kept + PROBE
        then[:] = 0.0
        add_force(root, at, angles, v, tau, 1.0, then)
        x[i - start] = kept
        for r in range(n):
            row = int(root[at + ROWS + r])
            out[row, i] -= (then[row] - here[row]) / PROBE


@compile_inner
def take_force_derivatives(root, angles, v, tau, by_q, by_v):
    """Take away how all forces change with q and v: from derivatives of what an acceleration takes."""
    at, start, here, then = FIRST, 6 if root[FREE] > 0.0 else 0, np.zeros(len(v)), np.zeros(len(v))
    for _ in range(int(root[FORCES])):
        law, n = int(root[at + LAW]), int(root[at + COUNT])
        if law == INERTIAL:
            if root[TIME] >= root[at + START]:  # turned by a small angle, it is there less that times it
                k = at + ROWS + n
                f, m = in_body_axes(root, three(root, k)), in_body_axes(root, three(root, k + 3))
                for c in range(3):
                    e = UNITS[c]
                    df, dm = cross(f, e), cross(m, e)
                    dm = plus(dm, 1.0, cross(three(root, k + 6), df))
                    for r in range(3):
                        by_q[r, 3 + c] -= df[r]
                        by_q[3 + r, 3 + c] -= dm[r]
        elif n and law != CONSTANT and law != TRANSMITTED:
            here[:] = 0.0
            add_force(root, at, angles, v, tau, 1.0, here)
            take_differences(root, at, angles, v, tau, here, then, angles, start, by_q)
            take_differences(root, at, angles, v, tau, here, then, v, 0, by_v)
        at += int(root[at])
