"""Inverse dynamics, and its derivatives by configuration and velocity, exactly.

Singh, Russo and Wensing, IEEE Robotics and Automation Letters 7 (2022) 1776, with all vectors in the axes of
the bus about its origin. The matrix 2 B of a body takes (u, w) to (2 w x p, D w) there, p its momentum: it
depends on nothing else, so that p and D add up over bodies.
"""

from __future__ import annotations

import numpy as np

from smsid.kernel._beams import ZERO, add_beam_derivatives
from smsid.kernel._forces import UNITS, add_forces, add_tides
from smsid.kernel._motion import start_of_chart
from smsid.kernel._rotors import add_rotor_derivatives
from smsid.kernel._spatial import (
    bracket,
    cross,
    dot,
    matrix,
    plus,
    put,
    six,
    three,
    times_vector,
    transposed,
    wrench,
)
from smsid.kernel._tree import acceleration, outward, workspace
from smsid.kernel.columns import ARMATURE, BEAMS, DAMPING, FORCES, FREE, PARENT, ROTORS, STIFFNESS, TIME
from smsid.kernel.jit import compile_inner, compiled_and_cached


@compile_inner
def inverse_dynamics(tree, bodies, root, angles, v, a, gravity, load, work, out):
    """Write the generalised forces (nv,) that an acceleration takes, with springs, dampers and other forces,
    of which friction may go by the applied ones, ``load`` (nv,).
    """
    outward(tree, bodies, root, angles, v, a, gravity, work)
    axes, forces, inertias, n = work[2], work[5], work[6], len(tree)
    start = 6 if root[FREE] > 0.0 else 0
    for i in range(n - 1, -1, -1):
        body, k = bodies[i], start + i
        total = body[ARMATURE] * a[k] + body[STIFFNESS] * angles[i] + body[DAMPING] * v[k]
        if root[BEAMS] > 0.0 or root[ROTORS] > 0.0:  # else it is of another table
            total += work[11][i, 6]
        above = tree[i, PARENT] if tree[i, PARENT] >= 0 else n
        for c in range(6):
            total += axes[i, c] * forces[i, c]
            forces[above, c] += forces[i, c]
        if root[FORCES] > 0.0:
            for c in range(10):
                inertias[above, c] += inertias[i, c]
        out[k] = total
    for c in range(start):
        out[c] = forces[n, c]
    if root[FORCES] > 0.0:
        add_forces(root, angles, v, load, -1.0, out)
        add_tides(root, work, -1.0, out)


@compiled_and_cached
def forces_along(tree, bodies, root, times, q, v, a, load, out):
    """Write what `inverse_dynamics` gives along a motion: q (N, nq), the others and ``out`` (N, nv)."""
    n = len(tree)
    work, angles = workspace(n), np.empty(n)
    for k in range(len(times)):
        root[TIME] = times[k]
        gravity = start_of_chart(tree, root, q[k], angles)
        inverse_dynamics(tree, bodies, root, angles, v[k], a[k], gravity, load[k], work, out[k])


@compiled_and_cached
def accelerations_along(tree, bodies, root, times, q, v, tau, out):
    """Write accelerations (N, nv) at states q (N, nq), v (N, nv) under applied forces ``tau`` (N, nv)."""
    n = len(tree)
    work, angles = workspace(n), np.empty(n)
    for k in range(len(times)):
        root[TIME] = times[k]
        gravity = start_of_chart(tree, root, q[k], angles)
        acceleration(tree, bodies, root, angles, v[k], tau[k], gravity, work, out[k])


@compiled_and_cached
def passive_along(tree, bodies, root, times, q, v, load, out):
    """Write the part of `forces_along` that bodies have none in: springs, dampers and forces by few of the
    coordinates.
    """
    start, angles = 6 if root[FREE] > 0.0 else 0, np.empty(len(tree))
    for k in range(len(times)):
        root[TIME] = times[k]
        start_of_chart(tree, root, q[k], angles)
        out[k] = 0.0
        for i in range(len(tree)):
            out[k, start + i] = bodies[i, STIFFNESS] * angles[i] + bodies[i, DAMPING] * v[k, start + i]
        if root[FORCES] > 0.0:
            add_forces(root, angles, v[k], load[k], -1.0, out[k])


@compile_inner
def momentum_terms(inertia, velocity, out):
    """Write momentum p and matrix D of a body, of its ``inertia`` (10,) and velocity (6,), into out (12,)."""
    u, w, h = three(velocity, 0), three(velocity, 3), three(inertia, 1)
    xx, xy, yy, xz, yz, zz = six(inertia, 4)
    out[0], out[1], out[2] = plus(cross(w, h), inertia[0], u)
    columns = (
        cross(w, (2.0 * xx, 2.0 * xy, 2.0 * xz)),
        cross(w, (2.0 * xy, 2.0 * yy, 2.0 * yz)),
        cross(w, (2.0 * xz, 2.0 * yz, 2.0 * zz)),
    )
    trace, along = xx + yy + zz, 2.0 * dot(h, u)
    for c in range(3):
        turned = cross(w, UNITS[c])
        for r in range(3):
            out[3 + 3 * r + c] = columns[c][r] - trace * turned[r] - 2.0 * u[r] * h[c]
        out[3 + 4 * c] += along


@compile_inner
def derivatives(tree, bodies, root, angles, v, a, gravity, scratch, mass, by_q, by_v):
    """Write the mass matrix and the derivatives of the forces that an acceleration takes, (nv, nv) each.

    By the tangent of q and by v. ``scratch`` is a workspace, two arrays (n, 6) and one (n + 1, 12).
    """
    work, first, second, terms = scratch
    outward(tree, bodies, root, angles, v, a, gravity, work)
    axes, velocities, accelerations, forces, inertias = work[2], work[3], work[4], work[5], work[6]
    n = len(tree)
    start = 6 if root[FREE] > 0.0 else 0
    mass[:], by_q[:], by_v[:] = 0.0, 0.0, 0.0
    for i in range(n + 1):
        momentum_terms(inertias[i], velocities[i], terms[i])
    for i in range(n):  # rates of the axes, and what an acceleration of what carries them does
        above = tree[i, PARENT] if tree[i, PARENT] >= 0 else n
        linear, angular = three(axes[i], 0), three(axes[i], 3)
        x, w = three(velocities[above], 0), three(velocities[above], 3)
        rate, turning = bracket(x, w, linear, angular)
        put(first[i], rate, turning)
        here, there = bracket(x, w, rate, turning)
        x, w = bracket(three(accelerations[above], 0), three(accelerations[above], 3), linear, angular)
        put(second[i], plus(x, 1.0, here), plus(w, 1.0, there))
    u0, w0 = three(velocities[n], 0), three(velocities[n], 3)
    for i in range(n - 1, -1, -1):
        own, k = inertias[i], start + i
        moment, inertia = three(own, 1), six(own, 4)
        momentum, d = three(terms[i], 0), matrix(terms[i], 3)
        linear, angular = three(axes[i], 0), three(axes[i], 3)
        rate, turning = three(first[i], 0), three(first[i], 3)
        f, m = wrench(own[0], moment, inertia, linear, angular)
        p, l = wrench(own[0], moment, inertia, rate, turning)
        qf, qm = wrench(own[0], moment, inertia, three(second[i], 0), three(second[i], 3))
        pull, twist = three(forces[i], 0), three(forces[i], 3)
        qf = plus(plus(qf, 2.0, cross(turning, momentum)), 1.0, cross(angular, pull))
        qm = plus(plus(qm, 1.0, times_vector(d, turning)), 1.0, cross(linear, pull))
        qm = plus(qm, 1.0, cross(angular, twist))
        vf = plus(cross(angular, momentum), 1.0, p)
        vf = (2.0 * vf[0], 2.0 * vf[1], 2.0 * vf[2])
        vm = plus(times_vector(d, angular), 2.0, l)
        back = plus(times_vector(transposed(d), angular), 2.0, cross(momentum, linear))
        j = i
        while j >= 0:
            c, lead, spin = start + j, three(axes[j], 0), three(axes[j], 3)
            mass[c, k] = dot(lead, f) + dot(spin, m)
            mass[k, c] = mass[c, k]
            by_q[c, k] = dot(lead, qf) + dot(spin, qm)
            by_v[c, k] = dot(lead, vf) + dot(spin, vm)
            if j != i:
                rate, turning = three(first[j], 0), three(first[j], 3)
                by_q[k, c] = dot(back, turning) + dot(f, three(second[j], 0)) + dot(m, three(second[j], 3))
                by_v[k, c] = dot(back, spin) + 2.0 * (dot(f, rate) + dot(m, turning))
            j = tree[j, PARENT]
        mass[k, k] += bodies[i, ARMATURE]
        by_q[k, k] += bodies[i, STIFFNESS]
        by_v[k, k] += bodies[i, DAMPING]
        if start:
            weighed, slid = cross(gravity, f), cross(f, w0)
            swept = plus(plus(back, 1.0, cross(f, u0)), 1.0, cross(m, w0))
            for c in range(3):
                mass[c, k], mass[3 + c, k], mass[k, c], mass[k, 3 + c] = f[c], m[c], f[c], m[c]
                by_q[c, k], by_q[3 + c, k], by_v[c, k], by_v[3 + c, k] = qf[c], qm[c], vf[c], vm[c]
                by_q[k, 3 + c], by_v[k, c], by_v[k, 3 + c] = weighed[c], slid[c], swept[c]
        above = tree[i, PARENT] if tree[i, PARENT] >= 0 else n
        for c in range(6):
            forces[above, c] += forces[i, c]
        for c in range(10):
            inertias[above, c] += inertias[i, c]
        for c in range(12):
            terms[above, c] += terms[i, c]
    if start:
        own, d = inertias[n], matrix(terms[n], 3)
        moment, inertia, momentum = three(own, 1), six(own, 4), three(terms[n], 0)
        for c in range(3):
            e = UNITS[c]
            slid, swept, fall = cross(w0, e), cross(u0, e), cross(e, gravity)
            columns = (
                wrench(own[0], moment, inertia, e, ZERO),
                wrench(own[0], moment, inertia, ZERO, e),
                wrench(own[0], moment, inertia, fall, ZERO),
                wrench(own[0], moment, inertia, slid, ZERO),
                wrench(own[0], moment, inertia, swept, slid),
            )
            more, about = cross(e, momentum), times_vector(d, e)
            for r in range(3):
                mass[r, c], mass[3 + r, c] = columns[0][0][r], columns[0][1][r]
                mass[r, 3 + c], mass[3 + r, 3 + c] = columns[1][0][r], columns[1][1][r]
                by_q[r, 3 + c], by_q[3 + r, 3 + c] = columns[2][0][r], columns[2][1][r]
                by_v[r, c], by_v[3 + r, c] = columns[3][0][r], columns[3][1][r]
                by_v[r, 3 + c] = columns[4][0][r] + 2.0 * more[r]
                by_v[3 + r, 3 + c] = columns[4][1][r] + about[r]
    if root[BEAMS] > 0.0:
        add_beam_derivatives(tree, root, angles, v, a, gravity, first, second, work, mass, by_q, by_v)
    if root[ROTORS] > 0.0:
        add_rotor_derivatives(tree, root, v, first, second, work, mass, by_q, by_v)
