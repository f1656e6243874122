"""The configuration of a tree, and its motion in a chart q = q_0 (+) xi (Munthe-Kaas)."""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np

from smsid.kernel._spatial import NEAR, bracket, cross, dot, plus, three, turned, unit_functions
from smsid.kernel._tree import acceleration
from smsid.kernel.columns import ATTITUDE, BEGUN, ENDLESS, FORCES, FREE, GRAVITY, KIND, PLACE
from smsid.kernel.jit import compile_inner


@compile_inner
def chart_rate(xi, v, out):
    """Write the rate of the chart's pose xi (6,) under the body velocity v (6,): Jlog6(exp6(xi)) v."""
    x, w = three(xi, 0), three(xi, 3)
    a, b = three(v, 0), three(v, 3)
    square = dot(w, w)
    a1, b1 = bracket(x, w, a, b)
    a2, b2 = bracket(x, w, a1, b1)
    a3, b3 = bracket(x, w, a2, b2)
    a4, b4 = bracket(x, w, a3, b3)
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


@compile_inner
def start_of_chart(tree, root, q, angles):
    """Read the joints' angles from q; return gravity in bus axes."""
    start = 7 if root[FREE] > 0.0 else 0
    if start and root[FORCES] > 0.0:
        for k in range(4):
            root[BEGUN + k] = root[ATTITUDE + k] = q[3 + k]
    for i in range(len(tree)):
        k = tree[i, PLACE]
        angles[i] = np.arctan2(q[k + 1], q[k]) if tree[i, KIND] == ENDLESS else q[k]
    g = three(root, GRAVITY)
    if start == 0 or (g[0] == 0.0 and g[1] == 0.0 and g[2] == 0.0):
        return g
    x = three(q, 3)
    y = cross(x, g)  # by the conjugate quaternion
    return plus(plus(g, -2.0 * q[6], y), 2.0, cross(x, y))


@compile_inner
def gravity_here(root, gravity, xi):
    """Return gravity in the axes of the bus that has moved by xi in its chart."""
    if root[FREE] == 0.0 or (gravity[0] == 0.0 and gravity[1] == 0.0 and gravity[2] == 0.0):
        return gravity
    w = three(xi, 3)
    a, b, _ = unit_functions(dot(w, w))
    y = cross(w, gravity)
    return plus(plus(gravity, -a, y), b, cross(w, y))


@compile_inner
def chart_velocity(tree, bodies, root, angles, gravity, xi, v, tau, moved, work, out):
    """Write the rate of (xi, v) (2 nv,) in the chart about ``angles`` into ``out``."""
    nv = len(v)
    start = 6 if root[FREE] > 0.0 else 0
    for i in range(len(tree)):
        moved[i] = angles[i] + xi[start + i]
        out[start + i] = v[start + i]
    if start:
        chart_rate(xi, v, out)
        if root[FORCES] > 0.0:
            e, last = turn_ahead(three(root, BEGUN), root[BEGUN + 3], three(xi, 3))
            root[ATTITUDE], root[ATTITUDE + 1], root[ATTITUDE + 2] = e
            root[ATTITUDE + 3] = last
    acceleration(tree, bodies, root, moved, v, tau, gravity_here(root, gravity, xi), work, out[nv:])


@compile_inner
def turn_ahead(a, s, w):
    """Return vector and scalar of a quaternion (a, s), turned by the rotation vector w of its own axes."""
    square = dot(w, w)
    half, t = 0.5 * unit_functions(0.25 * square)[0], cos(0.5 * sqrt(square))
    w = (half * w[0], half * w[1], half * w[2])
    return plus(plus(cross(a, w), s, w), t, a), s * t - dot(a, w)


@compile_inner
def move_bus(q, xi, out):
    """Write the pose q (+) xi of the bus into ``out``."""
    x, w = three(xi, 0), three(xi, 3)
    square = dot(w, w)
    _, b, c = unit_functions(square)
    y = cross(w, x)
    x = turned(q, plus(plus(x, b, y), c, cross(w, y)))
    out[0], out[1], out[2] = plus(three(q, 0), 1.0, x)
    a, s = three(q, 3), q[6]
    e, last = turn_ahead(a, s, w)
    size = 1.0 / sqrt(dot(e, e) + last * last)
    if dot(e, a) + last * s < 0.0:  # of the two quaternions the nearer one
        size = -size
    out[3], out[4], out[5], out[6] = size * e[0], size * e[1], size * e[2], size * last


@compile_inner
def move(tree, root, q, xi, out):
    """Write q (+) xi into ``out``."""
    free = root[FREE] > 0.0
    if free:
        move_bus(q, xi, out)
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
