"""Friction of joints in compiled form: the laws of `smsid.effects.friction_law`, in tables behind `root`."""

from __future__ import annotations

from math import cos, exp, sin, tanh

from smsid.kernel.columns import DOF, FIRST, FREE, FRICTION, FRICTIONS, LAWS, START, TIME
from smsid.kernel.jit import compiled

PROBE = 1e-6  # step of the differences, as of nonlinear forces elsewhere


@compiled
def torque(root, at, angle, rate, load):
    """Return the torque against the motion, of the friction whose table begins at ``at``."""
    if root[TIME] < root[at + START]:
        return 0.0
    k = at + LAWS
    sign = tanh(rate / root[k + 10])
    dry = root[k + 1] + root[k + 3] * sign + root[k + 7] * abs(load)
    dry += root[k + 8] * cos(angle) + root[k + 9] * sin(angle)
    if root[k + 6] != 0.0:
        dry += root[k + 6] * exp(-(abs(rate / root[k + 11]) ** root[k + 12]))
    wet = root[k] + root[k + 2] * sign + root[k + 4] * abs(rate) + root[k + 5] * rate**2
    return wet * rate + dry * sign


@compiled
def add_friction(root, angles, v, tau, sign, out):
    """Add the torques of all frictions, times a sign, to ``out`` (nv,)."""
    start = 6 if root[FREE] > 0.0 else 0
    for n in range(int(root[FRICTIONS])):
        at = FIRST + FRICTION * n
        i = int(root[at + DOF])
        k = start + i
        out[k] += sign * torque(root, at, angles[i], v[k], tau[k])


@compiled
def add_friction_derivatives(root, angles, v, tau, by_q, by_v):
    """Add how the torques of all frictions change with angles and rates."""
    start = 6 if root[FREE] > 0.0 else 0
    for n in range(int(root[FRICTIONS])):
        at = FIRST + FRICTION * n
        i = int(root[at + DOF])
        k = start + i
        here = torque(root, at, angles[i], v[k], tau[k])
        by_q[k, k] += (torque(root, at, angles[i] + PROBE, v[k], tau[k]) - here) / PROBE
        by_v[k, k] += (torque(root, at, angles[i], v[k] + PROBE, tau[k]) - here) / PROBE
