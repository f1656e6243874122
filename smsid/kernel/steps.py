"""Fixed steps of fourth-order Runge-Kutta under held generalised forces, with their audit."""

from __future__ import annotations

from math import sqrt

import numpy as np

from smsid.kernel._forces import add_forces, add_tides
from smsid.kernel._motion import chart_velocity, move, move_bus, start_of_chart
from smsid.kernel._spatial import cross, dot, plus, six, three, turned, wrench
from smsid.kernel._tree import outward, workspace
from smsid.kernel.columns import ARMATURE, DAMPING, FORCES, FREE, GRAVITY, STIFFNESS, TIME
from smsid.kernel.jit import compile_inner, compiled_and_cached

DOUBT = 0.05  # of the change of the velocities; a motion of frequency w has (w h)^2 / 12
SMALL = 1e-6  # [m/s, rad/s] error of the velocities that does not count
LOST = 1.0  # [rad] turn of the bus in a step
WITHIN = 1e-9  # of a step, by which its ends are taken within: what begins or ends there is of one side


@compile_inner
def external_rates(bodies, root, pose, angles, v, tau, work, factor, out):
    """Add ``factor`` times the rates of momentum about the inertial origin and of energy to ``out`` (7,).

    Right after `acceleration`, whose composite inertia of the bus says where the centre of mass is.
    """
    power, n = 0.0, len(bodies)
    free = root[FREE] > 0.0
    start = 6 if free else 0
    if root[FORCES] > 0.0:
        applied, tau = tau, tau.copy()
        add_forces(root, angles, v, applied, 1.0, tau)
        add_tides(root, work, 1.0, tau)
    for i in range(len(v)):
        power += v[i] * tau[i]
    for i in range(n):
        power -= bodies[i, DAMPING] * v[start + i] ** 2
    out[6] += factor * power
    if free:
        mass, place = work[6][n, 0], three(pose, 0)
        weight = three(root, GRAVITY)
        weight = (mass * weight[0], mass * weight[1], mass * weight[2])
        pull = turned(pose, three(tau, 0))
        centre = plus(place, 1.0 / mass, turned(pose, (work[6][n, 1], work[6][n, 2], work[6][n, 3])))
        moment = plus(turned(pose, three(tau, 3)), 1.0, cross(place, pull))
        pull, moment = plus(pull, 1.0, weight), plus(moment, 1.0, cross(centre, weight))
        for k in range(3):
            out[k] += factor * pull[k]
            out[3 + k] += factor * moment[k]


@compiled_and_cached
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
        gravity = start_of_chart(tree, root, q[row], angles)
        outward(tree, bodies, root, angles, v[row], work[10], gravity, work)
        push, spin, energy, kinetic = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0
        mass, moment = 0.0, (0.0, 0.0, 0.0)
        for i in range(n + 1):
            own, velocity = work[6][i], work[3][i]
            f, m = wrench(own[0], three(own, 1), six(own, 4), three(velocity, 0), three(velocity, 3))
            kinetic += 0.5 * (dot(f, three(velocity, 0)) + dot(m, three(velocity, 3)))
            push, spin = plus(push, 1.0, f), plus(spin, 1.0, m)
            mass, moment = mass + own[0], plus(moment, 1.0, three(own, 1))
        for i in range(n):
            kinetic += 0.5 * bodies[i, ARMATURE] * v[row, start + i] ** 2
            energy += 0.5 * bodies[i, STIFFNESS] * angles[i] ** 2
        pose = q[row] if free else zero
        place, weight = three(pose, 0), three(root, GRAVITY)
        energy += kinetic - dot(plus(turned(pose, moment), mass, place), weight)
        push = turned(pose, push)
        spin = plus(turned(pose, spin), 1.0, cross(place, push))
        for k in range(3):
            out[row, k], out[row, 3 + k] = push[k], spin[k]
        out[row, 6], out[row, 7] = energy, kinetic


@compiled_and_cached
def held_steps(tree, bodies, root, q, v, tau, h, count, gained):
    """Take ``count`` steps of ``h`` [s] by fourth-order Runge-Kutta from q[0] (nq,), v[0] (nv,), tau held.

    Writes the states into the rows that follow, and into ``gained`` (count + 1, 7) by how much momentum and
    energy should have changed since its first row; (0, 7) leaves that out. Returns how many steps were
    taken: it stops before one whose stages disagree, or that leads to a state that is not finite. The time is
    that in ``root`` at first.
    """
    nv, n = v.shape[1], len(tree)
    free = root[FREE] > 0.0
    work, angles, moved = workspace(n), np.empty(n), np.empty(n)
    k, y, end, pose = np.empty((4, 2 * nv)), np.empty(2 * nv), np.empty(nv), np.empty(7)
    audit, began = len(gained) > 0, root[TIME]
    for step in range(count):
        gravity = start_of_chart(tree, root, q[step], angles)
        for s in range(4):
            ahead = h if s == 3 else 0.5 * h
            place = 1.0 - WITHIN if s == 3 else 0.5 if s else WITHIN
            root[TIME] = began + (step + place) * h
            for i in range(nv):
                y[i] = ahead * k[s - 1, i] if s else 0.0
                y[nv + i] = v[step, i] + (ahead * k[s - 1, nv + i] if s else 0.0)
            chart_velocity(tree, bodies, root, angles, gravity, y[:nv], y[nv:], tau, moved, work, k[s])
            if audit:
                if s == 0:
                    gained[step + 1] = gained[step]
                if free:
                    move_bus(q[step], y, pose)
                share = h / 6.0 if s in (0, 3) else h / 3.0
                external_rates(bodies, root, pose, moved, y[nv:], tau, work, share, gained[step + 1])
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
        move(tree, root, q[step], end, q[step + 1])
    return count
