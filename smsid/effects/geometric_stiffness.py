"""A beam that shortens as it bends: softer under acceleration towards its tip, stiffer when it rotates.

The linear beam moves its points across their rest line only. A beam that does not stretch draws them in by
``u(x) = 1/2 int_0^x w'^2``. To second order in the deflection w = sum phi_k eta_k, with e the beam's axis,
(v, omega) the velocity of its root in its own axes and

    S = 1/2 eta' A eta,   A_ij = int rho (L - x) phi_i' phi_j' dx,
    B_ij = int rho (L^2 - x^2)/2 phi_i' phi_j' dx,

the kinetic energy gains

    T' = -S_dot (e . v) - S v . (omega x e) - R |e x omega|^2 + P omega_x omega_z + Q omega_y
         + 1/2 int rho u_dot^2 dx,
    P = int rho u w dx,   Q = int rho (u w_dot - w u_dot) dx,   R = 1/2 eta' B eta - 1/2 int rho u^2 dx,

with z the direction of bending: nothing of u is left out. P and Q are of third order in eta and the integrals
of u^2 of fourth, as large as the rest where a soft beam swings far. The potential energy of gravity g gains
``S e . g``, that of bending ``1/2 E I int u''^2 dx``: the curvature of a line that keeps its length is
``sqrt(w''^2 + u''^2)``. The equations of motion that follow (Lagrange for eta, Kirchhoff for the root) are
added whole: on the modes the geometric stiffness ``K_g = -a A + |e x omega|^2 B`` with a the root's
specific acceleration along e (compression when it points to the tip), inertia and spring of u, what the swing
adds, and on the root the reaction of the mass drawn in, so that energy and momentum are conserved. The
integrals of u^2, u_dot^2 and u''^2 are sums over the same combinations ``z_r = 1/2 eta' G_r eta``.

Source: Kane, Ryan, Banerjee, J. Guidance 10 (1987) 139; Hanagud and Sarkar, J. Guidance 12 (1989) 438;
Crespo da Silva and Glynn, J. Struct. Mech. 6 (1978) 437; derived here from T'.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pinocchio as pin

from smsid.effects.appendage import BeamAppendage
from smsid.effects.appendage_effect import BeamEffect
from smsid.effects.assembly import AppendageJoints, Assembly
from smsid.effects.base import physical, register
from smsid.effects.mode import Cantilever
from smsid.effects.spatial import Motion

AXIS = np.array([1.0, 0.0, 0.0])  # of a beam appendage, in its own axes


@register
class GeometricStiffness(BeamEffect):
    """What a `beam_appendage` gains when it does not stretch; ``factor`` 1 is the inextensible beam.

    Accelerometers on it see that bending draws them in.
    """

    summary = "beam appendage that softens under axial acceleration towards its tip and stiffens by rotation"
    needs_beam = "its slopes are"
    aliases = ("frequency_drift",)
    strength = ("factor",)
    in_words = "{place} grows stiffer or softer as the craft moves"
    kind: Literal["geometric_stiffness"] = "geometric_stiffness"
    factor: float = physical("1", default=1.0, description="share of it: 1 by theory, 0 for the linear beam")

    def attach(self, assembly: Assembly) -> None:
        """Add the inertia of the foreshortening; raises `DescriptionError` unless it is a beam."""
        panel, beam = self.beam(assembly)
        assembly.add_inertia_term(Foreshortening(assembly.model, panel, beam, self.factor))
        drawn = self.factor / beam.mass * drawn_in(beam.length, beam.modes, beam.stations)
        place = assembly.appendages.index(panel)
        before = 0.0 if panel.drawn is None else panel.drawn
        assembly.appendages[place] = replace(panel, drawn=before + drawn)


class Foreshortening:
    """The `InertiaTerm` of a beam that shortens as it bends."""

    def __init__(self, model: pin.Model, panel: AppendageJoints, beam: BeamAppendage, factor: float) -> None:
        a, b = foreshortening_matrices(beam.length, beam.modes)
        # shapes are normalised to mean square 1: mass-normalised ones are these over sqrt(mass)
        self.a, self.b = factor * a, factor * b
        self.c = factor / np.sqrt(beam.mass) * deflected_moments(beam.length, beam.modes)
        self.c_flat = self.c.reshape(len(self.c), -1)  # a contraction of it takes long in this small
        g, self.inertia, stiffness = shortenings(beam.length, beam.modes)
        self.g = factor / np.sqrt(beam.mass) * g
        omega = 2.0 * np.pi * beam.modal_data()[0].frequency
        self.stiffness = stiffness * omega**2 / beam.cantilever.roots[0] ** 4
        self.parent, self.placement = panel.parent, panel.placement
        self.q = np.array([model.joints[j].idx_q for j in panel.joints])
        self.v = np.array([model.joints[j].idx_v for j in panel.joints])
        self.rows = 6 + np.arange(len(panel.joints))
        self.scale = panel.scale
        self.motion = Motion(model, panel.parent)
        self.to_root = panel.placement.toActionMatrixInverse()
        # on a bus without weight, it matters neither where that is nor what the arm does
        alone = self.motion.root and self.motion.still
        self.depends = (self.v, np.r_[:6, self.v]) if alone else None
        self.cross = pin.skew(AXIS)
        self.across = np.eye(3) - np.outer(AXIS, AXIS)

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what it adds to mass matrix (nv, nv) and nonlinear effects (nv,)."""
        jacobian, velocity, drift = self.motion.at(q, v)
        velocity, drift = self.to_root @ velocity, self.to_root @ drift
        n = len(self.v)
        chain = np.zeros((6 + n, len(v)))  # from v to root velocity and modal rates
        chain[:6] = self.to_root @ jacobian
        chain[self.rows, self.v] = self.scale
        eta, rate = self.scale * q[self.q], self.scale * v[self.v]
        linear, omega = velocity[:3], velocity[3:]
        a_eta, b_eta = self.a @ eta, self.b @ eta
        s, s_dot = 0.5 * eta @ a_eta, rate @ a_eta
        by_shape = self.g @ eta  # derivatives of the shortenings
        shortening = 0.5 * by_shape @ eta
        heavy = self.inertia * shortening
        b_eta -= heavy @ by_shape
        r, r_dot = 0.5 * (eta @ b_eta + heavy @ shortening), rate @ b_eta
        rises, sinks = self.c @ eta, (eta @ self.c_flat).reshape(n, n)  # of u by w's coordinate, of w by u's
        across, along = 0.5 * rises @ eta, sinks @ eta
        swing, p, p_dot = across - along, eta @ across, rate @ (across + along)
        by_eta = rises - rises.T - sinks  # derivatives of swing

        mass = np.zeros((6 + n, 6 + n))
        mass[:3, 3:6] = s * self.cross
        mass[3:6, :3] = -s * self.cross
        mass[3:6, 3:6] = -2.0 * r * self.across
        mass[3, 5] += p
        mass[5, 3] += p
        mass[6:, 6:] = (self.inertia * by_shape.T) @ by_shape
        mass[0, 6:] = mass[6:, 0] = -a_eta  # the axis is the first
        mass[4, 6:] = mass[6:, 4] = swing

        turning = pin.skew(omega)
        turned, drawn, flat = turning[:, 0], turning @ linear, self.across @ omega
        bias = mass[:, :6] @ drift  # that holds the weight: gravity acts like the opposite acceleration
        bias[:3] -= 2.0 * s_dot * turned + s * (turning @ turned)
        bias[0] -= rate @ self.a @ rate
        bias[3:6] -= s * (self.cross @ drawn) + 2.0 * r_dot * flat + 2.0 * r * (turning @ flat)
        bias[6:] += (turned @ turned) * b_eta - drawn[0] * a_eta
        x, y, z = omega
        bias[3:6] += np.array([p_dot * z, rate @ by_eta @ rate, p_dot * x])
        bias[3:6] += turning @ np.array([p * z, swing @ rate, p * x])
        bias[6:] += (self.inertia * (self.g @ rate @ rate) + self.stiffness * shortening) @ by_shape
        bias[6:] += 2.0 * y * ((rises - rises.T) @ rate) - x * z * (across + along)
        return chain.T @ mass @ chain, chain.T @ bias


@cache
def foreshortening_matrices(length: float, modes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return A [1] and B [m] (modes, modes) for mass-normalised modal coordinates, by Gauss quadrature.

    With shapes of mean square one, rho = mass / L and eta mass-normalised, the mass drops out:
    ``A_ij = 1/L int (L - x) phi_i' phi_j' dx`` [1/m], ``B_ij = 1/L int (L^2 - x^2)/2 phi_i' phi_j' dx``.
    """
    beam = Cantilever.with_modes(length, modes)
    nodes, weights = np.polynomial.legendre.leggauss(40 + 8 * modes)
    x, w = 0.5 * length * (nodes + 1.0), 0.5 * weights  # of the mean over the length
    slope = beam.slope(x)
    a = np.einsum("x,xi,xj->ij", w * (length - x), slope, slope)
    b = np.einsum("x,xi,xj->ij", w * (length**2 - x**2) / 2.0, slope, slope)
    a.setflags(write=False)
    b.setflags(write=False)
    return a, b


@cache
def deflected_moments(length: float, modes: int) -> np.ndarray:
    """Return C (modes, modes, modes) [1/m], ``C_kij = 1/L int phi_k D_ij dx`` with D as `drawn_in`.

    With shapes of mean square one and eta mass-normalised, int rho u w dx is ``1/2 C eta eta eta`` over the
    root of the mass.
    """
    beam = Cantilever.with_modes(length, modes)
    nodes, weights = np.polynomial.legendre.leggauss(40 + 8 * modes)
    x = 0.5 * length * (nodes + 1.0)
    found = np.einsum("x,xk,xij->kij", 0.5 * weights, beam.shape(x), drawn_in(length, modes, tuple(x)))
    found.setflags(write=False)
    return found


@cache
def drawn_in(length: float, modes: int, stations: tuple[float, ...]) -> np.ndarray:
    """Return ``int_0^x phi_i' phi_j' dx`` at stations x [m]: (stations, modes, modes) [1/m]."""
    beam = Cantilever.with_modes(length, modes)
    nodes, weights = np.polynomial.legendre.leggauss(40 + 8 * modes)
    found = np.empty((len(stations), modes, modes))
    for k, station in enumerate(stations):
        slope = beam.slope(0.5 * station * (nodes + 1.0))
        found[k] = np.einsum("x,xi,xj->ij", 0.5 * station * weights, slope, slope)
    found.setflags(write=False)
    return found


@cache
def shortenings(length: float, modes: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return G (m, modes, modes) [1/m], inertias and stiffnesses (m,) of m = modes (modes + 1) / 2
    shortenings.

    With ``z_r = 1/2 eta' G_r eta``, D as `drawn_in` and u = 1/2 eta' D eta, of shapes of mean square one,
    ``1/L int u^2 dx`` is the sum of inertias times z^2, and ``L^3 int u''^2 dx`` that of stiffnesses times
    z^2: a cosine-sine decomposition of the two.
    """
    nodes, weights = np.polynomial.legendre.leggauss(40 + 8 * modes)
    x = 0.5 * length * (nodes + 1.0)
    i, j = np.triu_indices(modes)
    share = np.sqrt(0.5 * weights)[:, None] * np.where(i == j, 1.0, 2.0)  # of a product of two coordinates
    beam = Cantilever.with_modes(length, modes)
    bent = np.einsum("xi,xj->xij", beam.slope(x), beam.curvature(x))
    u, curved = share * drawn_in(length, modes, tuple(x))[:, i, j], bent + bent.transpose(0, 2, 1)
    both = np.vstack([u, length**2 * share * curved[:, i, j]])
    axes, size, products = np.linalg.svd(both, full_matrices=False)
    _, cosines, turn = np.linalg.svd(axes[: len(x)], full_matrices=False)
    found = np.zeros((len(i), modes, modes))
    found[:, i, j] = turn @ (size[:, None] * products) / np.where(i == j, 1.0, 2.0)
    found[:, j, i] = found[:, i, j]
    return found, cosines**2, 1.0 - cosines**2
