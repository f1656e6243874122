"""The extended Kalman filter over samples: linearise, read, correct, go on; parameters in its state, or none.

What is computed, and in which order, is that of `smsid.estimation.filter_pass.run_plain`.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from smsid.kernel import columns
from smsid.kernel._forces import take_force_derivatives
from smsid.kernel._motion import chart_velocity, move, start_of_chart
from smsid.kernel._tree import acceleration, workspace
from smsid.kernel.columns import FORCES, FREE, TIME
from smsid.kernel.covariance import (
    add_square,
    carry_trends,
    correct,
    inverse_of_root,
    multiply,
    spread,
    transition,
    transposed_into,
)
from smsid.kernel.derivatives import derivatives, inverse_dynamics
from smsid.kernel.jit import compile_inner, compiled_and_cached
from smsid.kernel.readings import ATTITUDE, add_twists, read, residual, rotation_vector

BACK = 2  # times that a late reading is carried back: a third would change it by the fifth order of its delay
DONE = -1  # what `run` returns where no sample was lost


@compile_inner
def linearise(tree, bodies, root, q, v, tau, scratch, a, by_q, by_v, inverse, angles):
    """Write accelerations (nv,), their derivatives by q and v, M^-1 and joint angles; return gravity."""
    own, mass, force_q, force_v, low, half, turned = scratch
    gravity = start_of_chart(tree, root, q, angles)
    acceleration(tree, bodies, root, angles, v, tau, gravity, own[0], a)
    derivatives(tree, bodies, root, angles, v, a, gravity, own, mass, force_q, force_v)
    if root[FORCES] > 0.0:
        take_force_derivatives(root, angles, v, tau, force_q, force_v)
    inverse_of_root(mass, low, half)
    transposed_into(half, turned)
    multiply(turned, half, inverse)
    multiply(inverse, force_q, by_q)
    multiply(inverse, force_v, by_v)
    for r in range(len(v)):
        for c in range(len(v)):
            by_q[r, c], by_v[r, c] = -by_q[r, c], -by_v[r, c]
    return gravity


@compile_inner
def by_parameters(tree, bodies, roots, terms, weights, pushed, push, at, inverse, work, force, out):
    """Write how accelerations change with parameters (nv, m) into ``out``; ``at``: angles, v, a, gravity."""
    angles, v, a, gravity = at
    changes = np.zeros(out.shape)
    for k in range(len(terms)):
        table, i = terms[k, 0], terms[k, 1]
        roots[table, columns.ATTITUDE : columns.BEGUN] = roots[0, columns.ATTITUDE : columns.BEGUN]
        inverse_dynamics(tree, bodies[table], roots[table], angles, v, a, gravity, work[10], work, force)
        for c in range(len(v)):
            changes[c, i] -= weights[k] * force[c]
    for k in range(len(pushed)):
        for c in range(len(v)):
            changes[c, pushed[k]] += push[k, c]
    multiply(inverse, changes, out)


@compile_inner
def reference(tree, root, state, at, scales, close, regular, acts, sloped, off, q, v, driving, climb):
    """Write where the filter is linear: the mean of the state given the model's own parameters.

    ``off`` (x,) is how far what is believed is from there; q (nq,), v (nv,), unknown forces (nv,) and by how
    much these ``climb`` in a second.
    Parameters within ``close`` (m,) standard deviations are there already; ``regular`` keeps a covariance so.
    Those with infinitely many, biases, no motion knows: it is linear about the one that is believed of them.
    """
    m, nv, p = len(at), len(v), state.covariance
    first, far = len(p) - m, False
    off[:], driving[:], climb[:] = 0.0, 0.0, 0.0
    for i in range(m):
        off[first + i] = (state.values[i] - at[i]) / scales[i]
        far = far or abs(off[first + i]) > close[i] * sqrt(p[first + i, first + i])
    if far:
        size, own, low, half = np.empty(m), np.empty((m, m)), np.empty((m, m)), np.empty((m, m))
        for i in range(m):
            size[i] = sqrt(max(p[first + i, first + i], 1e-300))
        for i in range(m):
            for j in range(m):
                both = close[i] < np.inf and close[j] < np.inf
                own[i, j] = p[first + i, first + j] / (size[i] * size[j]) if both else 0.0
            own[i, i] += regular if close[i] < np.inf else 1.0
        if inverse_of_root(own, low, half):
            white, step = np.zeros(m), np.zeros(m)
            for i in range(m):
                for j in range(i + 1):
                    if close[j] < np.inf:
                        white[i] += half[i, j] * off[first + j] / size[j]
            for i in range(m):
                for j in range(i, m):
                    step[i] += half[j, i] * white[j] / size[i]
            for i in range(first):
                for j in range(m):
                    off[i] += p[i, first + j] * step[j]
    back = np.empty(nv)
    for i in range(nv):
        back[i], v[i] = -off[i], state.v[i] - off[nv + i]
    move(tree, root, state.q, back, q)
    for i in range(len(acts)):
        driving[acts[i]] += state.unknown[i] - off[2 * nv + i]
    for j in range(len(sloped)):
        own = len(acts) + j
        climb[acts[sloped[j]]] += state.unknown[own] - off[2 * nv + own]


@compile_inner
def step_ahead(tree, bodies, root, q, v, tau, rise, h, stages, out_q):
    """Go on by h [s] by Runge and Kutta, forces from ``tau - rise`` to ``tau + rise``; v in place."""
    work, angles, moved, k, y, force = stages
    nv, began = len(v), root[TIME]
    gravity = start_of_chart(tree, root, q, angles)
    for s in range(4):
        ahead = 0.0 if s == 0 else h if s == 3 else 0.5 * h
        side = -1.0 if s == 0 else 1.0 if s == 3 else 0.0
        root[TIME] = began + ahead
        for i in range(nv):
            y[i] = ahead * k[s - 1, i] if s else 0.0
            y[nv + i] = v[i] + (ahead * k[s - 1, nv + i] if s else 0.0)
            force[i] = tau[i] + side * rise[i]
        chart_velocity(tree, bodies, root, angles, gravity, y[:nv], y[nv:], force, moved, work, k[s])
    for i in range(nv):
        y[i] = h / 6.0 * (k[0, i] + 2.0 * (k[1, i] + k[2, i]) + k[3, i])
        v[i] += h / 6.0 * (k[0, nv + i] + 2.0 * (k[1, nv + i] + k[2, nv + i]) + k[3, nv + i])
    move(tree, root, q, y[:nv], out_q)


@compiled_and_cached
def steps_ahead(tree, bodies, root, edges, q, v, means, rise):
    """Replace q (n, nq) and v (n, nv) at ``edges`` [s] by those at the next, each from its own, under forces
    ``means`` and their half ``rise`` (n, substeps, nv).
    """
    n, count, nv, joints = means.shape[0], means.shape[1], v.shape[1], len(tree)
    stages = (
        workspace(joints), np.empty(joints), np.empty(joints), np.empty((4, 2 * nv)), np.empty(2 * nv),
        np.empty(nv),
    )  # fmt: skip
    moved = np.empty(q.shape[1])
    for k in range(n):
        h = (edges[k + 1] - edges[k]) / count
        for s in range(count):
            root[TIME] = edges[k] + s * h
            step_ahead(tree, bodies, root, q[k], v[k], means[k, s], rise[k, s], h, stages, moved)
            q[k] = moved


@compile_inner
def read_all(tree, bodies, root, senses, t, q, v, a, angles, gravity, sides, derive, out, spare, work):
    """Write what sensors number ``t`` read of a state, also late ones, and if asked the derivatives.

    A late one reads the state carried back by its delay, under the forces just before the sample; one that is
    early, under those just after it: ``sides`` (2, nv); as `smsid.estimation.filter_pass.predict_delayed`.
    """
    h, by_q, by_v, by_a = out
    read(senses, t, root, q, v, a, angles, gravity, derive, h, by_q, by_v, by_a)
    old, old_q, old_v, old_a, far, rate, back, behind, there = spare
    now = root[TIME]
    for i in range(len(senses.late)):
        first, count = senses.late[i, 0], senses.late[i, 1]
        delay = senses.delay[t, first]
        if delay == 0.0:
            continue
        force = sides[0] if delay > 0.0 else sides[1]
        acceleration(tree, bodies, root, angles, v, force, gravity, work, rate)
        far[:] = rate
        down = gravity
        for _ in range(BACK):  # the acceleration goes straight from what it was then to what it is now
            for c in range(len(v)):
                behind[c] = -delay * v[c] + delay**2 * (2.0 * rate[c] + far[c]) / 6.0
            move(tree, root, q, behind, back)
            for c in range(len(v)):
                behind[c] = v[c] - 0.5 * delay * (rate[c] + far[c])
            down = start_of_chart(tree, root, back, there)
            root[TIME] = now - delay
            acceleration(tree, bodies, root, there, behind, force, down, work, far)
            root[TIME] = now
            start_of_chart(tree, root, q, angles)  # forces in inertial axes are again those of here
        read(senses, t, root, back, behind, far, there, down, derive, old, old_q, old_v, old_a)
        for row in range(first, first + count):
            h[row] = old[row]
            if derive:
                for c in range(len(v)):
                    by_q[row, c], by_v[row, c] = old_q[row, c], old_v[row, c]
                    by_a[row, c] = old_a[row, c]
        for j in range(len(senses.bus)):  # an attitude is predicted as a rotation from the one there is now
            if senses.bus[j, 1] == ATTITUDE and senses.bus[j, 0] == first:
                turn = rotation_vector(q, back, 3)
                for c in range(3):
                    h[first + c] += turn[c]


@compile_inner
def add_product(a, b, out, first):
    """Add the product of matrices (rows, nv), (nv, k) to columns of ``out`` from ``first`` on."""
    product = np.empty((a.shape[0], b.shape[1]))
    multiply(a, b, product)
    for r in range(a.shape[0]):
        for c in range(b.shape[1]):
            out[r, first + c] += product[r, c]


@compile_inner
def select(x, columns, out, first):
    """Write chosen columns (k,) of a matrix into those of ``out`` from ``first`` on."""
    for r in range(len(x)):
        for i in range(len(columns)):
            out[r, first + i] = x[r, columns[i]]


@compiled_and_cached
def run(craft, senses, parameters, drive, state, samples, record, wild):
    """Filter samples; ``state`` goes to the sample after the last, if there is one, else past the last.

    Returns `DONE`, or the sample at which readings or the motion could not be followed: covariance or errors
    not finite, or a rate beyond ``wild``.
    """
    tree, tables, roots = craft
    scales, point, rates, terms, weights, read_terms, read_weights, columns, pushed = parameters[:9]
    trends, steep, close, regular = parameters[9:]
    at, middle, means, rise, before, after, push_at, push_middle, jumps = drive[:9]
    acts, sloped, walk, noise = drive[9:]
    edges, values, attitudes, present, variance, corrections, order = samples
    bodies, root, p = tables[0], roots[0], state.covariance
    nv, nq, n, joints, m = len(state.v), len(state.q), len(values), len(tree), len(point)
    rows, width, free, substeps = values.shape[1], len(p), root[FREE] > 0.0, means.shape[1]
    first, rated = 2 * nv + len(state.unknown), 2 * nv + len(acts)
    ramps, unit = np.empty((len(sloped), 2), np.int64), np.ones(len(sloped))
    for j in range(len(sloped)):
        ramps[j, 0], ramps[j, 1] = sloped[j], len(acts) + j
    work, angles, force = workspace(joints), np.empty(joints), np.empty(nv)
    own = work, np.empty((joints, 6)), np.empty((joints, 6)), np.empty((joints + 1, 12))
    square = np.empty((8, nv, nv))
    linear = own, square[0], square[1], square[2], square[3], square[4], square[5]
    by_q, by_v = square[6], square[7]
    wide = np.empty((5, rows, nv))
    spare = (
        np.empty(rows), wide[0], wide[1], wide[2], np.empty(nv), np.empty(nv), np.empty(nq), np.empty(nv),
        np.empty(joints),
    )  # fmt: skip
    stages = work, angles, np.empty(joints), np.empty((4, 2 * nv)), np.empty(2 * nv), force
    off, step, sides = np.empty(width), np.empty(width), np.empty((2, nv))
    driving, climb = np.empty(nv), np.empty(nv)
    change_by_force = np.empty((2 * nv, nv))
    q, v, moved, by_theta, other = np.empty(nq), np.empty(nv), np.empty(nq), np.empty((nv, m)), np.empty(rows)
    at_q, at_v, at_a, at_tau, at_inverse = record.at
    mid_q, mid_v, mid_a, mid_tau, mid_inverse = record.middle
    for k in range(n):
        corrects = k < corrections
        reference(tree, root, state, point, scales, close, regular, acts, sloped, off, q, v, driving, climb)
        a, tau, inverse, h, by_a = at_a[k], at_tau[k], at_inverse[k], record.predicted[k], record.by_a[k]
        at_q[k], at_v[k] = q, v
        roots[:, TIME] = edges[k]
        for c in range(nv):
            tau[c] = at[k, c] + driving[c]
            sides[0, c], sides[1, c] = before[k, c] + driving[c], after[k, c] + driving[c]
        if corrects:
            gravity = linearise(tree, bodies, root, q, v, tau, linear, a, by_q, by_v, inverse, angles)
        else:
            gravity = start_of_chart(tree, root, q, angles)
            acceleration(tree, bodies, root, angles, v, tau, gravity, work, a)
        out = h, wide[3], wide[4], by_a
        read_all(tree, bodies, root, senses, 0, q, v, a, angles, gravity, sides, corrects, out, spare, work)
        if len(senses.twists):
            add_twists(senses, tree, bodies, root, v, tau, a, angles, gravity, work, h)
        residual(senses, edges[k], q, values[k], attitudes[k], h, record.errors[k])
        if corrects:
            whole = record.sensitivity[k]
            for r in range(rows):
                for c in range(nv):
                    whole[r, c], whole[r, nv + c] = wide[3, r, c], wide[4, r, c]
            add_product(by_a, by_q, whole, 0)
            add_product(by_a, by_v, whole, nv)
            multiply(by_a, inverse, wide[3])
            select(wide[3], acts, whole, 2 * nv)
            if m:
                here = angles, v, a, gravity
                by_parameters(
                    tree,
                    tables,
                    roots,
                    terms,
                    weights,
                    pushed,
                    push_at[k],
                    here,
                    inverse,
                    work,
                    force,
                    by_theta,
                )
                add_product(by_a, by_theta, whole, first)
                for r in range(rows):
                    for c in range(m):
                        whole[r, first + c] += columns[r, c]
                out = other, wide[3], wide[4], by_a
                for i in range(len(read_terms)):
                    t, column = read_terms[i, 0], first + read_terms[i, 1]
                    read_all(
                        tree,
                        bodies,
                        root,
                        senses,
                        t,
                        q,
                        v,
                        a,
                        angles,
                        gravity,
                        sides,
                        False,
                        out,
                        spare,
                        work,
                    )
                    for r in range(rows):
                        whole[r, column] += read_weights[i] * other[r]
            rows_read = order[present[k][order]]
            if len(rows_read):
                likely = correct(
                    p, rows_read, variance, off, record.errors[k], whole, record.innovations[k],
                    record.normalised[k], record.whitening[k], record.gain[k], step,
                )  # fmt: skip
                if not np.isfinite(likely):
                    return k
                record.log_likelihood[k] = likely
                move(tree, root, state.q, step[:nv], moved)
                state.q[:] = moved
                for c in range(nv):
                    state.v[c] += step[nv + c]
                for c in range(len(state.unknown)):
                    state.unknown[c] += step[2 * nv + c]
                for c in range(m):
                    state.values[c] += scales[c] * step[first + c]
        for c in range(m):
            record.values[k, c] = state.values[c]
            record.sigmas[k, c] = scales[c] * sqrt(max(p[first + c, first + c], 0.0))
        if k == len(edges) - 1:
            break
        reference(tree, root, state, point, scales, close, regular, acts, sloped, off, q, v, driving, climb)
        h_k, change, forcing = edges[k + 1] - edges[k], record.transition[k], record.forcing[k]
        a, tau, inverse = mid_a[k], mid_tau[k], mid_inverse[k]
        for s in range(substeps):
            if s == substeps // 2:
                mid_q[k], mid_v[k] = q, v
                roots[:, TIME] = edges[k] + 0.5 * h_k
                for c in range(nv):
                    tau[c] = middle[k, c] + driving[c] + 0.5 * h_k * climb[c]
                if corrects:
                    gravity = linearise(tree, bodies, root, q, v, tau, linear, a, by_q, by_v, inverse, angles)
                    transition(h_k, v, by_q, by_v, free, change, forcing)
                    for i in range(2 * nv, width):
                        change[i, i] = 1.0
                    multiply(forcing[: 2 * nv], inverse, change_by_force)
                    select(change_by_force, acts, change, 2 * nv)
                    for j in range(len(sloped)):  # by its mean
                        for r in range(2 * nv):
                            change[r, rated + j] = 0.5 * h_k * change[r, 2 * nv + sloped[j]]
                    if m:
                        here = angles, v, a, gravity
                        by_parameters(
                            tree, tables, roots, terms, weights, pushed, push_middle[k], here, inverse, work,
                            force, by_theta,
                        )  # fmt: skip
                        add_product(forcing[: 2 * nv], by_theta, change, first)
                else:
                    gravity = start_of_chart(tree, root, q, angles)
                    acceleration(tree, bodies, root, angles, v, tau, gravity, work, a)
            part = h_k / substeps
            for c in range(nv):
                sides[0, c] = means[k, s, c] + driving[c] + (s + 0.5) * part * climb[c]
                sides[1, c] = rise[k, s, c] + 0.5 * part * climb[c]
            root[TIME] = edges[k] + s * part
            step_ahead(tree, bodies, root, q, v, sides[0], sides[1], part, stages, moved)
            q[:] = moved
        for r in range(2 * nv):
            step[r] = 0.0
            if m:
                for c in range(width):
                    step[r] += change[r, c] * off[c]
        move(tree, root, q, step[:nv], moved)
        state.q[:] = moved
        lost = False
        for c in range(nv):
            state.v[c] = v[c] + step[nv + c]
            lost = lost or not abs(state.v[c]) < wild
        if lost:
            return k
        for j in range(len(sloped)):
            state.unknown[sloped[j]] += h_k * state.unknown[len(acts) + j]
        for i in range(len(trends)):
            state.values[trends[i, 0]] += h_k * state.values[trends[i, 1]]
        if corrects:
            spread(p, change, forcing, inverse, noise, walk, rates, h_k)
            if len(jumps):
                add_square(p, change_by_force, jumps[k])
            carry_trends(p, change, 2 * nv, ramps, unit, h_k)
            carry_trends(p, change, first, trends, steep, h_k)
    return DONE
