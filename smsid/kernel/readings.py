"""What sensors read of a state, with derivatives by the tangent of q, by v and by the acceleration."""

from __future__ import annotations

from math import atan2, sqrt
from typing import NamedTuple

import numpy as np

from smsid.kernel._spatial import cross, dot, plus, three, turned
from smsid.kernel._tree import assemble, solve_tree
from smsid.kernel.columns import FREE
from smsid.kernel.jit import compile_inner

ANGLE, TURN_RATE = range(2)  # kinds of scalar readings
COMPLIANCE, GAP = range(2)  # laws of a gear that gives at once
POSITION, ATTITUDE, VELOCITY, ANGULAR_RATE = range(4)  # kinds of readings of the bus, three rows each
TINY = 1e-12  # sine of half an angle below which a rotation vector is linear in it


class Readings(NamedTuple):
    """The sensors of a spacecraft, T of them that differ in numbers alone.

    ``scalars`` (n, 4): row, kind, row of the joint in the tree and of what its encoder adds, or -1.
    ``bus`` (n, 2): first row and kind, of points at ``places`` (T, n, 3) on it. Accelerometers: first
    ``rows`` (n,), at ``rest`` (T, n, 3), moved by ``shapes`` (T, n, 3, m) of the joints ``modes`` (n, m), -1
    for none, and drawn in by ``drawn`` (T, n, m, m) along ``axes`` (T, n, 3). Readings of ``mixed`` (n, 2)
    rows (first, count) are ``gain`` (T, rows, rows) times ideal ones and ``bias`` (T, rows), to which
    ``added`` (n, rows) comes ``later`` (n,) [s]. Those of ``late`` (n, 2) rows are late by the ``delay``
    (T, rows) [s] of the first of them. Gears that give at once are ``twists`` (n, 7): row of the joint in
    the tree, whether its encoder reads the twist, inertia of the rotor, and as `bent` has them the law and
    its three numbers.
    """

    scalars: np.ndarray
    bus: np.ndarray
    places: np.ndarray
    rows: np.ndarray
    modes: np.ndarray
    rest: np.ndarray
    shapes: np.ndarray
    drawn: np.ndarray
    axes: np.ndarray
    mixed: np.ndarray
    gain: np.ndarray
    bias: np.ndarray
    later: np.ndarray
    added: np.ndarray
    late: np.ndarray
    delay: np.ndarray
    twists: np.ndarray


@compile_inner
def unit(c):
    """Return a unit vector."""
    return (1.0 if c == 0 else 0.0), (1.0 if c == 1 else 0.0), (1.0 if c == 2 else 0.0)


@compile_inner
def bent(twist, torque):
    """Return by how much a gear gives under a torque: in proportion to it, or as a gap does."""
    if twist[3] == COMPLIANCE:
        return twist[4] * torque
    x = torque / twist[5]
    return twist[4] * x / (1.0 + abs(x) ** twist[6]) ** (1.0 / twist[6])


@compile_inner
def add_twists(senses, tree, bodies, root, v, tau, a, angles, gravity, work, h):
    """Add to encoders what they see of gears that give at once: `SpacecraftModel.encoder_twist`."""
    start, n = 6 if root[FREE] > 0.0 else 0, len(senses.twists)
    behind, turned_by = np.empty(len(v)), np.empty(n)
    assemble(tree, bodies, root, angles, v, tau, gravity, work, behind)
    behind[:] = 0.0
    for k in range(n):
        twist = senses.twists[k]
        i = start + int(twist[0])
        turned_by[k] = bent(twist, tau[i] - twist[2] * a[i])
        behind[i] += twist[2] * turned_by[k]
    solve_tree(tree, start > 0, work[7], work[8], work[9], behind)
    for row, kind, joint, _ in senses.scalars:
        if kind != ANGLE:
            continue
        ahead = -behind[start + joint]
        for k in range(n):
            if int(senses.twists[k, 0]) == joint:
                ahead += senses.twists[k, 1] * turned_by[k]
        for other, what, _, _ in senses.scalars:
            if what == ANGLE:
                h[other] += senses.gain[0, other, row] * ahead


@compile_inner
def read(senses, t, root, q, v, a, angles, gravity, derive, h, by_q, by_v, by_a):
    """Write readings (rows,) of sensors number ``t`` into ``h`` and, if asked, derivatives (rows, nv).

    An attitude's rows hold the sensor's own error alone. ``gravity`` is in bus axes.
    """
    h[:] = 0.0
    if derive:
        by_q[:], by_v[:], by_a[:] = 0.0, 0.0, 0.0
    free = root[FREE] > 0.0
    start = 6 if free else 0
    for row, kind, joint, motor in senses.scalars:
        into = by_q if kind == ANGLE else by_v
        h[row] = angles[joint] if kind == ANGLE else v[start + joint]
        if derive:
            into[row, start + joint] = 1.0
        if motor >= 0:
            h[row] += angles[motor] if kind == ANGLE else v[start + motor]
            if derive:
                into[row, start + motor] = 1.0
    if free:
        read_bus(senses, t, q, v, derive, h, by_q, by_v)
        for k in range(len(senses.rows)):
            read_station(senses, t, k, v, a, angles, gravity, derive, h, by_q, by_v, by_a)
    for first, count in senses.mixed:
        last = first + count
        gain = senses.gain[t, first:last, first:last].copy()
        h[first:last] = np.dot(gain, h[first:last].copy()) + senses.bias[t, first:last]
        if derive:
            for x in (by_q, by_v, by_a):
                x[first:last] = np.dot(gain, x[first:last].copy())


@compile_inner
def read_bus(senses, t, q, v, derive, h, by_q, by_v):
    """Write what sensors on the bus read of its place and velocity."""
    u, w, here = three(v, 0), three(v, 3), three(q, 0)
    for k in range(len(senses.bus)):
        row, kind = senses.bus[k, 0], senses.bus[k, 1]
        r = three(senses.places[t, k], 0)
        moved = plus(u, 1.0, cross(w, r))
        if kind == POSITION:
            value = plus(here, 1.0, turned(q, r))
        elif kind == VELOCITY:
            value = turned(q, moved)
        elif kind == ANGULAR_RATE:
            value = w
        else:
            value = three(senses.bias[t], row)
        h[row], h[row + 1], h[row + 2] = value
        if not derive:
            continue
        for c in range(3):
            e = unit(c)
            if kind == ATTITUDE:
                by_q[row + c, 3 + c] = 1.0
            elif kind == ANGULAR_RATE:
                by_v[row + c, 3 + c] = 1.0
            else:
                column, swept = turned(q, e), turned(q, cross(e, r))
                if kind == POSITION:
                    for i in range(3):
                        by_q[row + i, c], by_q[row + i, 3 + c] = column[i], swept[i]
                else:
                    carried = turned(q, cross(e, moved))
                    for i in range(3):
                        by_q[row + i, 3 + c] = carried[i]
                        by_v[row + i, c], by_v[row + i, 3 + c] = column[i], swept[i]


@compile_inner
def read_station(senses, t, k, v, a, angles, gravity, derive, h, by_q, by_v, by_a):
    """Write the specific force at a station of an appendage, or at a point of the bus, in bus axes."""
    row, modes = senses.rows[k], senses.modes[k]
    shapes, drawn, axis = senses.shapes[t, k], senses.drawn[t, k], three(senses.axes[t, k], 0)
    place, moving, lifted = three(senses.rest[t, k], 0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    drop, pull_rate = 0.0, 0.0
    for i in range(len(modes)):
        if modes[i] < 0:
            continue
        lead = shapes[0, i], shapes[1, i], shapes[2, i]
        bent, rate = angles[modes[i]], v[6 + modes[i]]
        pull, swing = 0.0, 0.0
        for j in range(len(modes)):
            if modes[j] >= 0:
                pull += drawn[i, j] * angles[modes[j]]
                swing += drawn[i, j] * v[6 + modes[j]]
        place = plus(place, bent, lead)
        drop += 0.5 * pull * bent
        pull_rate += swing * rate
        lead = plus(lead, -pull, axis)
        moving = plus(moving, rate, lead)
        lifted = plus(lifted, a[6 + modes[i]], lead)
    place = plus(place, -drop, axis)
    u, w, alpha = three(v, 0), three(v, 3), three(a, 3)
    arm = cross(w, place)
    total = plus(plus(three(a, 0), 1.0, cross(w, u)), 1.0, plus(cross(alpha, place), 1.0, cross(w, arm)))
    total = plus(plus(total, -1.0, gravity), 1.0, lifted)
    total = plus(plus(total, 2.0, cross(w, moving)), -pull_rate, axis)
    h[row], h[row + 1], h[row + 2] = total
    if not derive:
        return
    for c in range(3):
        e = unit(c)
        slid, swept, fall = cross(w, e), cross(e, place), cross(e, gravity)
        # of w x u + w x (w x r) + 2 w x r', by w
        spun = plus(cross(e, u), 1.0, plus(cross(e, arm), 1.0, cross(w, swept)))
        spun = plus(spun, 2.0, cross(e, moving))
        for i in range(3):
            by_q[row + i, 3 + c] = fall[i]
            by_v[row + i, c], by_v[row + i, 3 + c] = slid[i], spun[i]
            by_a[row + i, c], by_a[row + i, 3 + c] = e[i], swept[i]
    for i in range(len(modes)):
        if modes[i] < 0:
            continue
        pull, swing, drawn_in = 0.0, 0.0, 0.0
        for j in range(len(modes)):
            if modes[j] >= 0:
                pull += drawn[i, j] * angles[modes[j]]
                swing += drawn[i, j] * v[6 + modes[j]]
                drawn_in += drawn[i, j] * a[6 + modes[j]]
        lead = plus((shapes[0, i], shapes[1, i], shapes[2, i]), -pull, axis)
        slid = cross(w, lead)
        near = plus(plus(cross(alpha, lead), 1.0, cross(w, slid)), -drawn_in, axis)
        near = plus(near, -2.0 * swing, cross(w, axis))
        slid = plus(slid, -swing, axis)
        for c in range(3):
            by_q[row + c, 6 + modes[i]] = near[c]
            by_v[row + c, 6 + modes[i]] = 2.0 * slid[c]
            by_a[row + c, 6 + modes[i]] = lead[c]


@compile_inner
def rotation_vector(q, other, first):
    """Return the rotation vector [rad] from the attitude of q (nq,) to the quaternion other[first:]."""
    e, s = (-q[3], -q[4], -q[5]), q[6]
    x, w = three(other, first), other[first + 3]
    y = plus(plus(cross(e, x), s, x), w, e)
    last, size = s * w - dot(e, x), sqrt(dot(y, y))
    sign = -2.0 if last < 0.0 else 2.0
    factor = 2.0 / last if size < TINY else sign * atan2(size, abs(last)) / size
    return factor * y[0], factor * y[1], factor * y[2]


@compile_inner
def residual(senses, time, q, measured, attitudes, h, out):
    """Write measured minus predicted (rows,) at a time [s]; an attitude's as rotation vector, body axes.

    ``attitudes`` (n, 4) are the quaternions of the attitudes, in order; one that is zero is not there.
    """
    for row in range(len(h)):
        out[row] = measured[row] - h[row]
    place = 0
    for k in range(len(senses.bus)):
        if senses.bus[k, 1] != ATTITUDE:
            continue
        row, seen = senses.bus[k, 0], attitudes[place]
        place += 1
        if seen[0] == 0.0 and seen[1] == 0.0 and seen[2] == 0.0 and seen[3] == 0.0:
            continue
        turn = rotation_vector(q, seen, 0)
        for c in range(3):
            out[row + c] = turn[c] - h[row + c]
    for i in range(len(senses.later)):
        if time >= senses.later[i]:
            for row in range(len(h)):
                out[row] -= senses.added[i, row]
