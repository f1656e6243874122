"""A plate that draws its points in as it bends, in MuJoCo: point masses along it that move on curves.

A point at x moves by phi(x) eta across and by -u(x) along, with u the integral of (dphi/dx eta)^2 / 2 from
the root to x, times a share. What the masses' kinetic energy gains by u, to every order, has inertia and
acceleration terms of its own, and bending to a curvature d^2u/dx^2 beside that across takes E I / 2 times the
integral of its square; all is added as the passive force that makes MuJoCo's acceleration the one of the
whole equations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np

from .numbers import Numbers

if TYPE_CHECKING:
    from .plant import Plant

Array = np.ndarray
NODES = 24  # of Gauss, along the plate


class Shortening:
    """The passive force of a plant's plate that does not stretch."""

    def __init__(self, plant: Plant) -> None:
        n = plant.numbers
        assert n.plate is not None and n.modes is None
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        x = 0.5 * n.plate.length * (nodes + 1.0)
        self.plant, self.share = plant, n.bend
        self.mass = 0.5 * weights * n.plate.mass
        self.rest = np.add(n.plate_root, np.outer(x, [1.0, 0.0, 0.0]))
        self.scale = np.sqrt([m.mass for m in n.plate_modes()])  # mass-normalised per coordinate
        self.across = n.plate.shape(x) * self.scale
        self.along = drawn(n, x) * np.outer(self.scale, self.scale)
        step = 1e-4 * n.plate.length
        at = x[:, None] + step * np.arange(-2, 3)
        before, here, after = (n.plate.shape(at[:, k]) for k in (1, 2, 3))
        slope, curve = (after - before) / (2.0 * step), (after - 2.0 * here + before) / step**2
        both = np.einsum("xk,xl->xkl", slope, curve) * np.outer(self.scale, self.scale)
        self.curved = both + both.transpose(0, 2, 1)
        p = n.plate
        self.stiff = 0.5 * weights * p.length * p.young * p.width * p.thickness**3 / 12.0
        modes = range(1, len(self.scale) + 1)
        self.q = np.array([plant.q_of(f"mode{k}") for k in modes])
        self.v = np.array([plant.v_of(f"mode{k}") for k in modes])

    def __call__(self) -> None:
        """Add it to the plant's passive forces."""
        plant = self.plant
        model, data = plant.model, plant.data
        whole, plain = self._terms(self.share), self._terms(0.0)
        more, bias = whole[0] - plain[0], whole[1] - plain[1]
        mass, other = np.zeros((model.nv, model.nv)), np.zeros(model.nv)
        mujoco.mj_fullM(model, data, mass)
        mujoco.mj_rne(model, data, 0, other)
        mujoco.mj_fwdActuation(model, data)
        force = plant.passive + data.qfrc_applied + data.qfrc_actuator
        acceleration = np.linalg.solve(mass + more, force - other - bias)
        plant.passive -= more @ acceleration + bias

    def _terms(self, share: float) -> tuple[Array, Array]:
        """Mass matrix (nv, nv) and bias (nv,) of the points, drawn in by a share of what they should be."""
        plant = self.plant
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, plant.qpos[3:7])
        r = turn.reshape(3, 3)
        eta, rate, w = plant.qpos[self.q], plant.qvel[self.v], plant.qvel[3:6]
        place, moved = self.rest.copy(), np.zeros((len(self.mass), 3, len(eta)))  # body axes
        moved[:, 2] = self.across
        moved[:, 0] = -share * self.along @ eta
        place[:, 2] += self.across @ eta
        place[:, 0] -= 0.5 * share * np.einsum("k,xkl,l->x", eta, self.along, eta)
        speed = moved @ rate
        own = np.cross(w, np.cross(w, place)) + 2.0 * np.cross(w, speed)
        own[:, 0] -= share * np.einsum("k,xkl,l->x", rate, self.along, rate)
        jacobian = np.zeros((len(self.mass), 3, plant.model.nv))  # inertial axes
        jacobian[:, :, :3] = np.eye(3)
        jacobian[:, :, 3:6] = -r @ np.array([_cross(p) for p in place])
        jacobian[:, :, self.v] = r @ moved
        bent = share * self.curved @ eta
        weight = own @ r.T - np.array(plant.numbers.gravity)
        mass = np.einsum("x,xai,xaj->ij", self.mass, jacobian, jacobian)
        bias = np.einsum("x,xai,xa->i", self.mass, jacobian, weight)
        bias[self.v] += 0.5 * (self.stiff * (bent @ eta)) @ bent
        return mass, bias


def drawn(n: Numbers, x: Array) -> Array:
    """Integral of phi_k' phi_l' from the root to x (N,): (N, modes, modes), mass-normalised [1 / (kg m)]."""
    assert n.plate is not None
    nodes, weights = np.polynomial.legendre.leggauss(40)
    out = []
    for end in np.atleast_1d(x):
        at, step = 0.5 * end * (nodes + 1.0), 1e-5 * n.plate.length
        slope = (n.plate.shape(at + step) - n.plate.shape(at - step)) / (2.0 * step)
        out.append(np.einsum("x,xk,xl->kl", 0.5 * end * weights, slope, slope))
    return np.array(out)


def _cross(p: Array) -> Array:
    return np.array([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])
