"""A hidden world as MJCF text: wheels, arm, slosh masses, modes, motors, thrusters."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from . import bodies
from .numbers import AXES, JOINTS, LINKS, TIPS, WHEELS, Drivetrain, Mode, Numbers, rotor_theta

Array = np.ndarray
TINY = 1e-6  # [kg m2] MuJoCo asks every moving body for inertia; taken off the bus again
WHEEL_MASS = 1.0  # [kg], part of the bus's

FRAME = """<mujoco>
  <compiler angle="radian" autolimits="false" inertiafromgeom="false" balanceinertia="false"/>
  <option gravity="{gravity}" integrator="RK4" timestep="{step!r}">
    <flag contact="disable" constraint="disable"/>
  </option>
  <worldbody>
{bodies}
  </worldbody>
  <actuator>
{motors}
  </actuator>
</mujoco>
"""


def text(values: ArrayLike) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def inertial(theta: Array) -> str:
    mass, centre, inertia = bodies.split(np.asarray(theta))
    xx, xy, yy, xz, yz, zz = bodies.six(inertia)
    six = text([xx, yy, zz, xy, xz, yz])
    return f'<inertial mass="{float(mass)!r}" pos="{text(centre)}" fullinertia="{six}"/>'


def wheel_theta(n: Numbers, k: int) -> Array:
    """Parameters (10,) of wheel k about its centre, its imbalance left out."""
    assert n.wheel_inertia is not None
    return bodies.theta(WHEEL_MASS, np.zeros(3), n.wheel_inertia[k] * np.diag(0.5 + 0.5 * np.eye(3)[k]))


def bus_theta(n: Numbers) -> Array:
    """Parameters (10,) of what is left of the bus when everything that moves on its own is taken out."""
    out = np.array(n.body["bus"])
    if n.wheel_inertia is not None:
        for k in range(3):
            mass, _, inertia = bodies.split(wheel_theta(n, k))
            out -= bodies.theta(mass, np.array(n.wheel_position), inertia)
    if n.plate is not None:
        p, root = n.plate, np.array(n.plate_root)
        square = p.length**2 / 12, p.width**2 / 12, p.thickness**2 / 12
        about = p.mass * np.diag([square[1] + square[2], square[0] + square[2], square[0] + square[1]])
        out += bodies.theta(p.mass, root + np.array([p.length / 2, 0, 0]), about)
        for t, r in zip(p.translation, p.rotation, strict=True):
            out -= bodies.theta(t**2, root + np.array([r / t, 0, 0]), TINY * np.eye(3))
    for _ in n.tanks:
        out[4:] -= TINY * bodies.six(np.eye(3))
    return out


def write(n: Numbers, step: float) -> str:
    """MJCF of the world; step [s] of RK4."""
    children, motors = [], []
    if n.wheel_inertia is not None:
        for k, name in enumerate(WHEELS):
            axis, theta = np.eye(3)[k], wheel_theta(n, k)
            theta[1:4] += n.wheel_static[k] * np.roll(axis, 1)
            children.append(
                f'<body name="{name}" pos="{text(n.wheel_position)}">'
                f'<joint name="{name}" type="hinge" axis="{text(axis)}"/>{inertial(theta)}</body>'
            )
    children.append(_arm(n))
    tiny = TINY * np.eye(3)
    for tank in n.tanks:
        slides = "".join(
            f'<joint name="{tank.name}.{a}" type="slide" axis="{text(axis)}" '
            f'stiffness="{float(k)!r}" damping="{float(d)!r}"/>'
            for a, axis, k, d in zip("xyz", np.eye(3), tank.stiffness, tank.damping, strict=True)
        )
        mass = inertial(bodies.theta(tank.mass, np.zeros(3), tiny))
        children.append(f'<body name="{tank.name}" pos="{text(tank.position)}">{slides}{mass}</body>')
    children += [_mode(k, mode) for k, mode in enumerate(n.plate_modes(), start=1)]
    inner = "\n".join("      " + c for c in children)
    if n.free:
        base = f'    <body name="bus">\n      <freejoint/>\n      {inertial(bus_theta(n))}\n'
        base += f'      <site name="thrust"/>\n{inner}\n    </body>'
        for axis in np.eye(3):
            motors.append(f'<motor site="thrust" gear="{text([*axis, 0, 0, 0])}"/>')
    else:
        base = f'    <body name="bus">\n      <site name="thrust"/>\n{inner}\n    </body>'
    turning = [*(WHEELS if n.wheel_inertia is not None else ()), *JOINTS]
    motors += [f'<motor joint="{name}" gear="1"/>' for name in turning]
    return FRAME.format(
        gravity=text(n.gravity), step=step, bodies=base, motors="\n".join("    " + m for m in motors)
    )


def _arm(n: Numbers) -> str:
    out, place = "", n.mount
    for k, (link, joint) in enumerate(zip(LINKS, JOINTS, strict=True)):
        axis, theta = text(AXES[joint]), n.body[link]
        armature = f' armature="{float(n.armature[k])!r}"' if n.armature[k] else ""
        drive = n.drivetrain.get(joint)
        if drive is None:
            hinge = f'<joint name="{joint}" type="hinge" axis="{axis}"{armature}/>'
            out += f'<body name="{link}" pos="{text(place)}">{hinge}{inertial(theta)}'
        else:
            out += _rotor(joint, axis, text(place), drive)
            out += f'<body name="{link}">{_spring(joint, axis, drive)}'
            out += inertial(theta - rotor_theta(joint, drive.rotor))
        place = TIPS[link]
    closing = sum(2 if joint in n.drivetrain else 1 for joint in JOINTS)
    return out + "</body>" * closing


def _rotor(joint: str, axis: str, place: str, drive: Drivetrain) -> str:
    hinge = f'<joint name="{joint}" type="hinge" axis="{axis}"/>'
    return f'<body name="{joint}.rotor" pos="{place}">{hinge}{inertial(rotor_theta(joint, drive.rotor))}'


def _spring(joint: str, axis: str, drive: Drivetrain) -> str:
    stiffness = 1.0 / drive.compliance
    damping = 2 * drive.damping * np.sqrt(stiffness * drive.rotor)
    return (
        f'<joint name="{joint}.flex" type="hinge" axis="{axis}" stiffness="{float(stiffness)!r}" '
        f'damping="{float(damping)!r}"/>'
    )


def _mode(k: int, mode: Mode) -> str:
    spring = float(mode.mass * mode.omega**2)
    damper = float(2 * mode.damping * mode.omega * mode.mass)
    joint = f'<joint name="mode{k}" type="slide" axis="0 0 1" stiffness="{spring!r}" damping="{damper!r}"/>'
    mass = inertial(bodies.theta(mode.mass, np.zeros(3), TINY * np.eye(3)))
    return f'<body name="mode{k}" pos="{text(mode.at)}">{joint}{mass}</body>'
