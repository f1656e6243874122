"""Clamped-free Euler-Bernoulli beam: clamped frequencies, mass-normalised shapes, participations.

The shape functions are phi_k(x) = (cosh - cos - sigma_k (sinh - sin))(beta_k x) / sqrt(m), for which the
integral of phi_k^2 over the mass is 1 and both participations are positive.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq


@dataclass(frozen=True)
class Plate:
    """A thin plate clamped at one edge, bending as a beam (SI units)."""

    length: float = 6.0  # [m], along +x from the root
    width: float = 3.0  # [m], along y, centred
    thickness: float = 0.002  # [m]; the paper prints 3 mm, see its errata
    young: float = 70e9  # [Pa]
    density: float = 2700.0  # [kg/m3]
    damping_ratio: float = 0.005  # [1], the same for every mode
    modes: int = 3

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return self.density * self.length * self.width * self.thickness

    @cached_property
    def beta_length(self) -> np.ndarray:
        """Roots of cos(z) cosh(z) = -1, shape (modes,) [rad]."""

        def f(z: float) -> float:
            return np.cos(z) + 1.0 / np.cosh(z)

        bracket = np.pi * np.arange(self.modes + 1)
        return np.array([brentq(f, a, b, xtol=1e-15, rtol=1e-15) for a, b in pairwise(bracket)])

    @cached_property
    def sigma(self) -> np.ndarray:
        """Ratio (cosh + cos) / (sinh + sin) at the tip, shape (modes,) [1]."""
        z = self.beta_length
        return (np.cosh(z) + np.cos(z)) / (np.sinh(z) + np.sin(z))

    @cached_property
    def omega(self) -> np.ndarray:
        """Clamped angular frequencies, shape (modes,) [rad/s]."""
        stiffness = self.young * self.width * self.thickness**3 / 12.0  # [N m2]
        line_density = self.mass / self.length  # [kg/m]
        return (self.beta_length / self.length) ** 2 * np.sqrt(stiffness / line_density)

    def shape(self, x: np.ndarray | float) -> np.ndarray:
        """Mass-normalised shapes at x [m] from the root, shape (..., modes) [kg^-1/2]."""
        z = np.multiply.outer(np.asarray(x, dtype=float) / self.length, self.beta_length)
        raw = np.cosh(z) - np.cos(z) - self.sigma * (np.sinh(z) - np.sin(z))
        return raw / np.sqrt(self.mass)

    def moment(self, power: int) -> np.ndarray:
        """Integral of x^power phi_k over the mass, shape (modes,) [kg^1/2 m^power], by Gauss quadrature."""
        nodes, weights = np.polynomial.legendre.leggauss(60)
        x = 0.5 * self.length * (nodes + 1.0)
        return 0.5 * self.mass * (weights * x**power) @ self.shape(x)

    @cached_property
    def translation(self) -> np.ndarray:
        """Translational participation L_t along the bending direction, shape (modes,) [kg^1/2]."""
        return self.moment(0)

    @cached_property
    def rotation(self) -> np.ndarray:
        """Rotational participation, integral of x phi dm about the root, shape (modes,) [kg^1/2 m].

        As a vector about the root it is (0, -rotation, 0): x cross z is -y.
        """
        return self.moment(1)
