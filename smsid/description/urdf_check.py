"""Checks of a URDF before Pinocchio sees it: errors that name the link and say what to mend."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from smsid.errors import DescriptionError


def read_urdf(path: Path) -> str:
    """Return the text of a URDF; raises `DescriptionError` if missing or not XML."""
    if not path.is_file():
        raise DescriptionError(f"The URDF '{path}' does not exist.", advice="Check the `urdf` key of the TOML.")
    text = path.read_text(encoding="utf-8")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise DescriptionError(
            f"'{path}' is not well-formed XML: {error}.", advice="Is the file cut short? Mend the line it names."
        ) from error
    if root.tag != "robot" or root.find("link") is None:
        raise DescriptionError(f"'{path}' is no URDF: it needs a <robot> with links.")
    return text


def check_inertias(text: str, source: str) -> None:
    """Raise `DescriptionError` for a negative mass or an inertia no rigid body can have.

    A principal moment may be zero (a thin rod), but not negative, and no moment may exceed the sum of the other
    two (triangle inequality), to one part in 1e3 of the largest.
    """
    for link in ElementTree.fromstring(text).iter("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        name = link.get("name")
        mass_tag, tag = inertial.find("mass"), inertial.find("inertia")
        if mass_tag is None or tag is None:
            raise DescriptionError(
                f"Link '{name}' of {source} has an <inertial> without <mass> or <inertia>.", advice="Give both."
            )
        mass = float(mass_tag.get("value", "nan"))
        if not np.isfinite(mass) or mass < 0.0:
            raise DescriptionError(
                f"Link '{name}' of {source} has mass {mass} kg.",
                advice="A mass must be zero or positive.",
                link=name,
                mass=mass,
            )
        ixx, ixy, ixz, iyy, iyz, izz = (float(tag.get(k, "0")) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
        matrix = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
        if not np.isfinite(matrix).all():
            raise DescriptionError(f"The inertia of link '{name}' of {source} is not finite.", link=name)
        moments = np.linalg.eigvalsh(matrix)
        slack = 1e-3 * max(abs(moments[-1]), 1e-12)
        if moments[0] < -slack or moments[2] > moments[0] + moments[1] + slack:
            raise DescriptionError(
                f"The inertia of link '{name}' of {source} is impossible: principal moments "
                f"{', '.join(f'{m:.4g}' for m in moments)} kg m^2.",
                advice="Moments must be positive, none larger than the sum of the other two; check the "
                "signs of the products and whether it is taken about the centre of mass.",
                link=name,
                moments=moments,
            )


def check_meshes(text: str, source: str, folders: Iterable[Path]) -> None:
    """Raise `DescriptionError` if a mesh the URDF names is in none of the folders."""
    places = list(folders)
    for link in ElementTree.fromstring(text).iter("link"):
        for mesh in link.iter("mesh"):
            name = mesh.get("filename", "")
            relative = name.removeprefix("package://").removeprefix("file://")
            if Path(relative).is_file() or any((place / relative).is_file() for place in places):
                continue
            raise DescriptionError(
                f"Mesh '{name}' of link '{link.get('name')}' in {source} is missing.",
                advice="Add its folder to `package_dirs`, or set `meshes = \"ignored\"` to do without visuals.",
                mesh=name,
                searched=[str(p) for p in places],
            )
