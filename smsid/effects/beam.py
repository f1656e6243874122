"""Euler-Bernoulli cantilever: frequencies, mode shapes and participation factors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq


@cache
def clamped_free_roots(count: int) -> np.ndarray:
    """Return the first roots beta L of ``cos(x) cosh(x) = -1``, (count,), not to be written to."""
    centres = (2 * np.arange(1, count + 1) - 1) * np.pi / 2
    roots = [brentq(lambda x: np.cos(x) + 1.0 / np.cosh(x), c - 1.0, c + 1.0, xtol=1e-15) for c in centres]
    found = np.array(roots)
    found.setflags(write=False)
    return found


@dataclass(frozen=True)
class Cantilever:
    """A uniform clamped-free beam of length L [m].

    Mode shapes are normalised so that ``integral_0^L shape^2 dx = L``; dividing by ``sqrt(mass)`` makes them
    mass-normalised.
    """

    length: float
    roots: np.ndarray

    @classmethod
    def with_modes(cls, length: float, count: int) -> Cantilever:
        """Return the beam with its first ``count`` bending modes."""
        return cls(length, clamped_free_roots(count))

    @property
    def _sigma(self) -> np.ndarray:
        x = self.roots
        return (np.cosh(x) + np.cos(x)) / (np.sinh(x) + np.sin(x))

    def angular_frequencies(self, bending_stiffness: float, linear_density: float) -> np.ndarray:
        """Return the natural frequencies (modes,) [rad/s] from EI [N m^2] and the linear density [kg/m]."""
        return (self.roots / self.length) ** 2 * np.sqrt(bending_stiffness / linear_density)

    def shape(self, x: np.ndarray | float) -> np.ndarray:
        """Return the mode shapes at stations x [m] from the clamp: (..., modes), dimensionless."""
        beta_x = np.asarray(x, dtype=float)[..., None] / self.length * self.roots
        grow, decay = self._parts(beta_x)
        return grow + decay - np.cos(beta_x) + self._sigma * np.sin(beta_x)

    def slope(self, x: np.ndarray | float) -> np.ndarray:
        """Return the derivative of the mode shapes at x [m]: (..., modes) [1/m]."""
        beta_x = np.asarray(x, dtype=float)[..., None] / self.length * self.roots
        grow, decay = self._parts(beta_x)
        return (grow - decay + np.sin(beta_x) + self._sigma * np.cos(beta_x)) * self.roots / self.length

    def _parts(self, beta_x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what grows and what decays of cosh - s sinh, 1 - s written without the difference.

        For the twelfth mode on, s is one to machine precision.
        """
        r = self.roots
        grow = (np.sin(r) - np.cos(r) - np.exp(-r)) / (np.sinh(r) + np.sin(r)) * 0.5 * np.exp(beta_x)
        return grow, 0.5 * (1.0 + self._sigma) * np.exp(-beta_x)

    @property
    def mean_shape(self) -> np.ndarray:
        """Return ``(1/L) integral shape dx``: participation L_t = sqrt(mass) times this, (modes,)."""
        return 2.0 * self._sigma / self.roots

    @property
    def mean_moment(self) -> np.ndarray:
        """Return ``(1/L) integral x shape dx`` [m]: L_r about the clamp = sqrt(mass) times this, (modes,)."""
        return 2.0 * self.length / self.roots**2
