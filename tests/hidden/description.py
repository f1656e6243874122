"""A world as files for the project under test: URDF, TOML, estimate.json. Text only."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from . import bodies
from .numbers import AXES, JOINTS, LINKS, TIPS, WHEELS, Nominal, Numbers, nominal
from .sensors import NOISE, channel_names

RATE = 20.0
GEOMETRY = ("length", "width", "thickness")  # of the panel: known


def write_urdf(n: Numbers, path: Path) -> None:
    """The rigid part; the arm's limits are wide."""
    parts = [f'<link name="bus">{_inertial(n.body["bus"])}</link>']
    parent, place = "bus", n.mount
    for link, joint in zip(LINKS, JOINTS, strict=True):
        parts.append(
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{link}"/>'
            f'<origin xyz="{_text(place)}"/><axis xyz="{_text(AXES[joint])}"/>'
            f'<limit lower="-3.1" upper="3.1" velocity="5" effort="2000"/></joint>'
            f'<link name="{link}">{_inertial(n.body[link])}</link>'
        )
        parent, place = link, TIPS[link]
    parts.append(
        f'<joint name="tool_mount" type="fixed"><parent link="link3"/><child link="tool"/>'
        f'<origin xyz="{_text(place)}"/></joint><link name="tool"/>'
    )
    path.write_text(f'<robot name="{n.name}">\n' + "\n".join(parts) + "\n</robot>\n")


def write_description(n: Numbers, folder: Path, noise: dict[str, float] | None = None) -> Path:
    """Write the description of the numbers into `folder`; returns the TOML. `noise`: levels it states."""
    write_urdf(n, folder / f"{n.name}.urdf")
    sigma = {**NOISE, **(noise or {})}
    home = ", ".join(f"{j} = {a!r}" for j, a in zip(JOINTS, n.start, strict=True))
    lines = ["schema = 1", f'name = "{n.name}"', f'urdf = "{n.name}.urdf"']
    if not n.free:
        lines += ['root = "fixed"', f"gravity = {list(n.gravity)}"]
    lines += ["", "[[arm]]", 'name = "arm"', f"joints = {json.dumps(JOINTS)}", f"home = {{ {home} }}"]
    if n.free:
        lines += ["", "[thrust]", "point = [0.0, 0.0, 0.0]"]
    if n.wheel_inertia is not None:
        for name, axis, spin in zip(WHEELS, np.eye(3).tolist(), n.wheel_inertia, strict=True):
            lines += ["", "[[wheel]]", f'name = "{name}"', f"axis = {axis}"]
            lines += [f"position = {list(n.wheel_position)}", f"inertia = {float(spin)!r}"]
    for tank in n.tanks:
        lines += ["", "[[effect]]", 'kind = "slosh"', f'name = "{tank.name}"']
        lines += [f"position = {_list(tank.position)}", f"mass = {float(tank.mass)!r}"]
        lines += [f"stiffness = {_list(tank.stiffness)}", f"damping = {_list(tank.damping)}"]
    if n.plate is not None:
        p = n.plate
        lines += ["", "[[effect]]", 'kind = "beam_appendage"', 'name = "panel"']
        lines += [f"position = {list(n.plate_root)}", f"stations = {list(n.stations)}"]
        lines += [
            f"length = {float(p.length)!r}",
            f"width = {float(p.width)!r}",
            f"thickness = {float(p.thickness)!r}",
        ]
        lines += [f"density = {float(p.density)!r}", f"youngs_modulus = {float(p.young)!r}"]
        lines += [f"damping = {float(p.damping_ratio)!r}", f"modes = {p.modes}"]
    kinds = {"panel": "accelerometers"}
    for source in dict.fromkeys(c.split(".")[0] for c in channel_names(n)):
        lines += ["", "[[sensor]]", f'name = "{source}"', f'kind = "{kinds.get(source, source)}"']
        lines.append(f"rate = {RATE!r}")
        if source in ("pose", "imu"):
            lines.append(f"position = {list(n.point)}")
        if source == "panel":
            lines.append('appendage = "panel"')
        for channel in channel_names(n):
            owner, quantity = channel.split(".")
            if owner == source:
                lines.append(f"errors.{quantity} = {{ noise_sigma = {sigma[channel]!r} }}")
    path = folder / f"{n.name}.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def write_estimate(n: Numbers, path: Path) -> Path:
    """The nominal parameters with their standard deviations, as `smsid identify -o` writes an estimate."""
    tables = []
    known = [Nominal(f"panel.{k}", getattr(n.plate, k), "m", 1e-6) for k in GEOMETRY] if n.plate else []
    for p in (*nominal(n), *known):
        good = p.sigma < 0.1 * abs(p.value)
        tables.append(
            {
                "name": p.name,
                "value": p.value,
                "unit": p.unit,
                "sigma": p.sigma,
                "status": "identifiable" if good else "not_identifiable",
                "group": "known",
                "nominal": p.value,
                "reference": None,
                "small": False,
                "note": "",
                "interval": [p.value - 1.959964 * p.sigma, p.value + 1.959964 * p.sigma],
                "interval_level": 0.95,
            }
        )
    document = {
        "schema": 1,
        "kind": "estimate",
        "smsid": "0",
        "description": n.name,
        "method": "maximum_likelihood",
        "recordings": [],
        "parameters": tables,
        "timing": {},
        "conditions": {},
        "notes": [],
    }
    path.write_text(json.dumps(document, indent=1))
    return path


def _list(values: ArrayLike) -> str:
    return repr([float(v) for v in np.ravel(values)])


def _text(values: ArrayLike) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def _inertial(theta: np.ndarray) -> str:
    mass, centre, inertia = bodies.split(np.asarray(theta))
    assert math.isfinite(mass)
    names = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")
    entries = " ".join(f'{k}="{float(v)!r}"' for k, v in zip(names, bodies.six(inertia), strict=True))
    return f'<inertial><origin xyz="{_text(centre)}"/><mass value="{mass!r}"/><inertia {entries}/></inertial>'
