"""Does the model that Pinocchio built say what the URDF says?"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from smsid.description.urdf_reading import JointReading, LinkReading, UrdfReading
from smsid.errors import DescriptionError

CLOSE = 1e-9
"""Largest difference between file and model, relative to the size of what is compared."""
DOF = {"revolute": 1, "continuous": 1, "prismatic": 1, "planar": 3, "floating": 6}


def check_built(model: pin.Model, reading: UrdfReading, *, free: bool) -> None:
    """Compare every link's inertia and every joint's frame, axis and limits with the file.

    ``model`` is what was built of the URDF alone, on a free joint if ``free``.

    Raises:
        DescriptionError: anything differs: names link or joint and element, with both values.
    """
    inertias = {1 if free else 0: np.zeros(10)}
    members: dict[int, list[str]] = {}
    carried: dict[str, tuple[int, pin.SE3]] = {reading.root: (1 if free else 0, pin.SE3.Identity())}
    waiting = list(reading.joints.values())
    while waiting:
        ready = [j for j in waiting if j.parent in carried]
        if not ready:  # read_urdf refuses loops
            raise DescriptionError(f"Joints of {reading.source} hang on no root.", advice="Close the tree.")
        for joint in ready:
            parent, placement = carried[joint.parent]
            placement = placement * pin.SE3(joint.rotation, joint.position)
            if joint.kind == "fixed":
                carried[joint.child] = parent, placement
                continue
            carried[joint.child] = (
                _check_joint(model, joint, parent, placement, reading.source),
                (pin.SE3.Identity()),
            )
        waiting = [j for j in waiting if j.child not in carried]
    for name, (body, placement) in carried.items():
        members.setdefault(body, []).append(name)
        theta = inertias.setdefault(body, np.zeros(10))
        theta += _parameters(reading.links[name], placement)
    for body, theta in inertias.items():
        if body:  # the root of a welded robot moves nothing
            _check_body(model, body, theta, [reading.links[n] for n in members[body]], carried, reading)


def _check_joint(model: pin.Model, joint: JointReading, parent: int, placement: pin.SE3, source: str) -> int:
    """Return the joint's index in the model."""
    if not model.existJointName(joint.name):
        _differs(f"Joint '{joint.name}'", source, "", "in the file", "missing")
    index = model.getJointId(joint.name)
    built = model.joints[index]
    place = f"Joint '{joint.name}'"
    if built.nv != DOF[joint.kind]:
        _differs(place, source, "type", joint.kind, built.shortname())
    if model.parents[index] != parent:
        _differs(place, source, "<parent>", joint.parent, model.names[model.parents[index]])
    frame = model.jointPlacements[index]
    size = max(1.0, float(np.abs(placement.translation).max()))
    if not (
        np.allclose(frame.translation, placement.translation, atol=CLOSE * size, rtol=0.0)
        and np.allclose(frame.rotation, placement.rotation, atol=CLOSE, rtol=0.0)
    ):
        _differs(place, source, "<origin>", placement.translation, frame.translation)
    if built.nv != 1:
        return index
    data = built.createData()
    built.calc(data, pin.neutral(model))
    motion = np.asarray(data.S).reshape(6)
    expected = np.zeros(6)
    expected[slice(0, 3) if joint.kind == "prismatic" else slice(3, 6)] = joint.axis
    if not np.allclose(motion, expected, atol=CLOSE, rtol=0.0):
        _differs(place, source, "<axis>", joint.axis, motion[:3] if joint.kind == "prismatic" else motion[3:])
    pairs = [
        ("effort", joint.effort, model.effortLimit[built.idx_v]),
        ("velocity", joint.velocity, model.velocityLimit[built.idx_v]),
    ]
    if joint.kind != "continuous":
        pairs += [
            ("lower", joint.lower, model.lowerPositionLimit[built.idx_q]),
            ("upper", joint.upper, model.upperPositionLimit[built.idx_q]),
        ]
    for key, said, has in pairs:
        if said is None:
            continue
        if not (np.isinf(said) and abs(has) > 1e300) and not np.isclose(has, said, rtol=CLOSE, atol=0.0):
            _differs(place, source, f"<limit {key}>", said, has)
    return index


def _check_body(
    model: pin.Model,
    body: int,
    theta: np.ndarray,
    links: list[LinkReading],
    carried: dict[str, tuple[int, pin.SE3]],
    reading: UrdfReading,
) -> None:
    built = np.asarray(model.inertias[body].toDynamicParameters())
    size = np.array([theta[0], *[np.abs(theta[1:4]).max()] * 3, *[np.abs(theta[4:]).max()] * 6])
    if (np.abs(built - theta) <= CLOSE * np.maximum(size, 1e-12)).all():
        return
    missing = theta - built  # one link alone often explains it
    guilty = [
        link.name
        for link in links
        if np.allclose(_parameters(link, carried[link.name][1]), missing, rtol=1e-6, atol=1e-12)
    ] or [link.name for link in links if link.mass > 0.0]
    what = (
        ("<mass>", theta[0], built[0])
        if not np.isclose(built[0], theta[0], rtol=CLOSE)
        else ("first moment of <inertial>", theta[1:4], built[1:4])
        if not np.allclose(built[1:4], theta[1:4], rtol=0.0, atol=CLOSE * max(size[1], 1e-12))
        else ("<inertia>", theta[4:], built[4:])
    )
    named = ", ".join(f"'{n}'" for n in guilty)
    _differs(f"Link{'s' if len(guilty) > 1 else ''} {named}", reading.source, *what)


def _parameters(link: LinkReading, placement: pin.SE3) -> np.ndarray:
    """Inertial parameters (10,) about the origin of the joint that carries the link."""
    centre = placement.act(link.centre)
    about = placement.rotation @ link.inertia @ placement.rotation.T
    about = about + link.mass * ((centre @ centre) * np.eye(3) - np.outer(centre, centre))
    xx, xy, xz, _, yy, yz, _, _, zz = about.ravel()
    return np.array([link.mass, *(link.mass * centre), xx, xy, yy, xz, yz, zz])


def _differs(place: str, source: str, element: str, said: object, has: object) -> None:
    raise DescriptionError(
        f"{place} of {source}: {element} is {_shown(said)} in the file and {_shown(has)} in the model built.",
        advice="Pinocchio read the file otherwise than it is written: simplify that element, and please "
        "report it.",
        file=said,
        model=has,
    )


def _shown(value: object) -> str:
    if isinstance(value, np.ndarray):
        return "(" + ", ".join(f"{x:.6g}" for x in value) + ")"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
