"""Finding the robots of example-robot-data: its URDFs by name, whatever its version.

Versions up to 5 have a Python module with loaders, version 6 is data only; the folder of URDFs is the same
in all.
"""

from __future__ import annotations

import difflib
import os
import sys
from importlib import metadata
from pathlib import Path

from smsid.errors import DescriptionError, MissingDependencyError

NEAREST = 5  # names that a message holds
FOLDER = Path("share") / "example-robot-data" / "robots"


def robots_folder() -> Path:
    """Return the folder of example-robot-data's robots, installed by pip, conda or apt.

    Raises `MissingDependencyError` when it is not installed.
    """
    places = []
    try:
        files = metadata.distribution("example-robot-data").files or []
    except metadata.PackageNotFoundError:
        files = []
    for file in files:
        if file.parts[-2:] == ("example-robot-data", "package.xml"):
            places.append(Path(os.fspath(file.locate())).parent / "robots")
    places += [Path(prefix) / FOLDER for prefix in (sys.prefix, "/usr", "/usr/local", "/opt/openrobots")]
    for place in places:
        if place.is_dir():
            return place
    raise MissingDependencyError(
        "example-robot-data is not installed.",
        advice="Install it with: pip install 'smsid[robots]'",
        searched=[str(p) for p in places],
    )


def robot_files(folder: Path | None = None) -> dict[str, Path]:
    """Return the URDFs by name.

    A robot's name is that of its file without ``_robot`` (``panda``, ``talos_reduced``, ``ur5``), and as well
    that of its folder without ``_description`` where that holds one URDF (``xarm``). A file whose name
    another has too is called ``<folder>/<file>`` (``anymal_b_simple/anymal``).
    """
    named: dict[str, list[Path]] = {}
    families: dict[str, list[Path]] = {}
    for file in sorted((folder or robots_folder()).rglob("*.urdf")):
        named.setdefault(file.stem.removesuffix("_robot"), []).append(file)
        families.setdefault(_family(file), []).append(file)
    found = {}
    for name, paths in named.items():
        first = [p for p in paths if p.stem != name] if len(paths) > 1 else paths
        if len(first) == 1:
            found[name] = first[0]
        found.update({f"{_family(p)}/{p.stem}": p for p in paths if p not in first or len(first) > 1})
    for name, paths in families.items():
        if len(paths) == 1:
            found.setdefault(name, paths[0])
    return found


def robot_urdf(name: str) -> tuple[Path, list[Path]]:
    """Return a robot's URDF and the folders its meshes are looked for in.

    Raises `DescriptionError` for an unknown name, `MissingDependencyError` without example-robot-data.
    """
    folder = robots_folder()
    robots = robot_files(folder)
    if name not in robots:
        near = difflib.get_close_matches(name.lower(), robots, n=NEAREST, cutoff=0.0)
        raise DescriptionError(
            f"example-robot-data has no robot '{name[:80]}'.",
            advice=f"The nearest of its {len(robots)} names: {', '.join(near)}.",
            robot=name,
        )
    return robots[name], [folder.parent.parent, folder, robots[name].parent]


def _family(file: Path) -> str:
    """Name of the robot's own folder, ``<family>_description/urdf/<robot>.urdf``."""
    return file.parent.parent.name.removesuffix("_description").removesuffix("_data")
