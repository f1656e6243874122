"""Vectors, rotations and inertias as tuples of floats, for what is compiled: they stay in registers.

A spatial vector is a pair, the linear part first. An inertia is (mass, moment h, I about the origin), I as
(xx, xy, yy, xz, yz, zz).
"""

from __future__ import annotations

from math import cos, sin, sqrt

from smsid.kernel.jit import compile_inner

NEAR = 0.05  # square of an angle [rad^2] below which its functions are series


@compile_inner
def cross(a, b):
    """Return the cross product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compile_inner
def dot(a, b):
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compile_inner
def plus(a, s, b):
    """Return a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@compile_inner
def three(x, k):
    """Return three numbers of an array from k on."""
    return x[k], x[k + 1], x[k + 2]


@compile_inner
def six(x, k):
    """Return six numbers of an array from k on."""
    return x[k], x[k + 1], x[k + 2], x[k + 3], x[k + 4], x[k + 5]


@compile_inner
def matrix(x, k):
    """Return nine numbers of an array from k on as the rows of a matrix."""
    return (
        (x[k], x[k + 1], x[k + 2]),
        (x[k + 3], x[k + 4], x[k + 5]),
        (x[k + 6], x[k + 7], x[k + 8]),
    )


@compile_inner
def times_vector(m, a):
    """Return the matrix m times the vector a."""
    return dot(m[0], a), dot(m[1], a), dot(m[2], a)


@compile_inner
def times_matrix(m, n):
    """Return the product of two matrices."""
    a = (n[0][0], n[1][0], n[2][0])
    b = (n[0][1], n[1][1], n[2][1])
    c = (n[0][2], n[1][2], n[2][2])
    return (
        (dot(m[0], a), dot(m[0], b), dot(m[0], c)),
        (dot(m[1], a), dot(m[1], b), dot(m[1], c)),
        (dot(m[2], a), dot(m[2], b), dot(m[2], c)),
    )


@compile_inner
def transposed(m):
    """Return the transpose of a matrix."""
    return (
        (m[0][0], m[1][0], m[2][0]),
        (m[0][1], m[1][1], m[2][1]),
        (m[0][2], m[1][2], m[2][2]),
    )


@compile_inner
def turn_about(axis, angle):
    """Return the rotation about a unit vector."""
    c, s = cos(angle), sin(angle)
    x, y, z = axis
    d = 1.0 - c
    return (
        (c + d * x * x, d * x * y - s * z, d * x * z + s * y),
        (d * x * y + s * z, c + d * y * y, d * y * z - s * x),
        (d * x * z - s * y, d * y * z + s * x, c + d * z * z),
    )


@compile_inner
def turned_inertia(m, i):
    """Return R I R' of I = (xx, xy, yy, xz, yz, zz)."""
    full = ((i[0], i[1], i[3]), (i[1], i[2], i[4]), (i[3], i[4], i[5]))
    a, b, c = (
        times_vector(full, m[0]),
        times_vector(full, m[1]),
        times_vector(full, m[2]),
    )  # full is symmetric
    return dot(m[0], a), dot(m[1], a), dot(m[1], b), dot(m[2], a), dot(m[2], b), dot(m[2], c)


@compile_inner
def by_inertia(i, a):
    """Return I a of I = (xx, xy, yy, xz, yz, zz)."""
    return (
        i[0] * a[0] + i[1] * a[1] + i[3] * a[2],
        i[1] * a[0] + i[2] * a[1] + i[4] * a[2],
        i[3] * a[0] + i[4] * a[1] + i[5] * a[2],
    )


@compile_inner
def wrench(mass, moment, inertia, linear, angular):
    """Return the inertia (mass, moment h, I about the origin) times a spatial vector."""
    return (
        plus(cross(angular, moment), mass, linear),
        plus(cross(moment, linear), 1.0, by_inertia(inertia, angular)),
    )


@compile_inner
def bearing_force(mass, moment, inertia, velocity, spin, acceleration, turning):
    """Return the force I a + V x* (I V) of a body on its bearing."""
    p, k = wrench(mass, moment, inertia, velocity, spin)
    f, n = wrench(mass, moment, inertia, acceleration, turning)
    return (
        plus(f, 1.0, cross(spin, p)),
        plus(plus(n, 1.0, cross(velocity, p)), 1.0, cross(spin, k)),
    )


@compile_inner
def about_origin(mass, moment, inertia, place):
    """Return moment and inertia about the origin of a body whose own are about a place."""
    x, y, z = place
    a, b, c = moment
    # I + (2 p h + m p p) 1 - p h' - h p' - m p p'
    whole = 2.0 * dot(place, moment) + mass * dot(place, place)
    return plus(moment, mass, place), (
        inertia[0] + whole - 2.0 * x * a - mass * x * x,
        inertia[1] - x * b - a * y - mass * x * y,
        inertia[2] + whole - 2.0 * y * b - mass * y * y,
        inertia[3] - x * c - a * z - mass * x * z,
        inertia[4] - y * c - b * z - mass * y * z,
        inertia[5] + whole - 2.0 * z * c - mass * z * z,
    )


@compile_inner
def put(x, first, more):
    """Write two vectors, one after the other, into an array."""
    x[0], x[1], x[2] = first
    x[3], x[4], x[5] = more


@compile_inner
def bracket(v, w, a, b):
    """Return the Lie bracket of the spatial vectors (v, w) and (a, b)."""
    return plus(cross(w, a), 1.0, cross(v, b)), cross(w, b)


@compile_inner
def unit_functions(square):
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


@compile_inner
def turned(pose, a):
    """Return a vector of bus axes in inertial axes."""
    x = three(pose, 3)
    y = cross(x, a)
    return plus(plus(a, 2.0 * pose[6], y), 2.0, cross(x, y))
