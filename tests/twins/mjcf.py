"""The spacecraft as MJCF text: wheels, arm, slosh particle and sliding modal masses as MuJoCo joints."""

from __future__ import annotations

import numpy as np

from .numbers import Spacecraft, inertia_matrix

# MuJoCo asks every moving body for mass and inertia; what is added for that is taken off the base: no effect
TINY = 1e-6  # [kg m2]
WHEEL_MASS = 1.0  # [kg], at the base's centre of mass

FRAME = """<mujoco>
  <compiler angle="radian" autolimits="false" inertiafromgeom="false" balanceinertia="false"/>
  <option gravity="0 0 0" integrator="RK4" timestep="0.001">
    <flag contact="disable" constraint="disable" energy="enable"/>
  </option>
  <worldbody>
    <body name="base">
      <freejoint/>
      {base}
{children}
    </body>
  </worldbody>
</mujoco>
"""


def _text(values: object) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def _inertial(mass: float, centre: np.ndarray, inertia: np.ndarray) -> str:
    """`inertia` (3, 3) about `centre` (3,), body axes [kg m2]."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia
    return (
        f'<inertial mass="{_text(mass)}" pos="{_text(centre)}" '
        f'fullinertia="{_text([xx, yy, zz, xy, xz, yz])}"/>'
    )


def _steiner(mass: float, r: np.ndarray) -> np.ndarray:
    """(3, 3) inertia of a point mass at r (3,) about the origin [kg m2]."""
    return mass * (r @ r * np.eye(3) - np.outer(r, r))


def _quaternion(matrix: np.ndarray) -> np.ndarray:
    """Quaternion w x y z (4,) of a rotation matrix, by the eigenvector of Davenport's matrix."""
    m = matrix
    k = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [0, m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [0, 0, m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [0, 0, 0, m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    return np.linalg.eigh(k, UPLO="U")[1][:, -1]


def base_with_remainder(n: Spacecraft) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre (3,) and inertia about it (3, 3): base plus plate minus all that moves on its own."""
    plate, root = n.panel, np.array(n.panel_root)
    mass = n.base_mass + plate.mass - 3 * WHEEL_MASS
    centre_plate = root + np.array([plate.length / 2, 0, 0])
    first = plate.mass * centre_plate
    a, b, c = plate.length**2 / 12, plate.width**2 / 12, plate.thickness**2 / 12
    inertia = (
        inertia_matrix(n.base_inertia)
        + plate.mass * np.diag([b + c, a + c, a + b])
        + _steiner(plate.mass, centre_plate)
    )
    for k in range(3):
        axis = np.eye(3)[k]
        inertia -= n.wheel_inertia[k] * (0.5 * np.eye(3) + 0.5 * np.outer(axis, axis))
    for trans, rot in zip(plate.translation, plate.rotation, strict=True):
        at = root + np.array([rot / trans, 0, 0])
        mass, first = mass - trans**2, first - trans**2 * at
        inertia -= _steiner(trans**2, at)
    inertia -= (1 + plate.modes) * TINY * np.eye(3)
    centre = first / mass
    return mass, centre, inertia - _steiner(mass, centre)


def write_mjcf(n: Spacecraft) -> str:
    """MJCF of the spacecraft; velocities in the order [base 6, wheels 3, arm 3, slosh 3, modes 3]."""
    children = []
    for k, axis in enumerate(np.eye(3)):
        spin = n.wheel_inertia[k]
        disc = spin * np.diag(0.5 + 0.5 * axis)
        children.append(
            f'<body name="wheel{k}"><joint name="wheel{k}" type="hinge" axis="{_text(axis)}"/>'
            f"{_inertial(WHEEL_MASS, np.zeros(3), disc)}</body>"
        )
    closing = ""
    for k, link in enumerate(n.links):
        place = f'pos="{_text(n.links[k - 1].tip if k else n.arm_mount)}"'
        if k == 0:
            place += f' quat="{_text(_quaternion(n.arm_rotation))}"'
        axis = _text([link.axis == name for name in "xyz"])
        children.append(
            f'<body name="link{k}" {place}><joint name="arm{k}" type="hinge" axis="{axis}"/>'
            f"{_inertial(link.mass, np.array(link.centre), inertia_matrix(link.inertia))}"
        )
        closing += "</body>"
    children.append(closing)
    slides = "".join(
        f'<joint name="slosh{k}" type="slide" axis="{_text(axis)}" '
        f'stiffness="{_text(n.slosh_stiffness[k])}" damping="{_text(n.slosh_damping[k])}"/>'
        for k, axis in enumerate(np.eye(3))
    )
    tiny = TINY * np.eye(3)
    children.append(
        f'<body name="slosh" pos="{_text(n.slosh_centre)}">{slides}'
        f"{_inertial(n.slosh_mass, np.zeros(3), tiny)}</body>"
    )
    plate = n.panel
    for k, (trans, rot, omega) in enumerate(zip(plate.translation, plate.rotation, plate.omega, strict=True)):
        mass, at = trans**2, n.panel_root + np.array([rot / trans, 0, 0])
        spring, damper = mass * omega**2, 2 * plate.damping_ratio * omega * mass
        children.append(
            f'<body name="mode{k}" pos="{_text(at)}"><joint name="mode{k}" type="slide" axis="0 0 1" '
            f'stiffness="{_text(spring)}" damping="{_text(damper)}"/>'
            f"{_inertial(mass, np.zeros(3), tiny)}</body>"
        )
    return FRAME.format(
        base=_inertial(*base_with_remainder(n)), children="\n".join("      " + c for c in children)
    )
