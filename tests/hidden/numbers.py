"""The spacecraft and the arm of the hidden worlds as plain numbers; SI units.

Nominal parameters have names, values and standard deviations: what `estimate.json` says. The world's true
ones are drawn around them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tests.twins.beam import Plate

from . import bodies

Array = np.ndarray
Vector = tuple[float, float, float]
LINKS = ("link1", "link2", "link3")
JOINTS = ("joint1", "joint2", "joint3")
WHEELS = ("wheel_x", "wheel_y", "wheel_z")


@dataclass(frozen=True)
class Tank:
    """A slosh mass on springs along the body axes."""

    name: str
    position: Vector
    mass: float  # [kg]
    stiffness: Vector  # [N/m]
    damping: Vector  # [N s/m]


@dataclass(frozen=True)
class Mode:
    """A bending mode as a mass that slides along z at `at` (3,).

    `seen`: how far stations move along z [kg^-1/2] where it is none of the plate's own.
    """

    at: Vector
    mass: float  # L_t^2 [kg]
    omega: float  # [rad/s]
    damping: float  # ratio
    seen: tuple[float, ...] = ()


@dataclass(frozen=True)
class Drivetrain:
    """A rotor and a spring between motor and link: the joint's motor side is what the encoder measures."""

    compliance: float  # [rad/(N m)]
    rotor: float  # spin inertia, taken out of the link [kg m2]
    damping: float = 0.6  # ratio of rotor and spring


@dataclass(frozen=True)
class Numbers:
    """A world. Bodies by name, parameters (10,) about the body frame's origin (the joint of a link)."""

    name: str
    body: Mapping[str, Array]
    free: bool = True
    gravity: Vector = (0.0, 0.0, 0.0)
    wheel_inertia: Vector | None = (0.159, 0.159, 0.159)  # inside the bus
    wheel_position: Vector = (0.0, 0.0, -0.5)
    wheel_static: Vector = (0.0, 0.0, 0.0)  # imbalance m r of each wheel [kg m]
    mount: Vector = (-1.0, -1.0, 1.0)  # joint 1, bus frame [m]
    start: Vector = (0.4, -0.6, 0.9)  # joint angles at t = 0 [rad]
    tanks: tuple[Tank, ...] = ()
    plate: Plate | None = None
    plate_root: Vector = (1.5, 0.0, 0.0)
    modes: tuple[Mode, ...] | None = None  # by default those of the plate
    bend: float = 0.0  # share by which the plate, as it bends, is drawn in: 1 does not stretch
    armature: Vector = (0.0, 0.0, 0.0)  # motor inertia of the joints [kg m2]
    drivetrain: Mapping[str, Drivetrain] = field(default_factory=dict)
    point: Vector = (0.5, 1.5, 0.6)  # of pose sensor and IMU [m]
    stations: Vector = (2.0, 4.0, 6.0)

    def tank(self, name: str) -> Tank:
        """The tank of that name."""
        return next(t for t in self.tanks if t.name == name)

    def with_body(self, name: str, change: Array) -> Numbers:
        """`change` (10,) added to a body."""
        return replace(self, body={**self.body, name: self.body[name] + change})

    def with_tank(self, tank: Tank) -> Numbers:
        """A tank added, or replaced."""
        return replace(self, tanks=(*(t for t in self.tanks if t.name != tank.name), tank))

    def plate_modes(self) -> tuple[Mode, ...]:
        """The modes as they move: those set, or those of the plate."""
        if self.modes is not None:
            return self.modes
        if self.plate is None:
            return ()
        p, root = self.plate, self.plate_root
        return tuple(
            Mode((root[0] + r / t, root[1], root[2]), t**2, w, p.damping_ratio)
            for t, r, w in zip(p.translation, p.rotation, p.omega, strict=True)
        )


def curvature(plate: Plate) -> Array:
    """Integral of m (L - x) phi_k'^2 dx (modes,) [1/m]: axial acceleration times it is taken off omega^2."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    x = 0.5 * plate.length * (nodes + 1.0)
    step = 1e-5 * plate.length
    slope = (plate.shape(x + step) - plate.shape(x - step)) / (2 * step)
    weight = 0.5 * plate.length * weights * (plate.mass / plate.length) * (plate.length - x)
    return weight @ slope**2


def _matrix(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


ARM = {
    "link1": bodies.theta(10.0, (0.02, -0.01, 0.25), _matrix(0.35, 0.38, 0.22, 0.01, 0.02, -0.015)),
    "link2": bodies.theta(50.0, (1.0, 0.03, -0.02), _matrix(2.2, 17.1, 16.6, 0.2, -0.15, 0.1)),
    "link3": bodies.theta(50.0, (0.95, -0.02, 0.03), _matrix(2.1, 16.4, 16.9, -0.2, 0.15, 0.1)),
}
TIPS = {"link1": (0.0, 0.0, 0.5), "link2": (2.0, 0.0, 0.0), "link3": (2.0, 0.0, 0.0)}
ROTOR = 0.5  # [kg m2] reflected spin inertia of a drivetrain
AXES = {"joint1": (0.0, 0.0, 1.0), "joint2": (0.0, 1.0, 0.0), "joint3": (0.0, 1.0, 0.0)}
BUS = bodies.theta(2000.0, (0.01, -0.02, 0.015), _matrix(1500.0, 1420.0, 1610.0, 12.0, -18.0, 9.0))
TANK = Tank("tank", (0.03, -0.04, 0.05), 50.0, (4.0, 4.6, 3.6), (0.4, 0.42, 0.38))

SMS = Numbers("sms", {"bus": BUS, **ARM}, tanks=(TANK,))
RIGID = Numbers("rigid", {"bus": BUS, **ARM})
PANEL = Numbers(
    "panel",
    {"bus": BUS, **ARM},
    tanks=(Tank("tank", (0.03, -0.04, 0.05), 49.6, (0.41, 0.41, 0.41), (0.02, 0.02, 0.02)),),
    plate=Plate(),
)
ARM_ALONE = Numbers(  # on a wall: gravity along +x, so that the stretched arm hangs
    "arm",
    {"bus": BUS, **ARM},
    free=False,
    gravity=(9.81, 0.0, 0.0),
    wheel_inertia=None,
    start=(0.1, -0.12, 0.15),
)
WORLDS = {n.name: n for n in (SMS, PANEL, RIGID, ARM_ALONE)}

RELATIVE = {"bus": 1e-3, "link1": 5e-3, "link2": 2e-3, "link3": 2e-3}  # sigma of bodies, of their size


@dataclass(frozen=True)
class Nominal:
    """A nominal parameter: what the description says and how well it is known."""

    name: str
    value: float
    unit: str
    sigma: float


def nominal(n: Numbers) -> tuple[Nominal, ...]:
    """All nominal parameters of a world."""
    units = ("kg", *("kg m",) * 3, *("kg m^2",) * 6)
    found = []
    for name, theta in n.body.items():
        if name == "bus" and not n.free:
            continue
        sigma = RELATIVE[name] * bodies.sizes(theta)
        for symbol, value, unit, s in zip(bodies.SYMBOLS, theta, units, sigma, strict=True):
            found.append(Nominal(f"{name}.{symbol}", float(value), unit, float(s)))
    for tank in n.tanks:
        found.append(Nominal(f"{tank.name}.mass", tank.mass, "kg", 5e-3 * tank.mass))
        for field_, unit, share in (("stiffness", "N/m", 0.01), ("damping", "N s/m", 0.1)):
            for axis, value in zip("xyz", getattr(tank, field_), strict=True):
                found.append(Nominal(f"{tank.name}.{field_}.{axis}", value, unit, share * value))
    if n.plate is not None:
        p = n.plate
        found.append(Nominal("panel.density", p.density, "kg/m^3", 5e-3 * p.density))
        found.append(Nominal("panel.youngs_modulus", p.young, "Pa", 1e-2 * p.young))
        found.append(Nominal("panel.damping", p.damping_ratio, "1", 0.1 * p.damping_ratio))
    return tuple(found)


PLATE_FIELDS = {"density": "density", "youngs_modulus": "young", "damping": "damping_ratio"}


def moved(n: Numbers, change: Mapping[str, float]) -> Numbers:
    """The world with nominal parameters changed by so much, by name."""
    for name, by in change.items():
        owner, _, what = name.partition(".")
        if owner in n.body:
            n = n.with_body(owner, by * np.eye(10)[bodies.SYMBOLS.index(what)])
        elif owner == "panel":
            assert n.plate is not None
            key = PLATE_FIELDS[what]
            n = replace(n, plate=replace(n.plate, **{key: getattr(n.plate, key) + by}))
        else:
            tank = n.tank(owner)
            field_, _, axis = what.partition(".")
            value = getattr(tank, field_)
            if axis:
                value = tuple(v + by * (a == axis) for v, a in zip(value, "xyz", strict=True))
            else:
                value = value + by
            n = n.with_tank(replace(tank, **{field_: value}))
    return n


def rotor_theta(joint: str, spin: float) -> Array:
    """Parameters (10,) of a rotor on a joint's axis with a spin inertia [kg m2]: a disc, nearly massless."""
    axis = np.array(AXES[joint])
    disc = spin * (0.5 * np.eye(3) + 0.5 * np.outer(axis, axis))
    return bodies.theta(1e-3, np.zeros(3), disc)


def draw(n: Numbers, rng: np.random.Generator) -> Numbers:
    """True numbers: nominal ones plus errors of their standard deviations, drawn again while unphysical."""
    parameters = nominal(n)
    discs = {link: rotor_theta(joint, ROTOR) for link, joint in zip(LINKS, JOINTS, strict=True)}
    # a drive train takes its rotor out of the link, where the link is large enough to have one
    discs = {link: disc for link, disc in discs.items() if bodies.is_physical(n.body[link] - disc)}
    for _ in range(100):
        errors = rng.standard_normal(len(parameters))
        true = moved(n, {p.name: p.sigma * e for p, e in zip(parameters, errors, strict=True)})
        dampings = [d for t in true.tanks for d in t.damping]
        dampings += [true.plate.damping_ratio] if true.plate else []
        left = [true.body[link] - disc for link, disc in discs.items()]
        if all(map(bodies.is_physical, (*true.body.values(), *left))) and min(dampings, default=1.0) > 0.0:
            return true
    raise RuntimeError("no physical numbers in 100 draws: the standard deviations are too large")
