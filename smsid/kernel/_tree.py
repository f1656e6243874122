"""Forward dynamics of a tree of bodies.

Everything is computed in the axes of the bus: velocities, accelerations and forces of all bodies are spatial
vectors about the bus's origin, so they add up without transformations. Mass matrix from composite inertias,
bias forces by Newton and Euler, then the factorisation H = L' D L that keeps the zeros of branches
(Featherstone, Rigid Body Dynamics Algorithms, 2008, chapters 6 and 8).

Arguments that recur here and in the modules beside: ``tree`` (n, 5), ``bodies`` (n, 28) and ``root``
(26 + ...,) as `smsid.kernel.arrays` makes them; ``angles`` (n,) [rad | m] of the n joints, each of one degree
of freedom; ``v``, ``tau`` (nv,); ``gravity`` (3,) [m/s^2] in bus axes.
"""

from __future__ import annotations

import numpy as np

from smsid.kernel._beams import add_beams
from smsid.kernel._forces import add_forces, add_tides, grow
from smsid.kernel._rotors import add_rotors
from smsid.kernel._spatial import (
    about_origin,
    bearing_force,
    cross,
    dot,
    matrix,
    plus,
    put,
    six,
    three,
    times_matrix,
    times_vector,
    turn_about,
    turned_inertia,
    wrench,
)
from smsid.kernel.columns import (
    ARMATURE,
    AXIS,
    BEAMS,
    COUPLED,
    DAMPING,
    FORCES,
    FREE,
    INERTIA,
    KIND,
    MASS,
    MOMENT,
    PARENT,
    POSITION,
    ROTATION,
    ROTORS,
    SLIDE,
    STIFFNESS,
    TURNING,
)
from smsid.kernel.jit import compile_inner


@compile_inner
def workspace(n):
    """Return scratch space: orientations, places, axes, velocities, accelerations, forces, inertias of
    bodies (the last row is the bus), the mass matrix in three parts, zeros (n + 6,), and of joints that are
    modes of a beam or have a rotor what `add_beams` and `add_rotors` give them.
    """
    return (
        np.empty((n, 9)),
        np.empty((n, 3)),
        np.empty((n, 6)),
        np.empty((n + 1, 6)),
        np.empty((n + 1, 6)),
        np.empty((n + 1, 6)),
        np.empty((n + 1, 10)),
        np.empty((n, n)),
        np.empty((n, 6)),
        np.empty((6, 6)),
        np.zeros(n + 6),
        np.zeros((n, 7 + n)),
    )


@compile_inner
def outward(tree, bodies, root, angles, v, vdot, gravity, work):
    """Velocities, accelerations, forces and inertias of all bodies in bus axes, from the bus outwards.

    ``vdot`` (nv,) are the accelerations; with zeros the forces are the bias forces.
    """
    turns, places, axes, velocities, accelerations, forces, inertias = work[:7]
    n = len(tree)
    if root[FORCES] > 0.0:
        grow(bodies, root)
    free = root[FREE] > 0.0
    here = (0.0, 0.0, 0.0)
    # row n is the bus
    if free:
        put(velocities[n], three(v, 0), three(v, 3))
    else:
        put(velocities[n], here, here)
    lift, turning = (-gravity[0], -gravity[1], -gravity[2]), here
    if free:
        lift, turning = plus(lift, 1.0, three(vdot, 0)), three(vdot, 3)
    put(accelerations[n], lift, turning)
    if free:
        inertias[n] = root[:10]
        f, m = bearing_force(
            root[0],
            three(root, 1),
            six(root, 4),
            three(v, 0),
            three(v, 3),
            lift,
            turning,
        )
        put(forces[n], f, m)
    else:
        inertias[n] = 0.0
        put(forces[n], here, here)
    start = 6 if free else 0
    for i in range(n):
        body, parent, kind = bodies[i], tree[i, PARENT], tree[i, KIND]
        above = parent if parent >= 0 else n
        at = three(places[parent], 0) if parent >= 0 else here
        axis, place = three(body, AXIS), three(body, POSITION)
        moment, inertia, mass = three(body, MOMENT), six(body, INERTIA), body[MASS]
        heavy = mass != 0.0
        for k in range(MOMENT, MOMENT + 9):  # a difference of bodies may have any of them alone
            heavy = heavy or body[k] != 0.0
        if tree[i, TURNING] > 0:
            turn = matrix(body, ROTATION)
            if parent >= 0 and tree[parent, TURNING] > 0:
                outer = matrix(turns[parent], 0)
                turn, place = times_matrix(outer, turn), times_vector(outer, place)
            if kind != SLIDE:
                turn = times_matrix(turn, turn_about(axis, angles[i]))
            axis = times_vector(turn, axis)
            for r in range(3):
                for c in range(3):
                    turns[i, 3 * r + c] = turn[r][c]
            if heavy:
                moment, inertia = times_vector(turn, moment), turned_inertia(turn, inertia)
        place = plus(at, 1.0, place)
        if kind == SLIDE:
            place = plus(place, angles[i], axis)
            linear, angular = axis, here
        else:
            linear, angular = cross(place, axis), axis
        places[i, 0], places[i, 1], places[i, 2] = place
        put(axes[i], linear, angular)
        rate = v[start + i]
        velocity = plus(three(velocities[above], 0), rate, linear)
        spin = plus(three(velocities[above], 3), rate, angular)
        put(velocities[i], velocity, spin)
        lift = plus(cross(spin, linear), 1.0, cross(velocity, angular))
        acceleration = plus(plus(three(accelerations[above], 0), rate, lift), vdot[start + i], linear)
        turning = plus(three(accelerations[above], 3), rate, cross(spin, angular))
        turning = plus(turning, vdot[start + i], angular)
        put(accelerations[i], acceleration, turning)
        if not heavy:  # in between two joints
            forces[i], inertias[i] = 0.0, 0.0
            continue
        moment, inertia = about_origin(mass, moment, inertia, place)
        row = inertias[i]
        row[0], row[1], row[2], row[3] = mass, moment[0], moment[1], moment[2]
        for k in range(6):
            row[4 + k] = inertia[k]
        f, m = bearing_force(mass, moment, inertia, velocity, spin, acceleration, turning)
        put(forces[i], f, m)
    if root[BEAMS] > 0.0:
        add_beams(tree, root, angles, v, vdot, work)
    if root[ROTORS] > 0.0:
        add_rotors(tree, root, v, vdot, work)


@compile_inner
def acceleration(tree, bodies, root, angles, v, tau, gravity, work, out):
    """Write vdot (nv,) under applied forces ``tau`` and the springs and dampers into ``out``."""
    assemble(tree, bodies, root, angles, v, tau, gravity, work, out)
    solve_tree(tree, root[FREE] > 0.0, work[7], work[8], work[9], out)


@compile_inner
def assemble(tree, bodies, root, angles, v, tau, gravity, work, out):
    """Fill the mass matrix and write ``tau`` with springs and dampers, less bias forces, into ``out`` (nv,).

    Of the mass matrix: ``work[7]`` (n, n) of the joints, each with those it is carried by, ``work[8]`` (n, 6)
    theirs with the bus, ``work[9]`` (6, 6) the lower triangle of the bus's own.
    """
    outward(tree, bodies, root, angles, v, work[10], gravity, work)
    axes, forces, inertias, mass, coupling, whole = work[2], work[5], work[6], work[7], work[8], work[9]
    n, extra = len(tree), work[11]
    bends = root[BEAMS] > 0.0 or root[ROTORS] > 0.0  # else ``extra`` is of another table
    free = root[FREE] > 0.0
    start = 6 if free else 0
    for i in range(n - 1, -1, -1):
        body, parent = bodies[i], tree[i, PARENT]
        above = parent if parent >= 0 else n
        linear, angular = three(axes[i], 0), three(axes[i], 3)
        k = start + i
        force = six(forces[i], 0)
        out[k] = (
            tau[k]
            - body[STIFFNESS] * angles[i]
            - body[DAMPING] * v[k]
            - dot(linear, (force[0], force[1], force[2]))
            - dot(angular, (force[3], force[4], force[5]))
        )
        for c in range(6):
            forces[above, c] += force[c]
        for c in range(10):
            inertias[above, c] += inertias[i, c]
        own = inertias[i]
        f, m = wrench(own[0], three(own, 1), six(own, 4), linear, angular)
        mass[i, i] = dot(linear, f) + dot(angular, m) + body[ARMATURE]
        if bends:
            out[k] -= extra[i, 6]
            mass[i, i] += extra[i, 7 + i]
            f, m = plus(f, 1.0, three(extra[i], 0)), plus(m, 1.0, three(extra[i], 3))
        j = tree[i, COUPLED]
        while j != parent:  # modes of the same beam, the joint of a twist
            mass[i, j] = extra[i, 7 + j] if bends else 0.0
            j = tree[j, COUPLED]
        while j >= 0:
            mass[i, j] = dot(three(axes[j], 0), f) + dot(three(axes[j], 3), m)
            j = tree[j, PARENT]
        put(coupling[i], f, m)
    if free:
        m, x, y, z = inertias[n, 0], inertias[n, 1], inertias[n, 2], inertias[n, 3]
        for k in range(6):
            out[k] = tau[k] - forces[n, k]
            for c in range(6):
                whole[k, c] = 0.0
        whole[0, 0], whole[1, 1], whole[2, 2] = m, m, m
        whole[3, 1], whole[3, 2], whole[4, 2] = -z, y, -x
        whole[4, 0], whole[5, 0], whole[5, 1] = z, -y, x
        whole[3, 3], whole[4, 3], whole[4, 4] = inertias[n, 4], inertias[n, 5], inertias[n, 6]
        whole[5, 3], whole[5, 4], whole[5, 5] = inertias[n, 7], inertias[n, 8], inertias[n, 9]
    if root[FORCES] > 0.0:
        add_forces(root, angles, v, tau, 1.0, out)
        add_tides(root, work, 1.0, out)


@compile_inner
def solve_tree(tree, free, mass, coupling, whole, out):
    """Solve H x = b, b in ``out``, by H = L' D L, H as `assemble` leaves it; overwrites it."""
    n = len(tree)
    start = 6 if free else 0
    for i in range(n - 1, -1, -1):
        inverse = 1.0 / mass[i, i]
        pull, x = six(coupling[i], 0), out[start + i]
        j = tree[i, COUPLED]
        while j >= 0:
            share = mass[i, j] * inverse
            c = j
            while c >= 0:
                mass[j, c] -= share * mass[i, c]
                c = tree[c, COUPLED]
            for c in range(6):
                coupling[j, c] -= share * pull[c]
            out[start + j] -= share * x
            mass[i, j] = share
            j = tree[j, COUPLED]
        if free:
            for r in range(6):
                share = pull[r] * inverse
                for c in range(6):
                    whole[r, c] -= share * pull[c]
                out[r] -= share * x
                coupling[i, r] = share
        out[start + i] = x * inverse
    if free:
        for k in range(5, -1, -1):
            inverse = 1.0 / whole[k, k]
            for r in range(k):
                share = whole[k, r] * inverse
                for c in range(r + 1):
                    whole[r, c] -= share * whole[k, c]
                out[r] -= share * out[k]
            for r in range(k):
                whole[k, r] *= inverse
            out[k] *= inverse
        for k in range(6):
            for r in range(k):
                out[k] -= whole[k, r] * out[r]
    base = six(out, 0) if free else (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for i in range(n):
        x = out[start + i]
        if free:
            for r in range(6):
                x -= coupling[i, r] * base[r]
        j = tree[i, COUPLED]
        while j >= 0:
            x -= mass[i, j] * out[start + j]
            j = tree[j, COUPLED]
        out[start + i] = x
