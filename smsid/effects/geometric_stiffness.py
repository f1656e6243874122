"""A beam that shortens as it bends: softer under acceleration towards its tip, stiffer when it rotates.

The linear beam moves its points across their rest line only. One that does not stretch draws them in by
``u(x) = 1/2 int_0^x w'^2``, w = sum phi_k eta_k the deflection, so that they move on curves: nothing of u is
left out of their kinetic energy and of gravity's potential. The curvature of a line that keeps its length is
``sqrt(w''^2 + u''^2)``: that takes ``1/2 E I int u''^2 dx`` beside the modes' energy. What point masses along
the beam have more than those that do not move along is added to mass matrix and nonlinear effects, so that
energy and momentum are conserved. To second order in eta it is on the modes the geometric stiffness
``K_g = -a A + |e x omega|^2 B``, with e the beam's axis, a the root's specific acceleration along it
(compression when it points to the tip), ``A_ij = int rho (L - x) phi_i' phi_j' dx`` and
``B_ij = int rho (L^2 - x^2)/2 phi_i' phi_j' dx``.

Source: Kane, Ryan, Banerjee, J. Guidance 10 (1987) 139; Hanagud and Sarkar, J. Guidance 12 (1989) 438;
Crespo da Silva and Glynn, J. Struct. Mech. 6 (1978) 437.
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
from smsid.effects.spatial import FrameMotion


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
        """Add the inertia of the foreshortening; raises `DescriptionError` unless it is a beam.

        Of several on one beam the shares add: what is drawn in enters its energy squared.
        """
        panel, beam = self.beam(assembly)
        terms = [t for t in assembly.inertias if isinstance(t, Foreshortening) and t.joints == panel.joints]
        if terms:
            terms[0].add(self.factor)
        else:
            assembly.add_inertia_term(Foreshortening(assembly.model, panel, beam, self.factor))
        drawn = self.factor / beam.mass * drawn_in(beam.length, beam.modes, beam.stations)
        place = assembly.appendages.index(panel)
        before = 0.0 if panel.drawn is None else panel.drawn
        assembly.appendages[place] = replace(panel, drawn=before + drawn)


class Foreshortening:
    """The `InertiaTerm` of a beam that shortens as it bends, by ``4 + 4 modes`` points of Gauss along it."""

    def __init__(self, model: pin.Model, panel: AppendageJoints, beam: BeamAppendage, factor: float) -> None:
        nodes, weights = np.polynomial.legendre.leggauss(4 + 4 * beam.modes)
        self.x, shapes = 0.5 * beam.length * (nodes + 1.0), beam.cantilever
        self.mass = 0.5 * beam.mass * weights
        self.stiffness = 0.5 * beam.length * beam.bending_stiffness * weights
        # shapes are normalised to mean square 1: mass-normalised ones are these over sqrt(mass)
        self.shape = shapes.shape(self.x) / np.sqrt(beam.mass)
        both = np.einsum("xi,xj->xij", shapes.slope(self.x), shapes.curvature(self.x)) / beam.mass
        drawn = drawn_in(beam.length, beam.modes, tuple(self.x)) / beam.mass
        self.joints, self.factor, self._full = panel.joints, 0.0, (drawn, both + both.transpose(0, 2, 1))
        self.add(factor)
        self.parent, self.placement = panel.parent, panel.placement
        self.q = np.array([model.joints[j].idx_q for j in panel.joints])
        self.v = np.array([model.joints[j].idx_v for j in panel.joints])
        self.rows = 6 + np.arange(len(panel.joints))
        self.scale = panel.scale
        self.motion = FrameMotion(model, panel.parent)
        self.to_root = panel.placement.toActionMatrixInverse()
        # on a bus without weight, it matters neither where that is nor what the arm does
        alone = self.motion.root and self.motion.still
        self.depends = (self.v, np.r_[:6, self.v]) if alone else None

    def add(self, factor: float) -> None:
        """Add to the share of the foreshortening that there is."""
        self.factor += factor
        self.drawn, self.curved = (self.factor * x for x in self._full)

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what it adds to mass matrix (nv, nv) and nonlinear effects (nv,)."""
        jacobian, velocity, drift = self.motion.at(q, v)
        velocity, drift = self.to_root @ velocity, self.to_root @ drift
        chain = np.zeros((6 + len(self.v), len(v)))  # from v to root velocity and modal rates
        chain[:6] = self.to_root @ jacobian
        chain[self.rows, self.v] = self.scale
        eta, rate = self.scale * q[self.q], self.scale * v[self.v]
        spin = pin.skew(velocity[3:])
        lift = (
            drift[:3] + spin @ velocity[:3]
        )  # holds the weight: gravity acts like the opposite acceleration
        by_eta, by_rate, bent = self.drawn @ eta, self.drawn @ rate, self.curved @ eta
        place, off = np.zeros((2, len(self.x), 3))  # of points that are not drawn in, and how far those are
        place[:, 0], place[:, 2], off[:, 0] = self.x, self.shape @ eta, -0.5 * by_eta @ eta
        plain, more = np.zeros((2, len(self.x), 3, 6 + len(eta)))
        plain[:, :, :3], plain[:, 2, 6:], more[:, 0, 6:] = np.eye(3), self.shape, -by_eta
        accelerations = []
        for moved, at in ((plain, place), (more, off)):
            moved[:, :, 3:6] = [-pin.skew(p) for p in at]
            swing = moved[:, :, 3:6] @ drift[3:] + at @ (spin @ spin).T
            accelerations.append(swing + 2.0 * (moved[:, :, 6:] @ rate) @ spin.T)
        own, gained = accelerations
        own += lift
        gained[:, 0] -= by_rate @ rate
        heavy, light = (self.mass[:, None, None] * x for x in (plain, more))
        points = (0, 1), (0, 1)
        mass = np.tensordot(light, plain + more, points) + np.tensordot(heavy, more, points)
        bias = np.tensordot(light, own + gained, points) + np.tensordot(heavy, gained, points)
        bias[6:] += 0.5 * (self.stiffness * (bent @ eta)) @ bent
        return chain.T @ mass @ chain, chain.T @ bias


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
