"""Rotors behind gears, in compiled form: the `InertiaTerm` of `smsid.effects.spatial.Rotor`.

A rotor of inertia I sits at a joint that turns by q, behind a gear that twists by phi; the body p before the
joint turns at omega. With n the joint's axis, which is fixed in p, ``alpha = n . omega``, and the share c by
which the rotor is carried round, the kinetic energy beyond armatures and bodies is

    I (c alpha (k qd + phid) + phid qd)

where k is 1, or 0 if the link counts the rotor already. (``k c^2 alpha^2`` is a body on p, ``k qd^2`` and
``phid^2`` are armatures: `smsid.kernel.arrays` adds these.) So with ``u = k qd + phid`` the joint takes
``I (k c alphad + phidd)``, the twist ``I (c alphad + qdd)``, and p the moment ``I c (ud n + u omega x n)``.

Rotors stand in ``root`` behind forces and beams, one after the other: length of the table, row of the joint,
row of the twist or -1, I, c and k.
"""

from __future__ import annotations

from smsid.kernel._forces import UNITS
from smsid.kernel._spatial import cross, dot, plus, three
from smsid.kernel.columns import BEAMS, FIRST, FORCES, FREE, PARENT, ROTORS
from smsid.kernel.jit import compile_inner

JOINT, TWIST, INERTIA, CARRIED, COUNTED = 1, 2, 3, 4, 5  # in a rotor's table


@compile_inner
def first_rotor(root):
    """Return where the table of the first rotor begins."""
    at = FIRST
    for _ in range(int(root[FORCES] + root[BEAMS])):
        at += int(root[at])
    return at


@compile_inner
def add_rotors(tree, root, v, vdot, work):
    """Add rotors to the forces of the bodies that carry them, after these are filled.

    Of joint and twist ``work[11]`` gets what their accelerations do to that body, a wrench (6,), the
    generalised force that they take themselves, and what is more of their rows of the mass matrix, as
    `smsid.kernel._beams.add_beams` gives it of modes.
    """
    axes, velocities, accelerations, forces = work[2], work[3], work[4], work[5]
    extra, start, at = work[11], 6 if root[FREE] > 0.0 else 0, first_rotor(root)
    if root[BEAMS] == 0.0:
        extra[:] = 0.0  # of another table there may be something left
    for _ in range(int(root[ROTORS])):
        joint, twist = int(root[at + JOINT]), int(root[at + TWIST])
        inertia, counted = root[at + INERTIA], root[at + COUNTED]
        share, axis = inertia * root[at + CARRIED], three(axes[joint], 3)
        on = tree[joint, PARENT] if tree[joint, PARENT] >= 0 else len(tree)
        turning = share * dot(axis, three(accelerations[on], 3))
        u, rise = counted * v[start + joint], counted * vdot[start + joint]
        for c in range(3):
            extra[joint, 3 + c] += counted * share * axis[c]
        extra[joint, 6] += counted * turning
        if twist >= 0:
            u, rise = u + v[start + twist], rise + vdot[start + twist]
            for c in range(3):
                extra[twist, 3 + c] += share * axis[c]
            extra[joint, 6] += inertia * vdot[start + twist]
            extra[twist, 6] += turning + inertia * vdot[start + joint]
            extra[twist, 7 + joint] += inertia
        across = cross(three(velocities[on], 3), axis)
        for c in range(3):
            forces[on, 3 + c] += share * (rise * axis[c] + u * across[c])
        at += int(root[at])


@compile_inner
def add_rotor_derivatives(tree, root, v, first, second, work, mass, by_q, by_v):
    """Add to `smsid.kernel.derivatives` what rotors do beyond the forces that `add_rotors` has added."""
    axes, velocities, count = work[2], work[3], len(tree)
    start, at = 6 if root[FREE] > 0.0 else 0, first_rotor(root)
    for _ in range(int(root[ROTORS])):
        joint, twist = int(root[at + JOINT]), int(root[at + TWIST])
        inertia, counted = root[at + INERTIA], root[at + COUNTED]
        share, axis = inertia * root[at + CARRIED], three(axes[joint], 3)
        parent = tree[joint, PARENT]
        on = parent if parent >= 0 else count
        spin, u = three(velocities[on], 3), counted * v[start + joint]
        if twist >= 0:
            u += v[start + twist]
            mass[start + joint, start + twist] += inertia
            mass[start + twist, start + joint] += inertia
        swept, gone = cross(spin, axis), plus(three(velocities[count], 3), -1.0, spin)
        i, c = parent, 0
        while i >= 0 or c < min(start, 3):  # the joints that move p, then the bus
            if i >= 0:
                column, along, rate = start + i, three(axes[i], 3), three(first[i], 3)
                turned, lifted = rate, plus(three(second[i], 3), -1.0, cross(spin, rate))
                raised = plus((2.0 * rate[0], 2.0 * rate[1], 2.0 * rate[2]), -1.0, cross(spin, along))
            else:  # an attitude turns everything alike
                column, along, turned, lifted = 3 + c, UNITS[c], (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
                raised = cross(gone, along)
            own = share * dot(axis, along)
            for row, weight in ((joint, counted), (twist, 1.0)):
                if row < 0:
                    continue
                mass[start + row, column] += weight * own
                mass[column, start + row] += weight * own
                by_q[start + row, column] += weight * share * dot(axis, lifted)
                by_v[start + row, column] += weight * share * dot(axis, raised)
            add_moment(tree, start, parent, axes, cross(turned, axis), share * u, column, by_q)
            add_moment(tree, start, parent, axes, cross(along, axis), share * u, column, by_v)
            if i >= 0:
                i = tree[i, PARENT]
            else:
                c += 1
        add_moment(tree, start, parent, axes, swept, counted * share, start + joint, by_v)
        if twist >= 0:
            add_moment(tree, start, parent, axes, swept, share, start + twist, by_v)
        at += int(root[at])


@compile_inner
def add_moment(tree, start, row, axes, moment, factor, column, out):
    """Add ``factor`` times a moment on the body of a row to a column of ``out`` (nv, nv)."""
    i = row
    while i >= 0:
        out[start + i, column] += factor * dot(three(axes[i], 3), moment)
        i = tree[i, PARENT]
    for c in range(min(start, 3)):
        out[3 + c, column] += factor * moment[c]
