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
class CraftDraft:
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
        return _fill_template("bus.urdf", d=self)

    def toml(self) -> str:
        """Return the description beside it; raises `DescriptionError` for fewer than no wheels."""
        if self.wheels < 0:
            raise DescriptionError(f"A craft cannot have {self.wheels} wheels.", advice="Give 0 or more.")
        axes, half = _wheel_axes(self.wheels), self.size / 2
        return _fill_template("craft.toml", d=self, axes=axes, half=half, key=_key, quoted=json.dumps)


def _fill_template(name: str, **values: object) -> str:
    """Return a template of this package, filled in."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    found = Environment(
        loader=PackageLoader("smsid.description"), undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    return found.get_template(name).render(**values)


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
