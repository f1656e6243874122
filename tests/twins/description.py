"""The same numbers as files for the project under test: a URDF and its TOML, and its velocity ordering.

Text and index arithmetic only; nothing here imports the project.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .numbers import Inertia, Spacecraft, Vector
from .state import Array, Inputs, State

TOML = """schema = 1
name = "twin"
urdf = "twin.urdf"

[[arm]]
name = "arm"
joints = ["joint1", "joint2", "joint3"]
{wheels}
[[effect]]
kind = "slosh"
name = "tank"
position = {n.slosh_centre}
mass = {n.slosh_mass!r}
stiffness = {n.slosh_stiffness}
damping = {n.slosh_damping}

[[effect]]
kind = "beam_appendage"
name = "panel"
position = {n.panel_root}
length = {n.panel.length!r}
width = {n.panel.width!r}
thickness = {n.panel.thickness!r}
density = {n.panel.density!r}
youngs_modulus = {n.panel.young!r}
damping = {n.panel.damping_ratio!r}
modes = {n.panel.modes}
stations = {n.stations}
"""


def write_description(numbers: Spacecraft, folder: Path) -> Path:
    """Write `twin.urdf` and `twin.toml` into `folder` and return the path of the TOML."""
    n = numbers
    parts = [f'<link name="bus">{_inertial(n.base_mass, (0.0, 0.0, 0.0), n.base_inertia)}</link>']
    place, rpy, parent = n.arm_mount, n.arm_rpy, "bus"
    for k, link in enumerate(n.links, start=1):
        axis = " ".join(str(int(link.axis == name)) for name in "xyz")
        parts.append(
            f'<joint name="joint{k}" type="revolute"><parent link="{parent}"/><child link="link{k}"/>'
            f'<origin xyz="{_text(place)}" rpy="{_text(rpy)}"/><axis xyz="{axis}"/>'
            f'<limit lower="-4" upper="4" velocity="9" effort="99"/></joint>'
            f'<link name="link{k}">{_inertial(link.mass, link.centre, link.inertia)}</link>'
        )
        place, rpy, parent = link.tip, (0.0, 0.0, 0.0), f"link{k}"
    (folder / "twin.urdf").write_text(f'<robot name="twin">{"".join(parts)}</robot>\n')
    wheels = ""
    for k, spin in enumerate(n.wheel_inertia):
        wheels += f'\n[[wheel]]\nname = "wheel{k}"\naxis = {np.eye(3)[k].tolist()}\ninertia = {spin!r}\n'
    vectors = TOML.format(n=n, wheels=wheels).replace("(", "[").replace(")", "]")
    (folder / "twin.toml").write_text(vectors)
    return folder / "twin.toml"


def _text(values: Vector) -> str:
    return " ".join(repr(v) for v in values)


def _inertial(mass: float, centre: Vector, inertia: Inertia) -> str:
    six = zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), inertia, strict=True)
    entries = " ".join(f'{name}="{value!r}"' for name, value in six)
    return f'<inertial><origin xyz="{_text(centre)}"/><mass value="{mass!r}"/><inertia {entries}/></inertial>'


@dataclass(frozen=True)
class Ordering:
    """Where the 18 velocities of this package are in the v and q of a `SpacecraftModel`-like object."""

    model: Any

    @property
    def turn(self) -> Array:
        """(nv, 18) matrix: v of the model = turn @ `State.velocity`; modal joints carry delta / scale."""
        m = self.model
        index = [*range(6), *m.wheels.v, *m.arm_joints.v, *np.arange(m.nv)[m.slosh[0].v], *m.modes.v]
        turn = np.zeros((m.nv, 18))
        turn[index, np.arange(18)] = [*np.ones(15), *(1.0 / m.mode_scale)]
        return turn

    def q(self, state: State) -> Array:
        """(nq,) configuration of the model."""
        m = self.model
        q = np.zeros(m.nq)
        q[:7] = [*state.position, *state.quaternion]
        q[m.wheels.q], q[m.arm_joints.q] = state.wheel, state.q
        q[m.slosh[0].q], q[m.modes.q] = state.rho, state.delta / m.mode_scale
        return q

    def v(self, state: State) -> Array:
        """(nv,) velocity of the model."""
        return self.turn @ state.velocity

    def tau(self, inputs: Inputs) -> Array:
        """(nv,) generalised force of the model; what acts on the modes is zero."""
        return self.turn @ inputs.generalized

    def back(self, vdot: Array) -> Array:
        """(18,) derivative of `State.velocity` from the model's vdot (nv,)."""
        return np.linalg.solve(self.turn, vdot)
