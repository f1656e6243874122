"""A first description of a craft, with comments, to be filled in."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from smsid.errors import DescriptionError

MOVING = ("revolute", "prismatic", "continuous")


@dataclass(frozen=True)
class DraftArm:
    """An arm of a new craft: the path of its URDF, or a ``robot`` of example-robot-data; its moving joints,
    the ``home`` of those that cannot be at zero [rad | m], and those that only follow another (``fixed``).
    """

    source: str
    robot: bool = False
    joints: tuple[str, ...] = ()
    home: tuple[tuple[str, float], ...] = ()
    fixed: tuple[str, ...] = ()

    def toml(self, name: str, place: float) -> str:
        """Return the arm's table, its root link at ``place`` on the bus's y-axis [m]."""
        key = "robot" if self.robot else "urdf"
        shown = ", ".join(f"{_key(joint)} = 0.0" for joint in self.joints[:3])
        if self.home:
            angles = ", ".join(f"{_key(joint)} = {value:.3g}" for joint, value in self.home)
            home = f"home = {{ {angles} }}  # GUESS: the middle of limits that exclude zero\n"
        else:
            home = f"# home = {{ {shown} }}  # angles it starts from; others are zero\n"
        welded = json.dumps(list(self.fixed or self.joints[-1:]))
        fixed = f"{'' if self.fixed else '# '}fixed = {welded}  # joints that are welded\n"
        return (
            f'[[arm]]\nname = "{name}"\n{key} = {json.dumps(self.source)}\n'
            f"mount = {{ xyz = [0.0, {place:g}, 0.0] }}  # GUESS: where its root link sits\n{home}{fixed}"
        )


def draft_arm(source: str) -> DraftArm:
    """Return an arm by the path of its URDF or by its name in example-robot-data.

    Raises `DescriptionError` for a file that is no URDF and an unknown name, `MissingDependencyError` for a
    name without example-robot-data.
    """
    from smsid.description.robots import robot_urdf
    from smsid.description.urdf_check import read_urdf
    from smsid.description.urdf_reading import parse_urdf

    robot = not Path(source).is_file() and not Path(source).suffix and "\\" not in source
    path = robot_urdf(source)[0] if robot else Path(source)
    if not path.is_file():
        raise DescriptionError(f"The file '{source}' does not exist.", advice="Check the path of --arm.")
    moving = [j for j in parse_urdf(read_urdf(path), path.name).joints.values() if j.kind in MOVING]
    own = [j for j in moving if j.mimic is None]
    home = [
        (j.name, (j.lower + j.upper) / 2)
        for j in own
        if j.lower is not None and j.upper is not None and j.lower < j.upper and not j.lower <= 0 <= j.upper
    ]
    followers = tuple(j.name for j in moving if j.mimic is not None)
    place = source if robot else path.as_posix()
    return DraftArm(place, robot, tuple(j.name for j in own), tuple(home), followers)


@dataclass(frozen=True)
class Draft:
    """What a new craft has: ``arms``, numbers of ``wheels`` and ``tanks``, and a ``panel`` of length by width
    [m]; its bus is a cube of uniform density with ``mass`` [kg] and edge ``size`` [m].
    """

    name: str
    arms: tuple[DraftArm, ...] = ()
    wheels: int = 3
    tanks: int = 0
    panel: tuple[float, float] | None = None
    mass: float = 200.0
    size: float = 1.0

    def urdf(self) -> str:
        """Return the bus as a URDF."""
        moment = self.mass * self.size**2 / 6.0
        return f"""<?xml version="1.0"?>
<!-- The bus: a uniform cube of {self.size:g} m and {self.mass:g} kg. GUESS: replace its inertia. -->
<robot name="{self.name}_bus">
  <link name="bus">
    <inertial>
      <origin xyz="0 0 0" rpy="0 0 0"/>
      <mass value="{self.mass!r}"/>
      <inertia ixx="{moment!r}" iyy="{moment!r}" izz="{moment!r}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual><geometry><box size="{self.size:g} {self.size:g} {self.size:g}"/></geometry></visual>
  </link>
</robot>
"""

    def toml(self) -> str:
        """Return the description beside it; raises `DescriptionError` for fewer than no wheels."""
        if self.wheels < 0:
            raise DescriptionError(f"A craft cannot have {self.wheels} wheels.", advice="Give 0 or more.")
        half = self.size / 2
        parts = [
            "# Units are SI, angles radians, positions in the bus frame. Replace lines marked GUESS.\n"
            f'schema = 1\nname = "{self.name}"\nurdf = "{self.name}_bus.urdf"\n'
            'meshes = "ignored"  # "required" to show and check the meshes of the URDFs\n\n'
            "[thrust]\npoint = [0.0, 0.0, 0.0]  # GUESS: where the net thrust acts [m]\n"
            f"max_force = {0.02 * self.mass:.3g}  # GUESS: limit per axis [N]\n"
        ]
        for i, arm in enumerate(self.arms):
            name = "arm" if len(self.arms) == 1 else f"arm{i + 1}"
            parts.append(arm.toml(name, half if i % 2 == 0 else -half))
        for i, axis in enumerate(_wheel_axes(self.wheels)):
            inertia = 1e-4 * self.mass * self.size**2
            parts.append(
                f'[[wheel]]\nname = "wheel_{i + 1}"\naxis = [{", ".join(f"{x:.6g}" for x in axis)}]\n'
                f"inertia = {inertia:.3g}  # GUESS: spin inertia [kg m^2]\n"
                f"max_torque = {10 * inertia:.3g}  # GUESS [N m]\nmax_rate = 400.0  # GUESS [rad/s]\n"
            )
        for i in range(self.tanks):
            mass = 0.05 * self.mass / self.tanks
            name = "tank" if self.tanks == 1 else f"tank{i + 1}"
            height = self.size * ((i + 0.5) / self.tanks - 0.5)
            parts.append(
                f'[[effect]]\nkind = "slosh"\nname = "{name}"\n'
                f"position = [0.0, 0.0, {height:g}]  # GUESS [m]\n"
                f"mass = {mass:.3g}  # GUESS: what of the fuel moves [kg]\n"
                f"stiffness = [{', '.join([f'{mass * 0.5**2:.3g}'] * 3)}]  # GUESS: 0.5 rad/s [N/m]\n"
                f"damping = [{', '.join([f'{mass * 0.02:.3g}'] * 3)}]  # GUESS: 2 % [N s/m]\n"
            )
        sensors = ["pose", "imu", "encoder" if self.arms else "", "tachometer" if self.wheels else ""]
        if self.panel is not None:
            length, width = self.panel
            parts.append(
                '[[effect]]\nkind = "beam_appendage"\nname = "panel"\n'
                f"position = [{half:g}, 0.0, 0.0]  # its root; it reaches along x\n"
                f"length = {length!r}\nwidth = {width!r}\nthickness = 0.002  # GUESS [m]\n"
                "density = 2700.0  # GUESS [kg/m^3]\nyoungs_modulus = 70e9  # GUESS [Pa]\n"
                "damping = 0.005  # GUESS\nmodes = 3\n"
                f"stations = [{length / 3:g}, {2 * length / 3:g}, {length!r}]  # accelerometers [m]\n"
            )
        for kind in filter(None, sensors):
            parts.append(f'[[sensor]]\nname = "{kind}"\nkind = "{kind}"\npreset = "reference"\n')
        if self.panel is not None:
            parts.append(
                '[[sensor]]\nname = "panel"\nkind = "accelerometers"\nappendage = "panel"\n'
                'preset = "reference"\n'
            )
        return "\n".join(parts)


def _wheel_axes(count: int) -> list[tuple[float, float, float]]:
    """Along x, y, z for up to three wheels, else a pyramid about z."""
    if count <= 3:
        return [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)][:count]
    from math import cos, pi, sin, sqrt

    turns = [2 * pi * (k + 0.5) / count for k in range(count)]
    return [(cos(t) * sqrt(2 / 3), sin(t) * sqrt(2 / 3), sqrt(1 / 3)) for t in turns]


def _key(name: str) -> str:
    """Return a TOML key, quoted where it is not bare."""
    bare = name.replace("_", "").replace("-", "")
    return name if bare.isascii() and bare.isalnum() else json.dumps(name)
