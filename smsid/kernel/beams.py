"""Beams that shorten as they bend, in compiled form: what `smsid.effects.geometric_stiffness` adds.

In the axes of the beam's root, with V = (u, w) and A the velocity and the acceleration (less gravity) of the
root, the kinetic energy is that of a body without mass of moment ``-s e`` and inertia ``-2 r`` across the
axis e and ``p`` off it, which go with the bending eta, plus terms of the rates. The body is added to the one
that carries the beam, so that all that holds for bodies holds for it, too; `rest` is what its change in time
and the rates add. Shortenings ``z = 1/2 eta' G eta`` have inertia and a spring of their own: the inertia
couples the modes.

Beams stand in ``root`` behind the forces, one after the other: length of the table,
row of the body that carries it (-1: the bus), number n of modes, rotation (9,) and place (3,) of its root in
the axes of that body, then rows (n,) and scales (n,) of its modes and the matrices A, B (n, n), C (n, n, n),
and of m = n (n + 1) / 2 shortenings inertias (m,), stiffnesses (m,) and matrices G (m, n, n).
"""

from __future__ import annotations

import numpy as np

from smsid.kernel.columns import BEAMS, FIRST, FORCES, FREE, PARENT, TURNING
from smsid.kernel.forces import UNITS
from smsid.kernel.jit import compiled
from smsid.kernel.spatial import (
    about_origin,
    bearing_force,
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

ROW, COUNT, TURN, AT, MODES = 1, 2, 3, 12, 15  # in a beam's table
ZERO = (0.0, 0.0, 0.0)


@compiled
def first_of(root):
    """Return where the table of the first beam begins."""
    at = FIRST
    for _ in range(int(root[FORCES])):
        at += int(root[at])
    return at


@compiled
def frame(tree, root, at, turns, places):
    """Return rotation and place of a beam's root in bus axes."""
    row, turn, place = int(root[at + ROW]), matrix(root, at + TURN), three(root, at + AT)
    if row >= 0:
        if tree[row, TURNING] > 0:
            outer = matrix(turns[row], 0)
            turn, place = times_matrix(outer, turn), times_vector(outer, place)
        place = plus(three(places[row], 0), 1.0, place)
    return turn, place


@compiled
def seen(turn, place, linear, angular):
    """Return a spatial velocity about the bus's origin as that of a beam's root, in its axes."""
    back = transposed(turn)
    return times_vector(back, plus(linear, 1.0, cross(angular, place))), times_vector(back, angular)


@compiled
def told(turn, place, force, moment):
    """Return a wrench on a beam's root, in its axes, as one about the bus's origin."""
    force = times_vector(turn, force)
    return force, plus(times_vector(turn, moment), 1.0, cross(place, force))


@compiled
def shortenings(root, at):
    """Return inertias and stiffnesses (m,) of a beam's shortenings, and where their matrices begin."""
    n = int(root[at + COUNT])
    first, m = at + MODES + 2 * n + 2 * n * n + n * n * n, n * (n + 1) // 2
    return root[first : first + m], root[first + m : first + 2 * m], first + 2 * m


@compiled
def product(a, b):
    """Return the scalar product of two arrays (n,)."""
    total = 0.0
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@compiled
def times(root, at, x):
    """Return the product of a matrix (n, n) that stands in ``root`` and x (n,)."""
    out = np.zeros(len(x))
    for i in range(len(x)):
        for j in range(len(x)):
            out[i] += root[at + len(x) * i + j] * x[j]
    return out


@compiled
def bending(root, at, angles, v, start):
    """Return s, r, p; eta, its rate, A eta, r by eta, A rate, r by eta and time, ``across``, ``along`` (n,);
    ``rises``, ``sinks`` and r by eta twice (n, n); and ``by_shape`` (m, n), all as the effect has them.
    """
    n = int(root[at + COUNT])
    own, across = np.zeros((6, n)), np.zeros((2, n))
    inertias, _, g = shortenings(root, at)
    a = at + MODES + 2 * n
    c = a + 2 * n * n
    rises, sinks, curved = np.zeros((n, n)), np.zeros((n, n)), np.empty((n, n))
    by_shape, square = np.zeros((len(inertias), n)), 0.0
    for k in range(n):
        row, scale = int(root[at + MODES + k]), root[at + MODES + n + k]
        own[0, k], own[1, k] = scale * angles[row], scale * v[start + row]
    for k in range(n):
        for i in range(n):
            curved[k, i] = root[a + n * (n + k) + i]
            own[2, k] += root[a + n * k + i] * own[0, i]
            own[3, k] += curved[k, i] * own[0, i]
            own[4, k] += root[a + n * k + i] * own[1, i]
            for j in range(n):
                x = root[c + n * (n * k + i) + j]
                rises[k, i] += x * own[0, j]
                sinks[i, j] += x * own[0, k]
    for k in range(n):
        for i in range(n):
            across[0, k] += 0.5 * rises[k, i] * own[0, i]
            across[1, k] += sinks[k, i] * own[0, i]
    for f in range(len(by_shape)):
        by_shape[f] = times(root, g + n * n * f, own[0])
        z, inertia = 0.5 * product(by_shape[f], own[0]), inertias[f]
        square += inertia * z**2
        for k in range(n):
            own[3, k] -= inertia * z * by_shape[f, k]
            for i in range(n):
                bent = z * root[g + n * (n * f + k) + i] + by_shape[f, k] * by_shape[f, i]
                curved[k, i] -= inertia * bent
    for k in range(n):
        own[5, k] = product(curved[k], own[1])
    s, p = 0.5 * product(own[0], own[2]), product(own[0], across[0])
    whole = s, 0.5 * (product(own[0], own[3]) + square), p
    rows = own[0], own[1], own[2], own[3], own[4], own[5], across[0], across[1]
    return whole, rows, (rises, sinks, curved, by_shape)


@compiled
def forces_of_shortenings(root, at, x, rate, lifts, by_shape):
    """Return what the shortenings take (m,), with the accelerations ``lifts`` (n,) of the modes."""
    inertias, stiffnesses, g = shortenings(root, at)
    out, n = np.empty(len(inertias)), len(x)
    for f in range(len(out)):
        rise = product(times(root, g + n * n * f, rate), rate) + product(by_shape[f], lifts)
        out[f] = inertias[f] * rise + 0.5 * stiffnesses[f] * product(by_shape[f], x)
    return out


@compiled
def accelerations_of_modes(root, at, vdot, start):
    """Return the accelerations (n,) of a beam's modes."""
    out = np.empty(int(root[at + COUNT]))
    for k in range(len(out)):
        out[k] = root[at + MODES + len(out) + k] * vdot[start + int(root[at + MODES + k])]
    return out


@compiled
def form(sinks, rate):
    """Return the quadratic form of a matrix (n, n)."""
    total = 0.0
    for i in range(len(rate)):
        for j in range(len(rate)):
            total += rate[i] * sinks[i, j] * rate[j]
    return total


@compiled
def rest(w, along, s, r, p, q, y):
    """Return force and moment of the rates: ``along`` the axis, of those s, r, p of the body's parameters,
    of the angular momentum q across the axis and its change y.
    """
    force = (-along, -2.0 * s * w[2], 2.0 * s * w[1])
    return force, ((p - q) * w[2], y - 2.0 * r * w[1], (p + q) * w[0] - 2.0 * r * w[2])


@compiled
def body(s, r, p):
    """Return moment and inertia of the body."""
    return (-s, 0.0, 0.0), (0.0, 0.0, -2.0 * r, p, 0.0, -2.0 * r)


@compiled
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
        whole, bent, (rises, sinks, _, by_shape) = bending(root, at, angles, v, start)
        x, rate, ax, bx, av, _, across, along = bent
        velocity, spin = three(velocities[on], 0), three(velocities[on], 3)
        lift, turning = three(accelerations[on], 0), three(accelerations[on], 3)
        u, w = seen(turn, place, velocity, spin)
        a, alpha = seen(turn, place, lift, turning)
        pull, swung, momentum = product(rate, av), 0.0, 0.0
        lifts = accelerations_of_modes(root, at, vdot, start)
        taken = forces_of_shortenings(root, at, x, rate, lifts, by_shape)
        own_inertia = shortenings(root, at)[0]
        for k in range(n):
            i, scale = int(root[at + MODES + k]), root[at + MODES + n + k]
            swing = across[k] - along[k]
            pull += ax[k] * lifts[k]
            swung += swing * lifts[k]
            momentum += swing * rate[k]
            f, m = told(turn, place, (-scale * ax[k], 0.0, 0.0), (0.0, scale * swing, 0.0))
            for c in range(3):
                extra[i, c] += f[c]
                extra[i, 3 + c] += m[c]
            slip = 0.0
            for j in range(n):
                slip += (rises[k, j] - rises[j, k]) * rate[j]
                shared = product(by_shape[:, k], own_inertia * by_shape[:, j])
                extra[i, 7 + int(root[at + MODES + j])] += scale * root[at + MODES + n + j] * shared
            extra[i, 6] += scale * (
                product(by_shape[:, k], taken)
                + swing * alpha[1]
                - ax[k] * (a[0] + w[1] * u[2] - w[2] * u[1])
                + (w[1] ** 2 + w[2] ** 2) * bx[k]
                + 2.0 * w[1] * slip
                - w[0] * w[2] * (across[k] + along[k])
            )
        p_rate = product(rate, across) + product(rate, along)
        f, m = rest(
            w, pull, product(rate, ax), product(rate, bx), p_rate, momentum, swung - form(sinks, rate)
        )
        f, m = told(turn, place, f, m)
        moment, inertia = body(whole[0], whole[1], whole[2])
        moment, inertia = about_origin(0.0, times_vector(turn, moment), turned_inertia(turn, inertia), place)
        for c in range(3):
            inertias[on, 1 + c] += moment[c]
        for c in range(6):
            inertias[on, 4 + c] += inertia[c]
        own, about = bearing_force(0.0, moment, inertia, velocity, spin, lift, turning)
        for c in range(3):
            forces[on, c] += f[c] + own[c]
            forces[on, 3 + c] += m[c] + about[c]
        at += int(root[at])


@compiled
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


@compiled
def add_beam_derivatives(tree, root, angles, v, vdot, gravity, first, second, work, mass, by_q, by_v):
    """Add to `smsid.kernel.derivatives` what beams do beyond the bodies that `add_beams` has added."""
    turns, places, axes, velocities, accelerations = work[:5]
    count, at, start = len(tree), first_of(root), 6 if root[FREE] > 0.0 else 0
    for _ in range(int(root[BEAMS])):
        n, row = int(root[at + COUNT]), int(root[at + ROW])
        on = row if row >= 0 else count
        turn, place = frame(tree, root, at, turns, places)
        _, bent, (rises, sinks, curvature, by_shape) = bending(root, at, angles, v, start)
        x, rate, ax, bx, av, bv, across, along = bent
        here, bus = six(velocities[on], 0), six(velocities[count], 0)
        u, w = seen(turn, place, three(velocities[on], 0), three(velocities[on], 3))
        a, alpha = seen(turn, place, three(accelerations[on], 0), three(accelerations[on], 3))
        straight = a[0] + w[1] * u[2] - w[2] * u[1]
        swing, slip, gone, modes = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
        for k in range(n):
            swing[k], gone[k] = across[k] - along[k], across[k] + along[k]
            for j in range(n):
                slip[k] += (rises[k, j] - rises[j, k]) * rate[j]
        s_rate, r_rate, p_rate = product(rate, ax), product(rate, bx), product(rate, gone)
        momentum = product(rate, swing)
        # by the motion of the root: its joints, then the bus
        i, c = row, 0
        while i >= 0 or c < start:
            for by_rate in range(2):
                if i >= 0:
                    column = start + i
                    change, spin = three(first[i], 0), three(first[i], 3)
                    if by_rate:
                        rise, turning = change, spin
                        change, spin = three(axes[i], 0), three(axes[i], 3)
                        lift, lifted = bracket(here[:3], here[3:], change, spin)
                        lift = plus(plus(ZERO, 2.0, rise), -1.0, lift)
                        lifted = plus(plus(ZERO, 2.0, turning), -1.0, lifted)
                    else:
                        lift, lifted = bracket(here[:3], here[3:], change, spin)
                        lift = plus(three(second[i], 0), -1.0, lift)
                        lifted = plus(three(second[i], 3), -1.0, lifted)
                else:
                    column = c
                    change, spin = (UNITS[c], ZERO) if c < 3 else (ZERO, UNITS[c - 3])
                    if by_rate:
                        lift, lifted = bracket(
                            plus(bus[:3], -1.0, here[:3]), plus(bus[3:], -1.0, here[3:]), change, spin
                        )
                    else:
                        lift, lifted = cross(spin, gravity), ZERO
                        change, spin = ZERO, ZERO
                du, dw = seen(turn, place, change, spin)
                da, dalpha = seen(turn, place, lift, lifted)
                fallen = da[0] + dw[1] * u[2] + w[1] * du[2] - dw[2] * u[1] - w[2] * du[1]
                for k in range(n):
                    modes[k] = (
                        swing[k] * dalpha[1]
                        - ax[k] * fallen
                        + 2.0 * (w[1] * dw[1] + w[2] * dw[2]) * bx[k]
                        + 2.0 * dw[1] * slip[k]
                        - (dw[0] * w[2] + w[0] * dw[2]) * gone[k]
                    )
                wrench = rest(dw, 0.0, s_rate, r_rate, p_rate, momentum, 0.0)
                out = by_v if by_rate else by_q
                put_column(tree, root, at, on, turn, place, axes, wrench, modes, column, out)
            if i >= 0:
                i = tree[i, PARENT]
            else:
                c += 1
        # by the bending and its rate
        first_a = at + MODES + 2 * n
        first_c = first_a + 2 * n * n
        inertias, stiffnesses, first_g = shortenings(root, at)
        lifts = accelerations_of_modes(root, at, vdot, start)
        taken = forces_of_shortenings(root, at, x, rate, lifts, by_shape)
        for k in range(n):
            column, scale = start + int(root[at + MODES + k]), root[at + MODES + n + k]
            pull, swung, q, p_by, spun = 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(n):
                by_eta = rises[i, k] - rises[k, i] - sinks[i, k]
                curved = rises[i, k] + rises[k, i] + sinks[i, k]
                pull += root[first_a + n * i + k] * lifts[i]
                swung += by_eta * lifts[i]
                spun += by_eta * rate[i]
                p_by += curved * rate[i]
                slid = 0.0
                for j in range(n):
                    q += rate[i] * rate[j] * root[first_c + n * (n * k + i) + j]
                    slid += rate[j] * (
                        root[first_c + n * (n * i + j) + k] - root[first_c + n * (n * j + i) + k]
                    )
                modes[i] = scale * (
                    by_eta * alpha[1]
                    - root[first_a + n * i + k] * straight
                    + (w[1] ** 2 + w[2] ** 2) * curvature[i, k]
                    + 2.0 * w[1] * slid
                    - w[0] * w[2] * curved
                )
            for f in range(len(taken)):
                pulled = (
                    inertias[f] * times(root, first_g + n * n * f, lifts)[k] + stiffnesses[f] * by_shape[f, k]
                )
                for i in range(n):
                    bent_by = root[first_g + n * (n * f + i) + k] * taken[f]
                    modes[i] += scale * (bent_by + by_shape[f, i] * pulled)
            moment, inertia = body(ax[k], bx[k], gone[k])
            f, m = bearing_force(0.0, moment, inertia, u, w, a, alpha)
            g, o = rest(w, pull, av[k], bv[k], p_by, spun, swung - q)
            wrench = plus(plus(ZERO, scale, f), scale, g), plus(plus(ZERO, scale, m), scale, o)
            put_column(tree, root, at, on, turn, place, axes, wrench, modes, column, by_q)
            for i in range(n):
                modes[i] = 2.0 * scale * w[1] * (rises[i, k] - rises[k, i])
            for f in range(len(taken)):
                pulled = inertias[f] * times(root, first_g + n * n * f, rate)[k]
                for i in range(n):
                    modes[i] += 2.0 * scale * by_shape[f, i] * pulled
            g, o = rest(w, 2.0 * av[k], ax[k], bx[k], gone[k], swing[k], -2.0 * product(sinks[k], rate))
            wrench = plus(ZERO, scale, g), plus(ZERO, scale, o)
            put_column(tree, root, at, on, turn, place, axes, wrench, modes, column, by_v)
            for i in range(n):
                modes[i] = scale * product(by_shape[:, i], inertias * by_shape[:, k])
            wrench = (-scale * ax[k], 0.0, 0.0), (0.0, scale * swing[k], 0.0)
            put_column(tree, root, at, on, turn, place, axes, wrench, modes, column, mass)
            for i in range(column):  # what carries a mode comes before it
                mass[column, i] = mass[i, column]
        at += int(root[at])
