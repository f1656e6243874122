"""The numerical kernel of simulations with held inputs, compiled by numba where the extra ``fast`` is there.

Everything that numba compiles stands in this file, constants included: its cache on disk is renewed when
this file changes, and would not be for what is imported. Without numba these are plain Python functions.

The state of a tree of bodies is computed in the axes of the bus: velocities, accelerations and forces of all
bodies are spatial vectors about the bus's origin (linear part first), so they add up without transformations.
Mass matrix from composite inertias and bias forces by Newton and Euler, then the factorisation
H = L' D L that keeps the zeros of branches (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapters 6
and 8).

Arguments that recur: ``tree`` (n, 4) and ``bodies`` (n, 28), ``root`` (16,) as `smsid.simulate.kernel` makes
them; ``angles`` (n,) [rad | m] of the n joints of one degree of freedom, ``v``, ``tau`` (nv,), ``gravity``
(3,) [m/s^2] in bus axes.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, sin, sqrt
from typing import Any

import numpy as np
from scipy.integrate import RK45

try:
    import numba
except ImportError:
    numba = None

DOUBT = 0.05  # of the change of the velocities; a motion of frequency w has (w h)^2 / 12
SMALL = 1e-6  # [m/s, rad/s] error of the velocities that does not count
LOST = 1.0  # [rad] turn of the bus in a step
SHORT = 0.25  # of the planned step: an end nearer than that is reached by the fifth order
STEP_ANGLE = 1.0  # [rad] turn of the bus in one step at most
PARTS, MOST_ERROR = 1.2, 500.0  # steps of fifth order per stretch: safety, error of one beyond which none do
NEAR = 0.05  # square of an angle [rad^2] below which its functions are series

STAGES = 6
A, ENDS = np.ascontiguousarray(RK45.A), np.ascontiguousarray(RK45.B)
ERRORS, POLYNOMIAL = np.ascontiguousarray(RK45.E), np.ascontiguousarray(RK45.P)

PARENT, KIND, PLACE, TURNING = range(4)  # columns of `tree`
HINGE, SLIDE, ENDLESS = range(3)  # kinds; an endless hinge is stored as (cos, sin)
ROTATION, POSITION, AXIS, MASS, MOMENT, INERTIA = 0, 9, 12, 15, 16, 19  # where they begin in `bodies`
ARMATURE, STIFFNESS, DAMPING, COLUMNS = 25, 26, 27, 28
GRAVITY, FREE = 10, 13  # in `root`, which begins with mass, moment and inertia of the bus


def _compile(function: Callable[..., Any]) -> Any:
    if numba is None:
        return function
    # not-a-number and infinity keep their meaning
    return numba.njit(function, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})


def _compile_cached(function: Callable[..., Any]) -> Any:
    if numba is None:
        return function
    try:
        return numba.njit(
            function, nogil=True, cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"}
        )
    except RuntimeError:  # nowhere to write a cache
        return None


@_compile
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@_compile
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@_compile
def _plus(a, s, b):
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@_compile
def _three(x, k):
    return x[k], x[k + 1], x[k + 2]


@_compile
def _six(x, k):
    return x[k], x[k + 1], x[k + 2], x[k + 3], x[k + 4], x[k + 5]


@_compile
def _matrix(x, k):
    return (
        (x[k], x[k + 1], x[k + 2]),
        (x[k + 3], x[k + 4], x[k + 5]),
        (x[k + 6], x[k + 7], x[k + 8]),
    )


@_compile
def _times(m, a):
    return _dot(m[0], a), _dot(m[1], a), _dot(m[2], a)


@_compile
def _product(m, n):
    a = (n[0][0], n[1][0], n[2][0])
    b = (n[0][1], n[1][1], n[2][1])
    c = (n[0][2], n[1][2], n[2][2])
    return (
        (_dot(m[0], a), _dot(m[0], b), _dot(m[0], c)),
        (_dot(m[1], a), _dot(m[1], b), _dot(m[1], c)),
        (_dot(m[2], a), _dot(m[2], b), _dot(m[2], c)),
    )


@_compile
def _turn_about(axis, angle):
    """Return the rotation about a unit vector."""
    c, s = cos(angle), sin(angle)
    x, y, z = axis
    d = 1.0 - c
    return (
        (c + d * x * x, d * x * y - s * z, d * x * z + s * y),
        (d * x * y + s * z, c + d * y * y, d * y * z - s * x),
        (d * x * z - s * y, d * y * z + s * x, c + d * z * z),
    )


@_compile
def _turned_inertia(m, i):
    """Return R I R' of I = (xx, xy, yy, xz, yz, zz)."""
    full = ((i[0], i[1], i[3]), (i[1], i[2], i[4]), (i[3], i[4], i[5]))
    a, b, c = _times(full, m[0]), _times(full, m[1]), _times(full, m[2])  # full is symmetric
    return _dot(m[0], a), _dot(m[1], a), _dot(m[1], b), _dot(m[2], a), _dot(m[2], b), _dot(m[2], c)


@_compile
def _by_inertia(i, a):
    return (
        i[0] * a[0] + i[1] * a[1] + i[3] * a[2],
        i[1] * a[0] + i[2] * a[1] + i[4] * a[2],
        i[3] * a[0] + i[4] * a[1] + i[5] * a[2],
    )


@_compile
def _wrench(mass, moment, inertia, linear, angular):
    """Return the inertia (mass, moment h, I about the origin) times a spatial vector."""
    return (
        _plus(_cross(angular, moment), mass, linear),
        _plus(_cross(moment, linear), 1.0, _by_inertia(inertia, angular)),
    )


@_compile
def _forces(mass, moment, inertia, velocity, spin, acceleration, turning):
    """Return the force I a + V x* (I V) of a body on its bearing."""
    p, k = _wrench(mass, moment, inertia, velocity, spin)
    f, n = _wrench(mass, moment, inertia, acceleration, turning)
    return (
        _plus(f, 1.0, _cross(spin, p)),
        _plus(_plus(n, 1.0, _cross(velocity, p)), 1.0, _cross(spin, k)),
    )


@_compile
def _add(x, first, more):
    for k in range(3):
        x[k] += first[k]
        x[3 + k] += more[k]


@_compile
def _put(x, first, more):
    x[0], x[1], x[2] = first
    x[3], x[4], x[5] = more


@_compile
def workspace(n):
    """Return scratch space: orientations, places, axes, velocities, accelerations, forces, inertias of
    bodies (the last row is the bus), and the mass matrix in three parts.
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
    )


@_compile
def _outward(tree, bodies, root, angles, v, gravity, work):
    """Velocities, bias forces and inertias of all bodies in bus axes, from the bus outwards."""
    turns, places, axes, velocities, accelerations, forces, inertias = work[:7]
    n = len(tree)
    free = root[FREE] > 0.0
    here = (0.0, 0.0, 0.0)
    # row n is the bus
    if free:
        _put(velocities[n], _three(v, 0), _three(v, 3))
    else:
        _put(velocities[n], here, here)
    _put(accelerations[n], (-gravity[0], -gravity[1], -gravity[2]), here)
    if free:
        inertias[n] = root[:10]
        f, m = _forces(
            root[0],
            _three(root, 1),
            _six(root, 4),
            _three(v, 0),
            _three(v, 3),
            _three(accelerations[n], 0),
            here,
        )
        _put(forces[n], f, m)
    else:
        inertias[n] = 0.0
        _put(forces[n], here, here)
    start = 6 if free else 0
    for i in range(n):
        body, parent, kind = bodies[i], tree[i, PARENT], tree[i, KIND]
        above = parent if parent >= 0 else n
        at = _three(places[parent], 0) if parent >= 0 else here
        axis, place = _three(body, AXIS), _three(body, POSITION)
        moment, inertia, mass = _three(body, MOMENT), _six(body, INERTIA), body[MASS]
        heavy = mass != 0.0 or inertia[0] != 0.0 or inertia[2] != 0.0 or inertia[5] != 0.0
        if tree[i, TURNING] > 0:
            turn = _matrix(body, ROTATION)
            if parent >= 0 and tree[parent, TURNING] > 0:
                outer = _matrix(turns[parent], 0)
                turn, place = _product(outer, turn), _times(outer, place)
            if kind != SLIDE:
                turn = _product(turn, _turn_about(axis, angles[i]))
            axis = _times(turn, axis)
            for r in range(3):
                for c in range(3):
                    turns[i, 3 * r + c] = turn[r][c]
            if heavy:
                moment, inertia = _times(turn, moment), _turned_inertia(turn, inertia)
        place = _plus(at, 1.0, place)
        if kind == SLIDE:
            place = _plus(place, angles[i], axis)
            linear, angular = axis, here
        else:
            linear, angular = _cross(place, axis), axis
        places[i, 0], places[i, 1], places[i, 2] = place
        _put(axes[i], linear, angular)
        rate = v[start + i]
        velocity = _plus(_three(velocities[above], 0), rate, linear)
        spin = _plus(_three(velocities[above], 3), rate, angular)
        _put(velocities[i], velocity, spin)
        lift = _plus(_cross(spin, linear), 1.0, _cross(velocity, angular))
        acceleration = _plus(_three(accelerations[above], 0), rate, lift)
        turning = _plus(_three(accelerations[above], 3), rate, _cross(spin, angular))
        _put(accelerations[i], acceleration, turning)
        if not heavy:  # in between two joints
            forces[i], inertias[i] = 0.0, 0.0
            continue
        # about the bus's origin: I + (2 p h + m p p) 1 - p h' - h p' - m p p'
        x, y, z = place
        a, b, c = moment
        whole = 2.0 * _dot(place, moment) + mass * _dot(place, place)
        inertia = (
            inertia[0] + whole - 2.0 * x * a - mass * x * x,
            inertia[1] - x * b - a * y - mass * x * y,
            inertia[2] + whole - 2.0 * y * b - mass * y * y,
            inertia[3] - x * c - a * z - mass * x * z,
            inertia[4] - y * c - b * z - mass * y * z,
            inertia[5] + whole - 2.0 * z * c - mass * z * z,
        )
        moment = _plus(moment, mass, place)
        row = inertias[i]
        row[0], row[1], row[2], row[3] = mass, moment[0], moment[1], moment[2]
        for k in range(6):
            row[4 + k] = inertia[k]
        f, m = _forces(mass, moment, inertia, velocity, spin, acceleration, turning)
        _put(forces[i], f, m)


@_compile
def acceleration(tree, bodies, root, angles, v, tau, gravity, work, out):
    """Write vdot (nv,) under applied forces ``tau`` and the springs and dampers into ``out``."""
    _outward(tree, bodies, root, angles, v, gravity, work)
    axes, forces, inertias, mass, coupling, whole = work[2], work[5], work[6], work[7], work[8], work[9]
    n = len(tree)
    free = root[FREE] > 0.0
    start = 6 if free else 0
    for i in range(n - 1, -1, -1):
        body, parent = bodies[i], tree[i, PARENT]
        above = parent if parent >= 0 else n
        linear, angular = _three(axes[i], 0), _three(axes[i], 3)
        k = start + i
        force = _six(forces[i], 0)
        out[k] = (
            tau[k]
            - body[STIFFNESS] * angles[i]
            - body[DAMPING] * v[k]
            - _dot(linear, (force[0], force[1], force[2]))
            - _dot(angular, (force[3], force[4], force[5]))
        )
        for c in range(6):
            forces[above, c] += force[c]
        for c in range(10):
            inertias[above, c] += inertias[i, c]
        own = inertias[i]
        f, m = _wrench(own[0], _three(own, 1), _six(own, 4), linear, angular)
        mass[i, i] = _dot(linear, f) + _dot(angular, m) + body[ARMATURE]
        j = parent
        while j >= 0:
            mass[i, j] = _dot(_three(axes[j], 0), f) + _dot(_three(axes[j], 3), m)
            j = tree[j, PARENT]
        _put(coupling[i], f, m)
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
    _solve(tree, free, mass, coupling, whole, out)


@_compile
def _solve(tree, free, mass, coupling, whole, out):
    """Solve H x = b, b in ``out``, by H = L' D L; only what has a common ancestor is touched.

    ``mass`` (n, n) is of the joints, ``coupling`` (n, 6) theirs with the bus, ``whole`` (6, 6) the bus's own.
    """
    n = len(tree)
    start = 6 if free else 0
    for i in range(n - 1, -1, -1):
        inverse = 1.0 / mass[i, i]
        pull, x = _six(coupling[i], 0), out[start + i]
        j = tree[i, PARENT]
        while j >= 0:
            share = mass[i, j] * inverse
            c = j
            while c >= 0:
                mass[j, c] -= share * mass[i, c]
                c = tree[c, PARENT]
            for c in range(6):
                coupling[j, c] -= share * pull[c]
            out[start + j] -= share * x
            mass[i, j] = share
            j = tree[j, PARENT]
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
    base = _six(out, 0) if free else (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for i in range(n):
        x = out[start + i]
        if free:
            for r in range(6):
                x -= coupling[i, r] * base[r]
        j = tree[i, PARENT]
        while j >= 0:
            x -= mass[i, j] * out[start + j]
            j = tree[j, PARENT]
        out[start + i] = x


@_compile
def _bracket(v, w, a, b):
    """Return the Lie bracket of the spatial vectors (v, w) and (a, b)."""
    return _plus(_cross(w, a), 1.0, _cross(v, b)), _cross(w, b)


@_compile
def _chart_rate(xi, v, out):
    """Write the rate of the chart's pose xi (6,) under the body velocity v (6,): Jlog6(exp6(xi)) v."""
    x, w = _three(xi, 0), _three(xi, 3)
    a, b = _three(v, 0), _three(v, 3)
    square = _dot(w, w)
    a1, b1 = _bracket(x, w, a, b)
    a2, b2 = _bracket(x, w, a1, b1)
    a3, b3 = _bracket(x, w, a2, b2)
    a4, b4 = _bracket(x, w, a3, b3)
    if square < NEAR:  # Bernoulli's numbers, with ad^6 = -2 s ad^4 - s^2 ad^2, s the squared angle
        second = 1.0 / 12.0 - square**2 * (1.0 / 30240.0 + 2.0 * square / 1209600.0)
        fourth = -1.0 / 720.0 - square * (2.0 / 30240.0 + 3.0 * square / 1209600.0)
    else:
        angle = sqrt(square)
        s, c = sin(angle), cos(angle) - 1.0
        second = 2.0 / square + (angle + 3.0 * s) / (4.0 * angle * c)
        fourth = 1.0 / square**2 + (angle + s) / (4.0 * angle * square * c)
    for k in range(3):
        out[k] = a[k] + 0.5 * a1[k] + second * a2[k] + fourth * a4[k]
        out[3 + k] = b[k] + 0.5 * b1[k] + second * b2[k] + fourth * b4[k]


@_compile
def _start_of_chart(tree, root, q, angles):
    """Read the joints' angles from q; return gravity in bus axes."""
    start = 7 if root[FREE] > 0.0 else 0
    for i in range(len(tree)):
        k = tree[i, PLACE]
        angles[i] = np.arctan2(q[k + 1], q[k]) if tree[i, KIND] == ENDLESS else q[k]
    g = _three(root, GRAVITY)
    if start == 0 or (g[0] == 0.0 and g[1] == 0.0 and g[2] == 0.0):
        return g
    x = _three(q, 3)
    y = _cross(x, g)  # by the conjugate quaternion
    return _plus(_plus(g, -2.0 * q[6], y), 2.0, _cross(x, y))


@_compile
def _unit_functions(square):
    """Return sin(x)/x, (1 - cos x)/x^2 and (x - sin x)/x^3 of the square of x."""
    if square < NEAR:
        first, second, third, term = 0.0, 0.0, 0.0, 1.0
        for k in range(8):
            first += term
            second += term / (2.0 * k + 2.0)
            third += term / ((2.0 * k + 2.0) * (2.0 * k + 3.0))
            term *= -square / ((2.0 * k + 2.0) * (2.0 * k + 3.0))
        return first, second, third
    x = sqrt(square)
    return sin(x) / x, (1.0 - cos(x)) / square, (x - sin(x)) / (x * square)


@_compile
def _here(root, gravity, xi):
    """Return gravity in the axes of the bus that has moved by xi in its chart."""
    if root[FREE] == 0.0 or (gravity[0] == 0.0 and gravity[1] == 0.0 and gravity[2] == 0.0):
        return gravity
    w = _three(xi, 3)
    a, b, _ = _unit_functions(_dot(w, w))
    y = _cross(w, gravity)
    return _plus(_plus(gravity, -a, y), b, _cross(w, y))


@_compile
def _rate(tree, bodies, root, angles, gravity, xi, v, tau, moved, work, out):
    """Write the rate of (xi, v) (2 nv,) in the chart about ``angles`` into ``out``."""
    nv = len(v)
    start = 6 if root[FREE] > 0.0 else 0
    for i in range(len(tree)):
        moved[i] = angles[i] + xi[start + i]
        out[start + i] = v[start + i]
    if start:
        _chart_rate(xi, v, out)
    acceleration(tree, bodies, root, moved, v, tau, _here(root, gravity, xi), work, out[nv:])


@_compile
def _turned(pose, a):
    """Return a vector of bus axes in inertial axes."""
    x = _three(pose, 3)
    y = _cross(x, a)
    return _plus(_plus(a, 2.0 * pose[6], y), 2.0, _cross(x, y))


@_compile
def _move_bus(q, xi, out):
    """Write the pose q (+) xi of the bus into ``out``."""
    x, w = _three(xi, 0), _three(xi, 3)
    square = _dot(w, w)
    _, b, c = _unit_functions(square)
    y = _cross(w, x)
    x = _turned(q, _plus(_plus(x, b, y), c, _cross(w, y)))
    out[0], out[1], out[2] = _plus(_three(q, 0), 1.0, x)
    half, t = 0.5 * _unit_functions(0.25 * square)[0], cos(0.5 * sqrt(square))
    w = (half * w[0], half * w[1], half * w[2])
    a, s = _three(q, 3), q[6]
    turned = _plus(_plus(_cross(a, w), s, w), t, a)
    last = s * t - _dot(a, w)
    size = 1.0 / sqrt(_dot(turned, turned) + last * last)
    out[3], out[4], out[5], out[6] = size * turned[0], size * turned[1], size * turned[2], size * last


@_compile
def _move(tree, root, q, xi, out):
    """Write q (+) xi into ``out``."""
    free = root[FREE] > 0.0
    if free:
        _move_bus(q, xi, out)
    start = 6 if free else 0
    for i in range(len(tree)):
        k, d = tree[i, PLACE], xi[start + i]
        if tree[i, KIND] == ENDLESS:
            c, s = cos(d), sin(d)
            x, y = q[k], q[k + 1]
            size = 1.0 / sqrt(x * x + y * y)
            out[k], out[k + 1] = size * (c * x - s * y), size * (s * x + c * y)
        else:
            out[k] = q[k] + d


@_compile
def _external_rates(bodies, root, pose, v, tau, work, factor, out):
    """Add ``factor`` times the rates of momentum about the inertial origin and of energy to ``out`` (7,).

    Right after `acceleration`, whose composite inertia of the bus says where the centre of mass is.
    """
    power, n = 0.0, len(bodies)
    free = root[FREE] > 0.0
    start = 6 if free else 0
    for i in range(len(v)):
        power += v[i] * tau[i]
    for i in range(n):
        power -= bodies[i, DAMPING] * v[start + i] ** 2
    out[6] += factor * power
    if free:
        mass, place = work[6][n, 0], _three(pose, 0)
        weight = _three(root, GRAVITY)
        weight = (mass * weight[0], mass * weight[1], mass * weight[2])
        pull = _turned(pose, _three(tau, 0))
        centre = _plus(place, 1.0 / mass, _turned(pose, (work[6][n, 1], work[6][n, 2], work[6][n, 3])))
        moment = _plus(_turned(pose, _three(tau, 3)), 1.0, _cross(place, pull))
        pull, moment = _plus(pull, 1.0, weight), _plus(moment, 1.0, _cross(centre, weight))
        for k in range(3):
            out[k] += factor * pull[k]
            out[3 + k] += factor * moment[k]


@_compile_cached
def conserved(tree, bodies, root, q, v, out):
    """Write momentum about the inertial origin, energy and kinetic energy into ``out`` (N, 8).

    For states q (N, nq), v (N, nv).
    """
    n = len(tree)
    free = root[FREE] > 0.0
    start = 6 if free else 0
    work, angles, zero = workspace(n), np.empty(n), np.zeros(7)
    zero[6] = 1.0
    for row in range(len(q)):
        gravity = _start_of_chart(tree, root, q[row], angles)
        _outward(tree, bodies, root, angles, v[row], gravity, work)
        push, spin, energy, kinetic = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0
        mass, moment = 0.0, (0.0, 0.0, 0.0)
        for i in range(n + 1):
            own, velocity = work[6][i], work[3][i]
            f, m = _wrench(own[0], _three(own, 1), _six(own, 4), _three(velocity, 0), _three(velocity, 3))
            kinetic += 0.5 * (_dot(f, _three(velocity, 0)) + _dot(m, _three(velocity, 3)))
            push, spin = _plus(push, 1.0, f), _plus(spin, 1.0, m)
            mass, moment = mass + own[0], _plus(moment, 1.0, _three(own, 1))
        for i in range(n):
            kinetic += 0.5 * bodies[i, ARMATURE] * v[row, start + i] ** 2
            energy += 0.5 * bodies[i, STIFFNESS] * angles[i] ** 2
        pose = q[row] if free else zero
        place, weight = _three(pose, 0), _three(root, GRAVITY)
        energy += kinetic - _dot(_plus(_turned(pose, moment), mass, place), weight)
        push = _turned(pose, push)
        spin = _plus(_turned(pose, spin), 1.0, _cross(place, push))
        for k in range(3):
            out[row, k], out[row, 3 + k] = push[k], spin[k]
        out[row, 6], out[row, 7] = energy, kinetic


@_compile_cached
def held_steps(tree, bodies, root, q, v, tau, h, count, gained):
    """Take ``count`` steps of ``h`` [s] by fourth-order Runge-Kutta from q[0] (nq,), v[0] (nv,), tau held.

    Writes the states into the rows that follow, and into ``gained`` (count + 1, 7) by how much momentum and
    energy should have changed since its first row; (0, 7) leaves that out. Returns how many steps were
    taken: it stops before one whose stages disagree, or that leads to a state that is not finite.
    """
    nv, n = v.shape[1], len(tree)
    free = root[FREE] > 0.0
    work, angles, moved = workspace(n), np.empty(n), np.empty(n)
    k, y, end, pose = np.empty((4, 2 * nv)), np.empty(2 * nv), np.empty(nv), np.empty(7)
    audit = len(gained) > 0
    for step in range(count):
        gravity = _start_of_chart(tree, root, q[step], angles)
        for s in range(4):
            ahead = h if s == 3 else 0.5 * h
            for i in range(nv):
                y[i] = ahead * k[s - 1, i] if s else 0.0
                y[nv + i] = v[step, i] + (ahead * k[s - 1, nv + i] if s else 0.0)
            _rate(tree, bodies, root, angles, gravity, y[:nv], y[nv:], tau, moved, work, k[s])
            if audit:
                if s == 0:
                    gained[step + 1] = gained[step]
                if free:
                    _move_bus(q[step], y, pose)
                share = h / 6.0 if s in (0, 3) else h / 3.0
                _external_rates(bodies, root, pose, y[nv:], tau, work, share, gained[step + 1])
        first, second, size = 0.0, 0.0, 0.0
        for i in range(nv):
            end[i] = h / 6.0 * (k[0, i] + 2.0 * (k[1, i] + k[2, i]) + k[3, i])
            a1, a2, a3, a4 = k[0, nv + i], k[1, nv + i], k[2, nv + i], k[3, nv + i]
            change = h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
            v[step + 1, i] = v[step, i] + change
            size += change**2
            first += (h / 6.0 * (a1 - a2 - a3 + a4)) ** 2
            second += (h / 3.0 * (a2 - a3)) ** 2
        spin = sqrt(v[step, 3] ** 2 + v[step, 4] ** 2 + v[step, 5] ** 2) if free else 0.0
        worst = max(first, second)
        if not np.isfinite(size) or (worst > max(DOUBT**2 * size, SMALL**2) and not h * spin > LOST):
            return step
        _move(tree, root, q[step], end, q[step + 1])
    return count


@_compile
def _combine(weights, count, k, scale, out):
    """Write ``scale`` times the sum of ``count`` rows of ``k`` by their weights into ``out``."""
    out[:] = 0.0
    for j in range(count):
        weight = scale * weights[j]
        for i in range(len(out)):
            out[i] += weight * k[j, i]


@_compile
def _short_step(tree, bodies, root, q, v, tau, h, scratch, k, y):
    """Take a step of Dormand and Prince from q (nq,), v (nv,); (xi, v) at its end are in ``y`` (2 nv,).

    ``k`` (7, 2 nv) are the rates at the stages and the end.
    """
    work, angles, moved = scratch
    nv = len(v)
    gravity = _start_of_chart(tree, root, q, angles)
    for s in range(STAGES + 1):
        _combine(A[s] if s < STAGES else ENDS, s, k, h, y)
        for i in range(nv):
            y[nv + i] += v[i]
        _rate(tree, bodies, root, angles, gravity, y[:nv], y[nv:], tau, moved, work, k[s])


@_compile
def _error(k, v, y, h, relative, absolute, scratch):
    """Return the error of a step in units of the tolerance."""
    nv, size = len(v), 0.0
    _combine(ERRORS, STAGES + 1, k, h, scratch)
    for i in range(2 * nv):
        before = abs(v[i - nv]) if i >= nv else 0.0
        size += (scratch[i] / (absolute + relative * max(before, abs(y[i])))) ** 2
    return sqrt(size / (2.0 * nv))


@_compile_cached
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
        h = times[at + 1] - times[at]
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
                _short_step(tree, bodies, root, place[here], speed, tau[at], h / count, scratch, k, y)
                error = _error(k, speed, y, h / count, relative, absolute, spare)
                if not error < 1.0:
                    break
                _move(tree, root, place[here], y[:nv], place[there])
                speed[:] = y[nv:]
            if error < 1.0:
                break
            if count > 1 or not error < MOST_ERROR:
                return at, step
            count = 2 + int(PARTS * error ** 0.2)
        parts[at], step = count, bound
        q[at + 1], v[at + 1] = place[count % 2], speed
    return len(times) - 1, step


@_compile_cached
def short_states(tree, bodies, root, times, q, v, tau, parts, wanted, out_q, out_v, out_a):
    """Write the states at times ``wanted`` (M,) [s] between those of `short_steps`, by taking steps again.

    ``out_q`` (M, nq), ``out_v`` and the accelerations ``out_a`` (M, nv), which are those under the tau that
    acts from a time on.
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
                _short_step(tree, bodies, root, place[here], speed[here], tau[at], h, scratch, k, y)
                _move(tree, root, place[here], y[:nv], place[there])
                speed[there] = y[nv:]
                done += 1
            x = (wanted[m] - times[at]) / h - part
            for s in range(STAGES + 1):
                weights[s] = 0.0
                for p in range(POLYNOMIAL.shape[1] - 1, -1, -1):
                    weights[s] = (weights[s] + POLYNOMIAL[s, p]) * x
            here = part % 2
            _combine(weights, STAGES + 1, k, h, y)
            _move(tree, root, place[here], y[:nv], out_q[m])
            for i in range(nv):
                out_v[m, i] = speed[here, i] + y[nv + i]
        g = _start_of_chart(tree, root, out_q[m], scratch[1])
        acceleration(tree, bodies, root, scratch[1], out_v[m], tau[at], g, scratch[0], out_a[m])
