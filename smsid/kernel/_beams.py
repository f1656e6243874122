"""Beams that shorten as they bend, in compiled form: what `smsid.effects.geometric_stiffness` adds.

Point masses along the beam, in the axes of its root: place ``p = (x - u, 0, w)``, less ones that do not move
along, ``p0 = (x, 0, w)``. With the root's velocity and acceleration (less gravity) each takes a force
``F = m (A + alpha x p + w x (w x p) + 2 w x p' + p'')``. What the masses have more by ``d = (-u, 0, 0)`` is,
at a bending that does not change, a body without mass, which is added to the one that carries the beam, so
that all that holds for bodies holds for it, too.

Beams stand in ``root`` behind the forces, one after the other: length of the table,
row of the body that carries it (-1: the bus), number n of modes, number N of points, rotation (9,) and place
(3,) of its root in the axes of that body, then rows (n,) and scales (n,) of its modes; of the points masses,
places and stiffnesses (N,), shapes (N, n) and the matrices of u and of its curvature (N, n, n).
"""

from __future__ import annotations

import numpy as np

from smsid.kernel._forces import UNITS
from smsid.kernel._spatial import (
    about_origin,
    bracket,
    cross,
    dot,
    matrix,
    plus,
    six,
    three,
    times_matrix,
    times_vector,
    transposed,
    turned_inertia,
)
from smsid.kernel.columns import BEAMS, FIRST, FORCES, FREE, PARENT, TURNING
from smsid.kernel.jit import compile_inner

ROW, COUNT, POINTS, TURN, AT, MODES = 1, 2, 3, 4, 13, 16  # in a beam's table
ZERO = (0.0, 0.0, 0.0)


@compile_inner
def first_of(root):
    """Return where the table of the first beam begins."""
    at = FIRST
    for _ in range(int(root[FORCES])):
        at += int(root[at])
    return at


@compile_inner
def frame(tree, root, at, turns, places):
    """Return rotation and place of a beam's root in bus axes."""
    row, turn, place = int(root[at + ROW]), matrix(root, at + TURN), three(root, at + AT)
    if row >= 0:
        if tree[row, TURNING] > 0:
            outer = matrix(turns[row], 0)
            turn, place = times_matrix(outer, turn), times_vector(outer, place)
        place = plus(three(places[row], 0), 1.0, place)
    return turn, place


@compile_inner
def seen(turn, place, linear, angular):
    """Return a spatial velocity about the bus's origin as that of a beam's root, in its axes."""
    back = transposed(turn)
    return times_vector(back, plus(linear, 1.0, cross(angular, place))), times_vector(back, angular)


@compile_inner
def told(turn, place, force, moment):
    """Return a wrench on a beam's root, in its axes, as one about the bus's origin."""
    force = times_vector(turn, force)
    return force, plus(times_vector(turn, moment), 1.0, cross(place, force))


@compile_inner
def points(root, at):
    """Return masses, places and stiffnesses of a beam's points (3, N), shapes (N, n), and the matrices of u
    and of its curvature (N, n, n).
    """
    n, count = int(root[at + COUNT]), int(root[at + POINTS])
    a = at + MODES + 2 * n
    b, size = a + 3 * count, count * n
    c = b + size
    d = c + size * n
    return (
        root[a:b].reshape(3, count),
        root[b:c].reshape(count, n),
        root[c:d].reshape(count, n, n),
        root[d : d + size * n].reshape(count, n, n),
    )


@compile_inner
def bending(root, at, angles, v, vdot, start):
    """Return the modes' coordinates, rates and accelerations (3, n)."""
    n = int(root[at + COUNT])
    out = np.empty((3, n))
    for k in range(n):
        row, scale = int(root[at + MODES + k]), root[at + MODES + n + k]
        out[0, k], out[1, k] = scale * angles[row], scale * v[start + row]
        out[2, k] = scale * vdot[start + row]
    return out


@compile_inner
def product(a, b):
    """Return the scalar product of two arrays (n,)."""
    total = 0.0
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@compile_inner
def times(a, x):
    """Return the product of a matrix (n, n) and x (n,)."""
    out = np.empty(len(x))
    for i in range(len(x)):
        out[i] = product(a[i], x)
    return out


@compile_inner
def swung(w, alpha, place, rate, rise):
    """Return the acceleration of a point that moves in turning axes."""
    out = plus(cross(alpha, place), 1.0, cross(w, cross(w, place)))
    return plus(plus(out, 2.0, cross(w, rate)), 1.0, rise)


@compile_inner
def forces_of(mass, lift, w, alpha, place, along, across):
    """Return what a point takes that is not drawn in, and by how much more one that is.

    ``along`` and ``across``: u and w with their first two derivatives by time; ``lift``: of the root.
    """
    plain = swung(w, alpha, (place, 0.0, across[0]), (0.0, 0.0, across[1]), (0.0, 0.0, across[2]))
    more = swung(w, alpha, (-along[0], 0.0, 0.0), (-along[1], 0.0, 0.0), (-along[2], 0.0, 0.0))
    return plus(ZERO, mass, plus(lift, 1.0, plain)), plus(ZERO, mass, more)


@compile_inner
def body(s, r, p):
    """Return moment and inertia of the body."""
    return (-s, 0.0, 0.0), (0.0, 0.0, -2.0 * r, p, 0.0, -2.0 * r)


@compile_inner
def add_beams(tree, root, angles, v, vdot, work):
    """Add the beams to forces and inertias of the bodies that carry them, after these are filled.

    Of every mode, ``work[11]`` gets what its acceleration does to the root, a wrench (6,) about the bus's
    origin, the generalised force that it takes itself, and what is more of its row of the mass matrix.
    """
    turns, places, _, velocities, accelerations, forces, inertias = work[:7]
    extra, count = work[11], len(tree)
    extra[:] = 0.0  # of another table there may be something left
    start, at = 6 if root[FREE] > 0.0 else 0, first_of(root)
    for _ in range(int(root[BEAMS])):
        n, row = int(root[at + COUNT]), int(root[at + ROW])
        on = row if row >= 0 else count
        turn, place = frame(tree, root, at, turns, places)
        numbers, shapes, drawn, curved = points(root, at)
        eta, rate, rise = bending(root, at, angles, v, vdot, start)
        u, w = seen(turn, place, three(velocities[on], 0), three(velocities[on], 3))
        a, alpha = seen(turn, place, three(accelerations[on], 0), three(accelerations[on], 3))
        a = plus(a, 1.0, cross(w, u))
        f, m, s, r, p = ZERO, ZERO, 0.0, 0.0, 0.0
        own, shared = np.zeros((3, n)), np.zeros((n, n))  # pull, swing and force of the modes
        for k in range(numbers.shape[1]):
            mass, x, phi = numbers[0, k], numbers[1, k], shapes[k]
            g, h, bent = times(drawn[k], eta), times(drawn[k], rate), times(curved[k], eta)
            along = 0.5 * product(g, eta), product(g, rate), product(g, rise) + product(h, rate)
            across = product(phi, eta), product(phi, rate), product(phi, rise)
            plain, more = forces_of(mass, a, w, alpha, x, along, across)
            f = plus(f, 1.0, more)
            m = plus(m, 1.0, cross((x - along[0], 0.0, across[0]), more))
            m = plus(m, -along[0], (0.0, -plain[2], plain[1]))
            s += mass * along[0]
            r += mass * along[0] * (x - 0.5 * along[0])
            p += mass * along[0] * across[0]
            spring = 0.5 * numbers[2, k] * product(bent, eta)
            for i in range(n):
                own[0, i] += mass * g[i]
                own[1, i] += mass * (along[0] * phi[i] - across[0] * g[i])
                own[2, i] += phi[i] * more[2] - g[i] * (plain[0] + more[0]) + spring * bent[i]
                for j in range(n):
                    shared[i, j] += mass * g[i] * g[j]
        for i in range(n):
            mode, scale = int(root[at + MODES + i]), root[at + MODES + n + i]
            force, about = told(turn, place, (-scale * own[0, i], 0.0, 0.0), (0.0, scale * own[1, i], 0.0))
            for c in range(3):
                extra[mode, c] += force[c]
                extra[mode, 3 + c] += about[c]
            extra[mode, 6] += scale * own[2, i]
            for j in range(n):
                extra[mode, 7 + int(root[at + MODES + j])] += scale * root[at + MODES + n + j] * shared[i, j]
        f, m = told(turn, place, f, m)
        moment, inertia = body(s, r, p)
        moment, inertia = about_origin(0.0, times_vector(turn, moment), turned_inertia(turn, inertia), place)
        for c in range(3):
            inertias[on, 1 + c] += moment[c]
            forces[on, c] += f[c]
            forces[on, 3 + c] += m[c]
        for c in range(6):
            inertias[on, 4 + c] += inertia[c]
        at += int(root[at])


@compile_inner
def put_column(tree, root, at, on, turn, place, axes, wrench, modes, column, out):
    """Add a change of the wrench on a beam's root and of its modes' forces (n,) to a column of ``out``."""
    start = 6 if root[FREE] > 0.0 else 0
    f, m = told(turn, place, wrench[0], wrench[1])
    i = on if on < len(tree) else -1
    while i >= 0:
        out[start + i, column] += dot(three(axes[i], 0), f) + dot(three(axes[i], 3), m)
        i = tree[i, PARENT]
    for c in range(min(start, 3)):
        out[c, column] += f[c]
        out[3 + c, column] += m[c]
    n = int(root[at + COUNT])
    for k in range(n):
        out[start + int(root[at + MODES + k]), column] += root[at + MODES + n + k] * modes[k]


@compile_inner
def change_of(mass, w, alpha, across, along, plain, more, place):
    """Return by how much the wrench of what is drawn in changes, and both forces.

    ``across`` and ``along``: changes of w and of u with their derivatives by time (3,); forces and place p
    are as they are.
    """
    off, moved = (-along[0], 0.0, 0.0), (0.0, 0.0, across[0])
    d_plain = plus(ZERO, mass, swung(w, alpha, moved, (0.0, 0.0, across[1]), ZERO))
    d_more = plus(ZERO, mass, swung(w, alpha, off, (-along[1], 0.0, 0.0), (-along[2], 0.0, 0.0)))
    m = plus(cross(plus(moved, 1.0, off), more), 1.0, cross(place[0], d_more))
    m = plus(plus(m, 1.0, cross(off, plain)), 1.0, cross(place[1], d_plain))
    return d_more, m, d_plain


@compile_inner
def add_row(out, f, m):
    """Add a wrench to a row (6,)."""
    for c in range(3):
        out[c] += f[c]
        out[3 + c] += m[c]


@compile_inner
def add_beam_derivatives(tree, root, angles, v, vdot, gravity, first, second, work, mass, by_q, by_v):
    """Add to `smsid.kernel.derivatives` what beams do beyond the bodies that `add_beams` has added."""
    turns, places, axes, velocities, accelerations = work[:5]
    count, at, start = len(tree), first_of(root), 6 if root[FREE] > 0.0 else 0
    for _ in range(int(root[BEAMS])):
        n, row = int(root[at + COUNT]), int(root[at + ROW])
        on = row if row >= 0 else count
        turn, place = frame(tree, root, at, turns, places)
        numbers, shapes, drawn, curved = points(root, at)
        eta, rate, rise = bending(root, at, angles, v, vdot, start)
        here, bus = six(velocities[on], 0), six(velocities[count], 0)
        u, w = seen(turn, place, three(velocities[on], 0), three(velocities[on], 3))
        a, alpha = seen(turn, place, three(accelerations[on], 0), three(accelerations[on], 3))
        lifted_root = plus(a, 1.0, cross(w, u))
        # wrench and modes' forces by spin of the root, by the bending, its rate and its acceleration
        by_spin, by_eta, by_rate, by_rise = (
            np.zeros((3, 6)),
            np.zeros((n, 6)),
            np.zeros((n, 6)),
            np.zeros((n, 6)),
        )
        of_spin, of_eta, of_rate = np.zeros((3, n)), np.zeros((n, n)), np.zeros((n, n))
        of_rise = np.zeros((n, n))
        for k in range(numbers.shape[1]):
            m, x, phi = numbers[0, k], numbers[1, k], shapes[k]
            g, h, bent = times(drawn[k], eta), times(drawn[k], rate), times(curved[k], eta)
            pushed, spring = times(drawn[k], rise), 0.5 * numbers[2, k] * product(bent, eta)
            along = 0.5 * product(g, eta), product(g, rate), product(g, rise) + product(h, rate)
            across = product(phi, eta), product(phi, rate), product(phi, rise)
            plain, more = forces_of(m, lifted_root, w, alpha, x, along, across)
            whole, off = (x - along[0], 0.0, across[0]), (-along[0], 0.0, 0.0)
            for c in range(3):
                e = UNITS[c]
                d_rest = plus(ZERO, 2.0 * m, cross(e, (-along[1], 0.0, 0.0)))
                slid = plus(ZERO, 2.0 * m, cross(e, (0.0, 0.0, across[1])))
                add_row(by_spin[c], d_rest, plus(cross(whole, d_rest), 1.0, cross(off, slid)))
                swing = plus(cross(e, cross(w, off)), 1.0, cross(w, cross(e, off)))
                d_more = plus(d_rest, m, swing)
                swing = plus(cross(e, cross(w, whole)), 1.0, cross(w, cross(e, whole)))
                d_whole = plus(plus(d_rest, 1.0, slid), m, swing)
                for i in range(n):
                    of_spin[c, i] += phi[i] * d_more[2] - g[i] * d_whole[0]
            for j in range(n):
                for which in range(2):
                    if which == 0:
                        w_change, u_change = (phi[j], 0.0, 0.0), (g[j], h[j], pushed[j])
                    else:
                        w_change, u_change = (0.0, phi[j], 0.0), (0.0, g[j], 2.0 * h[j])
                    d_more, about, d_plain = change_of(
                        m, w, alpha, w_change, u_change, plain, more, (whole, off)
                    )
                    add_row(by_rate[j] if which else by_eta[j], d_more, about)
                    out = of_rate if which else of_eta
                    for i in range(n):
                        out[j, i] += phi[i] * d_more[2] - g[i] * (d_plain[0] + d_more[0])
                add_row(
                    by_rise[j], (-m * g[j], 0.0, 0.0), (0.0, m * (along[0] * phi[j] - across[0] * g[j]), 0.0)
                )
                for i in range(n):
                    stiff = numbers[2, k] * bent[i] * bent[j] + spring * curved[k, i, j]
                    of_eta[j, i] += stiff - drawn[k, i, j] * (plain[0] + more[0])
                    of_rise[j, i] += m * g[i] * g[j]
        # by the motion of the root: its joints, then the bus
        i, c, modes = row, 0, np.zeros(n)
        while i >= 0 or c < start:
            for of_rates in range(2):
                if i >= 0:
                    column = start + i
                    change, spin = three(first[i], 0), three(first[i], 3)
                    if of_rates:
                        raised, turning = change, spin
                        change, spin = three(axes[i], 0), three(axes[i], 3)
                        lift, lifted = bracket(here[:3], here[3:], change, spin)
                        lift = plus(plus(ZERO, 2.0, raised), -1.0, lift)
                        lifted = plus(plus(ZERO, 2.0, turning), -1.0, lifted)
                    else:
                        lift, lifted = bracket(here[:3], here[3:], change, spin)
                        lift = plus(three(second[i], 0), -1.0, lift)
                        lifted = plus(three(second[i], 3), -1.0, lifted)
                else:
                    column = c
                    change, spin = (UNITS[c], ZERO) if c < 3 else (ZERO, UNITS[c - 3])
                    if of_rates:
                        lift, lifted = bracket(
                            plus(bus[:3], -1.0, here[:3]), plus(bus[3:], -1.0, here[3:]), change, spin
                        )
                    else:
                        lift, lifted = cross(spin, gravity), ZERO
                        change, spin = ZERO, ZERO
                du, dw = seen(turn, place, change, spin)
                da, dalpha = seen(turn, place, lift, lifted)
                da = plus(plus(da, 1.0, cross(dw, u)), 1.0, cross(w, du))
                f, about = ZERO, ZERO
                for e in range(3):
                    f = plus(f, dw[e], three(by_spin[e], 0))
                    about = plus(about, dw[e], three(by_spin[e], 3))
                for k in range(n):
                    modes[k] = by_rise[k, 0] * da[0] + by_rise[k, 4] * dalpha[1]
                    for e in range(3):
                        modes[k] += dw[e] * of_spin[e, k]
                out = by_v if of_rates else by_q
                put_column(tree, root, at, on, turn, place, axes, (f, about), modes, column, out)
            if i >= 0:
                i = tree[i, PARENT]
            else:
                c += 1
        for k in range(n):
            column, scale = start + int(root[at + MODES + k]), root[at + MODES + n + k]
            for which in range(3):
                rows, of, out = by_eta, of_eta, by_q
                if which == 1:
                    rows, of, out = by_rate, of_rate, by_v
                elif which == 2:
                    rows, of, out = by_rise, of_rise, mass
                f, about = plus(ZERO, scale, three(rows[k], 0)), plus(ZERO, scale, three(rows[k], 3))
                for i in range(n):
                    modes[i] = scale * of[k, i]
                put_column(tree, root, at, on, turn, place, axes, (f, about), modes, column, out)
            for i in range(column):  # what carries a mode comes before it
                mass[column, i] = mass[i, column]
        at += int(root[at])
