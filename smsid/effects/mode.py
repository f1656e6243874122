"""Bending modes: of an Euler-Bernoulli cantilever, or as data, and the joint that stands for one.

A mass-normalised mode with translational participation L_t (3,) and rotational participation L_r (3,) about
the root is a screw: the point mass |L_t|^2 sits where L_r = r x L_t and slides along L_t. Reproduces (5),
(7), (9) and (13): linear momentum and first moments exactly, the inertia to first order for bending of a
straight beam.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
import pinocchio as pin
import scipy  # loads a part of it when that is used
from pydantic import Field

from smsid.effects.base import Vector3, physical
from smsid.effects.inertial_parameters import pinocchio_inertia
from smsid.effects.table import StrictTable
from smsid.errors import DescriptionError


class Mode(StrictTable):
    """One mass-normalised mode as a finite-element program delivers it.

    ``frequency`` [Hz], ``damping`` ratio, ``translation`` L_t [kg^.5] and ``rotation`` L_r about the root
    [kg^.5 m] in appendage axes, ``shape`` at the appendage's stations (stations, 3) [kg^-.5].
    """

    frequency: float = physical("Hz", lower=0.0, gt=0.0, description="of the clamped mode")
    damping: float = physical("1", lower=0.0, may_vanish=True, ge=0.0, description="damping ratio")
    translation: Vector3 = physical(
        "kg^0.5", sparse=True, description="L_t, translational participation, appendage axes"
    )
    rotation: Vector3 = physical(
        "kg^0.5 m", sparse=True, description="L_r, rotational participation about the root"
    )
    shape: tuple[Vector3, ...] = Field(
        default=(), description="mass-normalised displacement at each station, appendage axes [kg^-.5]"
    )

    def heavier(self, factor: float) -> Mode:
        """Return the mode with ``factor`` times the modal mass."""
        root = float(np.sqrt(factor))
        return self.model_copy(
            update={
                "translation": tuple(root * x for x in self.translation),
                "rotation": tuple(root * x for x in self.rotation),
                "shape": tuple(tuple(x / root for x in s) for s in self.shape),
            }
        )


ModeJoint = tuple[pin.JointModel, pin.Inertia, pin.SE3, float]


@lru_cache(maxsize=64)
def mode_joints(
    modes: tuple[Mode, ...], parameters: tuple[float, ...]
) -> tuple[tuple[ModeJoint, ...], np.ndarray]:
    """Return what `mode_joint` gives for every mode, and the parameters (10,) of the rigid remainder."""
    remainder = np.array(parameters)
    rigid = pinocchio_inertia(remainder)
    parts = tuple(mode_joint(mode, rigid) for mode in modes)
    for _, inertia, placement, _ in parts:
        remainder = remainder - placement.act(inertia).toDynamicParameters()
    remainder.setflags(write=False)
    return parts, remainder


def mode_joint(mode: Mode, rigid: pin.Inertia) -> ModeJoint:
    """Return joint, inertia in the joint frame, placement in the appendage axes, and scale ``delta / s``.

    Raises `DescriptionError` for a mode that moves nothing, or an appendage that cannot exist.
    """
    lt, lr = np.asarray(mode.translation), np.asarray(mode.rotation)
    size = np.linalg.norm(lt)
    if rigid.mass <= 0.0 or rigid.inertia.trace() < 0.0:
        raise DescriptionError(
            f"An appendage of {rigid.mass:.6g} kg with such a centre of mass and inertia cannot exist.",
            advice="Check its `mass`, `center_of_mass` and `inertia`, which is about the root.",
        )
    lever = rigid.inertia.trace() ** 0.5 / rigid.mass**0.5
    if size * lever < 1e-9 * np.linalg.norm(lr) or size == 0.0:
        moment = np.linalg.norm(lr)
        if moment == 0.0:
            raise DescriptionError(
                "A mode without translational and rotational participation moves nothing.",
                advice="Remove the mode, or give its participation factors.",
            )
        axis = lr / moment
        inertia = pin.Inertia(0.0, np.zeros(3), moment**2 * np.outer(axis, axis))
        return pin.JointModelRevoluteUnaligned(axis), inertia, pin.SE3.Identity(), float(moment)
    n = lt / size
    placement = pin.SE3(np.eye(3), np.cross(lt, lr) / size**2)
    twist = float(lr @ n)
    if abs(twist) <= 1e-9 * size * lever:
        inertia = pin.Inertia(float(size**2), np.zeros(3), np.zeros((3, 3)))
        return pin.JointModelPrismaticUnaligned(n), inertia, placement, float(size)
    # share the modal energy between translation and twist in the ratio of the effective mass fractions
    about = rigid.inertia + rigid.mass * _point(rigid.lever - placement.translation)
    translation_share = size**2 / rigid.mass
    twist_share = twist**2 / float(n @ about @ n)
    w = translation_share / (translation_share + twist_share)
    mass, spin = size**2 / w, twist**2 / (1.0 - w)
    s_rate, angle_rate = w / size, (1.0 - w) / twist  # per unit delta rate
    inertia = pin.Inertia(float(mass), np.zeros(3), spin * np.outer(n, n))
    joint = pin.JointModelHelicalUnaligned(n, float(s_rate / angle_rate))
    return joint, inertia, placement, float(1.0 / angle_rate)


def _point(r: np.ndarray) -> np.ndarray:
    return (r @ r) * np.eye(3) - np.outer(r, r)


@cache
def clamped_free_roots(count: int) -> np.ndarray:
    """Return the first roots beta L of ``cos(x) cosh(x) = -1``, (count,), not to be written to."""
    centres = (2 * np.arange(1, count + 1) - 1) * np.pi / 2
    roots = [
        scipy.optimize.brentq(lambda x: np.cos(x) + 1.0 / np.cosh(x), c - 1.0, c + 1.0, xtol=1e-15)
        for c in centres
    ]
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

    def curvature(self, x: np.ndarray | float) -> np.ndarray:
        """Return the second derivative of the mode shapes at x [m]: (..., modes) [1/m^2]."""
        beta_x = np.asarray(x, dtype=float)[..., None] / self.length * self.roots
        grow, decay = self._parts(beta_x)
        bent = grow + decay + np.cos(beta_x) - self._sigma * np.sin(beta_x)
        return bent * (self.roots / self.length) ** 2

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
