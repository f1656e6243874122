"""The paper's spacecraft as plain numbers (Table 1, section V), SI units, vectors in body axes.

The body frame sits at the centre of mass of the base alone. Errata taken into account: the panel is 2 mm
thick. Choices the paper leaves open: the wheels' spin inertia is inside the base's 1500 kg m2 and their mass
inside the 2000 kg, thrust acts at the base's centre of mass, the panel is centred on y = z = 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .beam import Plate

Vector = tuple[float, float, float]
Inertia = tuple[float, float, float, float, float, float]  # xx, yy, zz, xy, xz, yz


def inertia_matrix(six: Inertia) -> np.ndarray:
    """(3, 3) inertia from xx, yy, zz, xy, xz, yz (signed matrix elements) [kg m2]."""
    xx, yy, zz, xy, xz, yz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@dataclass(frozen=True)
class Link:
    """A rigid link: the joint is at the link frame's origin, the next joint at `tip`."""

    axis: str  # "x", "y" or "z": joint axis, link frame
    mass: float  # [kg]
    centre: Vector  # centre of mass, link frame [m]
    tip: Vector  # next joint, link frame [m]
    inertia: Inertia  # about the centre of mass, link axes [kg m2]


LINKS = (
    Link("z", 10.0, (0.0, 0.0, 0.25), (0.0, 0.0, 0.5), (0.21, 0.21, 0.01, 0.0, 0.0, 0.0)),
    Link("y", 50.0, (1.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.05, 16.69, 16.69, 0.0, 0.0, 0.0)),
    Link("y", 50.0, (1.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.05, 16.69, 16.69, 0.0, 0.0, 0.0)),
)


@dataclass(frozen=True)
class Spacecraft:
    """Everything the twins need; change one with `dataclasses.replace`."""

    base_mass: float = 2000.0  # [kg], wheels included
    base_inertia: Inertia = (1500.0, 1500.0, 1500.0, 0.0, 0.0, 0.0)  # [kg m2], wheels included
    wheel_inertia: Vector = (0.159, 0.159, 0.159)  # spin inertia of the wheels about x, y, z [kg m2]
    arm_mount: Vector = (-1.0, -1.0, 1.0)  # joint 1 in the body frame [m]
    arm_rpy: Vector = (0.0, 0.0, 0.0)  # mounting attitude, Rz(yaw) Ry(pitch) Rx(roll) [rad]
    links: tuple[Link, ...] = LINKS
    slosh_mass: float = 49.6  # [kg]
    slosh_stiffness: Vector = (0.41, 0.41, 0.41)  # [N/m]
    slosh_damping: Vector = (0.02, 0.02, 0.02)  # [N s/m]
    slosh_centre: Vector = (0.03, -0.04, 0.05)  # equilibrium c_s [m]
    panel: Plate = field(default_factory=Plate)
    panel_root: Vector = (1.5, 0.0, 0.0)  # clamp C [m]
    point: Vector = (0.5, 1.5, 0.6)  # tracked point P and IMU [m]
    stations: Vector = (2.0, 4.0, 6.0)  # panel accelerometers, from the clamp [m]

    @property
    def total_mass(self) -> float:
        """Mass of everything [kg]."""
        return self.base_mass + sum(link.mass for link in self.links) + self.slosh_mass + self.panel.mass

    @property
    def arm_rotation(self) -> np.ndarray:
        """(3, 3) rotation of the arm's mounting frame, mount to body."""
        (cr, cp, cy), (sr, sp, sy) = np.cos(self.arm_rpy), np.sin(self.arm_rpy)
        rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        return rz @ ry @ rx


PAPER = Spacecraft()
