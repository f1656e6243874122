"""A whole flight under the model-based controller (43), (46): sensors, law, wheels, spacecraft.

What it cannot do it leaves to its caller, sample by sample: redundant wheels at their limit, an attitude
error near half a turn, steps whose stages disagree.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from smsid.kernel._motion import start_of_chart
from smsid.kernel._spatial import cross, dot, plus, three, times_vector, transposed
from smsid.kernel._tree import assemble, workspace
from smsid.kernel.columns import TIME
from smsid.kernel.jit import compile_inner, compiled_and_cached
from smsid.kernel.steps import held_steps

ATTITUDE, SPIN = 0, 9  # columns of what is seen: a rotation, rates, then joint angles, their rates, wheels'
FLOWN, COMMAND, STEP = range(3)  # why a flight ends: it is done, a command or a step is left to the caller


class Law(NamedTuple):
    """The controller: its tree (as of the spacecraft, without springs), rows there of arm joints and wheels,
    gains (s, s), the robust term sampled, and the reference (N, 3, s) with its derivatives.
    """

    tree: np.ndarray
    bodies: np.ndarray
    root: np.ndarray
    arm: np.ndarray
    wheels: np.ndarray
    proportional: np.ndarray
    derivative: np.ndarray
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: np.ndarray
    reference: np.ndarray
    smallest: float  # of the quaternion's last component


class Craft(NamedTuple):
    """Rows of arm joints and wheels in the spacecraft's tree; ``share`` (w, 3) from torques on the base to
    motors; limits of motors (w,) and joints (n,); inertia (w,) about the axes.
    """

    arm: np.ndarray
    wheels: np.ndarray
    share: np.ndarray
    torque: np.ndarray
    rate: np.ndarray
    effort: np.ndarray
    inertia: np.ndarray


class Senses(NamedTuple):
    """What sensors do at every sample: errors (N, m) of what is seen (m,), of the attitude as a rotation;
    ``source`` (N, 5) the sample each of attitude, rates, angles, joint and wheel rates is of, or -1: as
    before; ``mix`` (m, m) scale and misalignment; ``bound`` and ``grain`` (m,).
    """

    errors: np.ndarray
    source: np.ndarray
    mix: np.ndarray
    bound: np.ndarray
    grain: np.ndarray


class Path(NamedTuple):
    """A flight of N samples: q (N hold + 1, nq), v (N hold + 1, nv), what perfect sensors and the real ones
    see (N, m), generalised forces asked for (N, nv), state of the robust term, counts of limits (2 w + n,).
    """

    q: np.ndarray
    v: np.ndarray
    exact: np.ndarray
    seen: np.ndarray
    asked: np.ndarray
    state: np.ndarray
    hits: np.ndarray


@compile_inner
def look(root, tree, craft, q, v, angles, out):
    """Write what perfect sensors see of a state into ``out``."""
    start_of_chart(tree, root, q, angles)
    x, y, z, w = q[3], q[4], q[5], q[6]
    out[0], out[1], out[2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    out[3], out[4], out[5] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    out[6], out[7], out[8] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    out[9], out[10], out[11] = v[3], v[4], v[5]
    n = len(craft.arm)
    for k in range(n):
        out[12 + k], out[12 + n + k] = angles[craft.arm[k]], v[6 + craft.arm[k]]
    for k in range(len(craft.wheels)):
        out[12 + 2 * n + k] = v[6 + craft.wheels[k]]


@compile_inner
def sense(senses, exact, i, n, seen):
    """Write what sensors report at sample i into ``seen[i]``; ``exact`` (N, m) are the states so far."""
    edges = (0, 9, 12, 12 + n, 12 + 2 * n, seen.shape[1])
    for s in range(5):
        begin, end, at = edges[s], edges[s + 1], senses.source[i, s]
        if at < 0:
            seen[i, begin:end] = seen[i - 1, begin:end]
        elif s == 0:
            for r in range(3):
                for c in range(3):
                    total = 0.0
                    for k in range(3):
                        total += exact[at, 3 * r + k] * senses.errors[i, 3 * k + c]
                    seen[i, 3 * r + c] = total
        else:
            for c in range(begin, end):
                total = senses.errors[i, c]
                for k in range(begin, end):
                    total += exact[at, k] * senses.mix[k, c]
                total = min(max(total, -senses.bound[c]), senses.bound[c])
                grain = senses.grain[c]
                seen[i, c] = np.round(total / grain) * grain if grain > 0.0 else total


@compile_inner
def quaternion_of(m):
    """Return the unit quaternion x y z w, w >= 0, of a rotation."""
    a, b, c = m[0][0], m[1][1], m[2][2]
    trace = a + b + c
    if trace >= a and trace >= b and trace >= c:
        x, y, z, w = m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 1.0 + trace
    elif a >= b and a >= c:
        x, y, z, w = 1.0 - trace + 2.0 * a, m[1][0] + m[0][1], m[2][0] + m[0][2], m[2][1] - m[1][2]
    elif b >= c:
        x, y, z, w = m[1][0] + m[0][1], 1.0 - trace + 2.0 * b, m[2][1] + m[1][2], m[0][2] - m[2][0]
    else:
        x, y, z, w = m[0][2] + m[2][0], m[2][1] + m[1][2], 1.0 - trace + 2.0 * c, m[1][0] - m[0][1]
    size = 1.0 / sqrt(x * x + y * y + z * z + w * w)
    if w < 0.0:
        size = -size
    return size * x, size * y, size * z, size * w


@compile_inner
def wanted_acceleration(law, i, seen, state, spare, wanted):
    """Write the acceleration (s,) that the law asks for, base in body axes; return whether there is one.

    ``state`` of the robust term is moved on, except where there is none.
    """
    size = len(wanted)
    x, dx, ddx = law.reference[i, 0], law.reference[i, 1], law.reference[i, 2]
    cr, cp, cy = np.cos(x[0]), np.cos(x[1]), np.cos(x[2])
    sr, sp, sy = np.sin(x[0]), np.sin(x[1]), np.sin(x[2])
    dr, dp = dx[0], dx[1]
    jacobian = ((1.0, 0.0, -sp), (0.0, cr, cp * sr), (0.0, -sr, cp * cr))
    change = (
        (0.0, 0.0, -cp * dp),
        (0.0, -sr * dr, -sp * sr * dp + cp * cr * dr),
        (0.0, -cr * dr, -sp * cr * dp - cp * sr * dr),
    )
    rate_d = times_vector(jacobian, three(dx, 0))
    acceleration_d = plus(times_vector(jacobian, three(ddx, 0)), 1.0, times_vector(change, three(dx, 0)))
    # columns of the reference's rotation
    d0 = (cy * cp, sy * cp, -sp)
    d1 = (cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr)
    d2 = (cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr)
    b0, b1, b2 = (seen[0], seen[3], seen[6]), (seen[1], seen[4], seen[7]), (seen[2], seen[5], seen[8])
    relative = (
        (dot(d0, b0), dot(d0, b1), dot(d0, b2)),
        (dot(d1, b0), dot(d1, b1), dot(d1, b2)),
        (dot(d2, b0), dot(d2, b1), dot(d2, b2)),
    )
    ex, ey, ez, w = quaternion_of(relative)
    if not w >= law.smallest:
        return False
    e, omega, back = (ex, ey, ez), three(seen, SPIN), transposed(relative)
    reached = times_vector(back, rate_d)
    slip = plus(omega, -1.0, reached)
    moved = plus(cross(e, slip), w, slip)  # rate of twice the vector part
    n = size - 3
    error, rate = spare[:size], spare[size : 2 * size]
    error[0], error[1], error[2] = -2.0 * ex, -2.0 * ey, -2.0 * ez
    rate[0], rate[1], rate[2] = -moved[0], -moved[1], -moved[2]
    for k in range(n):
        error[3 + k] = x[3 + k] - seen[12 + k]
        rate[3 + k] = dx[3 + k] - seen[12 + n + k]
    for r in range(size):
        total = 0.0
        for c in range(size):
            total += law.derivative[r, c] * rate[c] + law.proportional[r, c] * error[c]
        wanted[r] = total
    order = len(state)
    if order:
        for r in range(size):
            for c in range(order):
                wanted[r] -= law.c[r, c] * state[c]
            for c in range(2 * size):
                wanted[r] -= law.d[r, c] * spare[c]
        new = spare[2 * size : 2 * size + order]
        for r in range(order):
            total = 0.0
            for c in range(order):
                total += law.a[r, c] * state[c]
            for c in range(2 * size):
                total += law.b[r, c] * spare[c]
            new[r] = total
        state[:] = new
    # from twice the vector part back to the base's rate: (w I + [e]x)^-1 = (w I + [e]x)' + e e' / w
    turning = -0.5 * dot(e, slip)
    bias = plus(plus((0.0, 0.0, 0.0), turning, slip), 0.5, cross(moved, slip))
    pull = plus(three(wanted, 0), -1.0, bias)
    base = plus(plus(cross(pull, e), w, pull), dot(e, pull) / w, e)
    base = plus(plus(base, 1.0, times_vector(back, acceleration_d)), -1.0, cross(omega, reached))
    wanted[0], wanted[1], wanted[2] = base
    for k in range(n):
        wanted[3 + k] += ddx[3 + k]
    return True


@compile_inner
def solve_dense(a, x):
    """Solve a x = b, b in ``x``, by elimination with row exchange; return whether a is regular."""
    n = len(x)
    for k in range(n):
        best = k
        for r in range(k + 1, n):
            if abs(a[r, k]) > abs(a[best, k]):
                best = r
        if a[best, k] == 0.0:
            return False
        if best != k:
            for c in range(k, n):
                a[k, c], a[best, c] = a[best, c], a[k, c]
            x[k], x[best] = x[best], x[k]
        for r in range(k + 1, n):
            share = a[r, k] / a[k, k]
            if share != 0.0:
                for c in range(k, n):
                    a[r, c] -= share * a[k, c]
                x[r] -= share * x[k]
    for k in range(n - 1, -1, -1):
        for c in range(k + 1, n):
            x[k] -= a[k, c] * x[c]
        x[k] /= a[k, k]
    return True


@compile_inner
def command_of(law, craft, seen, wanted, work, angles, v, a, bias, full, system, x, out):
    """Write wheel torques on the base and joint torques (s,) that give the wanted acceleration (s,).

    No force acts from outside: the base's six rows are zero with the torques inside, and give the base's
    linear acceleration, those of the wheels and the torque on the base.
    """
    n, w, joints = len(law.arm), len(law.wheels), len(law.tree)
    v[:], a[:] = 0.0, 0.0
    for k in range(3):
        v[3 + k], a[3 + k] = seen[SPIN + k], wanted[k]
    for k in range(n):
        row = law.arm[k]
        angles[row], v[6 + row], a[6 + row] = seen[12 + k], seen[12 + n + k], wanted[3 + k]
    for k in range(w):
        row = law.wheels[k]
        angles[row], v[6 + row] = 0.0, seen[12 + 2 * n + k]
    zero = (0.0, 0.0, 0.0)
    full[:] = 0.0
    assemble(law.tree, law.bodies, law.root, angles, v, a, zero, work, bias)
    mass, coupling, whole = work[7], work[8], work[9]
    for r in range(6):
        for c in range(r + 1):
            full[r, c] = full[c, r] = whole[r, c]
    for i in range(joints):
        for c in range(6):
            full[6 + i, c] = full[c, 6 + i] = coupling[i, c]
        full[6 + i, 6 + i] = mass[i, i]
        j = law.tree[i, 0]
        while j >= 0:
            full[6 + i, 6 + j] = full[6 + j, 6 + i] = mass[i, j]
            j = law.tree[j, 0]
    # what is needed without the unknowns; `bias` holds a less the bias forces
    for r in range(6 + joints):
        needed = a[r] - bias[r]
        for c in range(3, 6 + joints):
            needed += full[r, c] * a[c]
        bias[r] = needed
    system[:] = 0.0
    for r in range(6 + w):
        row = r if r < 6 else 6 + law.wheels[r - 6]
        for c in range(3):
            system[r, c] = full[row, c]
            if r >= 6:
                system[r, 3 + w + c] = craft.share[r - 6, c]
        for c in range(w):
            system[r, 3 + c] = full[row, 6 + law.wheels[c]]
        x[r] = -bias[row]
    if not solve_dense(system, x):
        return False
    for k in range(3):
        out[k] = x[3 + w + k]
    for k in range(n):
        row = 6 + law.arm[k]
        out[3 + k] = bias[row]
        for c in range(3):
            out[3 + k] += full[row, c] * x[c]
        for c in range(w):
            out[3 + k] += full[row, 6 + law.wheels[c]] * x[3 + c]
    return True


@compile_inner
def drive(craft, command, v, period, motors, hits, out):
    """Write the generalised forces of a command (s,) within the limits into ``out`` (nv,).

    As `smsid.control._wheels.WheelLayout.allocate`; ``hits`` (2 w + n,) counts torque and rate limits of
    wheels and those of joints. Returns whether it could: redundant wheels at their torque could share it.
    """
    w, n, largest = len(craft.wheels), len(craft.arm), 0.0
    for k in range(w):
        motors[k] = -dot(three(craft.share[k], 0), three(command, 0))
        largest = max(largest, abs(motors[k]) / craft.torque[k])
    if not largest <= 1.0 + 1e-12:
        if w > 3 or not np.isfinite(largest):
            return False
        for k in range(w):
            hits[k] += abs(motors[k]) >= craft.torque[k] * (1.0 + 1e-9)
            motors[k] /= largest
    out[:] = 0.0
    for k in range(w):
        row, most = 6 + craft.wheels[k], craft.torque[k]
        room = craft.inertia[k] / period
        low = min(max(-most, room * (-craft.rate[k] - v[row])), most)
        high = max(min(most, room * (craft.rate[k] - v[row])), -most)
        out[row] = min(max(motors[k], low), high)
        hits[w + k] += abs(out[row] - motors[k]) > 1e-12 * (1.0 + abs(motors[k]))
    for k in range(n):
        row, most = 6 + craft.arm[k], craft.effort[k]
        out[row] = min(max(command[3 + k], -most), most)
        hits[2 * w + k] += out[row] != command[3 + k]
    return True


@compiled_and_cached
def fly(tree, bodies, root, law, craft, senses, h, hold, delay, path, begin, given):
    """Fly from sample ``begin`` on; return the sample where it ends, and why: `FLOWN`, `COMMAND` or `STEP`.

    Fills the `Path` from the row of the sample on. What is asked for acts ``delay`` samples later; with
    ``given`` it is there already at the first sample. Steps are of ``h`` [s], ``hold`` of them a sample. The
    time is that in ``root`` at first.
    """
    q, v, exact, seen, asked, state, hits = path
    count, nv, n, w = len(asked), v.shape[1], len(craft.arm), len(craft.wheels)
    size, joints = 3 + n, len(law.tree)
    angles, work = np.empty(len(tree)), workspace(joints)
    spare, wanted, command = np.empty(2 * size + len(state)), np.empty(size), np.empty(size)
    places, speed, motors = np.zeros(joints), np.empty(6 + joints), np.empty(w)
    a, bias = np.empty(6 + joints), np.empty(6 + joints)
    full, system, x = np.empty((6 + joints, 6 + joints)), np.empty((6 + w, 6 + w)), np.empty(6 + w)
    kept, rest = np.empty((0, 7)), np.zeros(nv)
    before, began = np.empty(len(state)), root[TIME]
    for i in range(begin, count):
        row = i * hold
        if i > begin or not given:
            look(root, tree, craft, q[row], v[row], angles, exact[i])
            sense(senses, exact, i, n, seen)
            before[:] = state
            good = wanted_acceleration(law, i, seen[i], state, spare, wanted)
            if good:
                good = command_of(
                    law, craft, seen[i], wanted, work, places, speed, a, bias, full, system, x, command
                )
            if not good or not drive(craft, command, v[row], h * hold, motors, hits, asked[i]):
                state[:] = before
                return i, COMMAND
        tau = asked[i - delay] if i >= delay else rest
        root[TIME] = began + (i - begin) * hold * h
        if held_steps(tree, bodies, root, q[row:], v[row:], tau, h, hold, kept) < hold:
            return i, STEP
    return count, FLOWN
