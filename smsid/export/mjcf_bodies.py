"""A moving body in MuJoCo XML: its joint's axes, and mass and inertia that MuJoCo accepts.

MuJoCo wants mass and a proper inertia on every moving body. Where a body lacks them, some are lent from its
parent in a way that leaves the motion as it was: rotational inertia to a body that only slides, mass on the
axis and inertia across it to a body that only turns.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from smsid.effects.inertial_parameters import move_parameters, parameters_to_matrix
from smsid.errors import DescriptionError

LENT = 1e-6
"""[kg], [kg m^2] lent to bodies that lack it."""
POINT = 1e-9
"""Inertia of a point mass that turns about an axis beside it, over what it has about that axis."""


def joint_axes(p: pin.Model) -> dict[int, np.ndarray]:
    """Return the motion subspace (6, nv) of every joint, linear parts first, in the joint's axes.

    Raises:
        DescriptionError: a joint that is not free, a hinge, a slide or three slides.
    """
    data = p.createData()
    pin.forwardKinematics(p, data, pin.neutral(p), np.zeros(p.nv))
    found = {}
    for j in range(1, p.njoints):
        s = np.asarray(data.joints[j].S).reshape(6, -1)
        simple = s.shape[1] == 1 and not (s[:3].any() and s[3:].any())
        if not (simple or p.joints[j].nq == 7 or p.joints[j].shortname() == "JointModelTranslation"):
            raise DescriptionError(
                f"Joint '{p.names[j]}' is a {p.joints[j].shortname()}, which MuJoCo does not have.",
                advice="Export without the MuJoCo XML (--no-mujoco).",
                joint=p.names[j],
            )
        found[j] = s
    return found


def stacked_joints(p: pin.Model) -> dict[int, int]:
    """Return the joints whose body has no inertia and carries one other, by number, with that other.

    The other body has both joints in MuJoCo, as those of a hip or a wrist that turns about a point.
    """
    children: dict[int, list[int]] = {}
    for j in range(1, p.njoints):
        children.setdefault(int(p.parents[j]), []).append(j)
    return {
        j: children[j][0]
        for j in range(1, p.njoints)
        if len(children.get(j, ())) == 1
        and p.joints[j].nv == 1
        and not p.inertias[j].toDynamicParameters().any()
    }


def with_lent_inertia(p: pin.Model, axes: dict[int, np.ndarray]) -> list[np.ndarray]:
    """Return every joint's inertia, parameters (10,) in Pinocchio's order, with what lacks it lent.

    ``axes``: as from `joint_axes`. The motion of the whole is the same; to `POINT` where a point mass swings
    about an axis, whose inertia nothing can lend.

    Raises:
        DescriptionError: a body without inertia carries bodies that lack it, too.
    """
    theta = [np.asarray(i.toDynamicParameters()) for i in p.inertias]
    stacked = stacked_joints(p)
    for j in range(p.njoints - 1, 0, -1):
        if j in stacked:
            continue
        about = parameters_to_matrix(_about_centre(theta[j])) if theta[j][0] > 0.0 else np.zeros((3, 3))
        if theta[j][0] > 0.0 and np.linalg.eigvalsh(about)[0] > 1e-9:
            continue
        column = axes[j][:, 0]
        if column[:3].any():
            lent = np.array([0.0, 0, 0, 0, LENT, 0, LENT, 0, 0, LENT])
        else:
            axis = column[3:]
            spin = float(axis @ parameters_to_matrix(theta[j]) @ axis)
            if theta[j][0] > 0.0 and spin > 0.0 and axis @ about @ axis <= POINT * spin:
                theta[j] = theta[j] + POINT * spin * np.array([0.0, 0, 0, 0, 1, 0, 1, 0, 0, 1])
                continue
            across = max(spin / 2, LENT) * (np.eye(3) - np.outer(axis, axis))
            xx, xy, xz, _, yy, yz, _, _, zz = across.ravel()
            lent = np.array([LENT if theta[j][0] <= 0.0 else 0.0, 0, 0, 0, xx, xy, yy, xz, yz, zz])
        theta[j] = theta[j] + lent
        if p.parents[j]:
            theta[p.parents[j]] = theta[p.parents[j]] - move_parameters(p.jointPlacements[j], lent)
    for j in range(1, p.njoints):
        if j not in stacked and not _is_body(theta[j]):
            raise DescriptionError(
                f"MuJoCo wants mass and inertia on the body of joint '{p.names[j]}'; it has none, and bodies "
                "hang on it that have too little themselves.",
                advice="Give its link a mass and moments, or export without the MuJoCo XML (--no-mujoco).",
                joint=p.names[j],
            )
        if j not in stacked and not _is_rigid(theta[j]):
            raise DescriptionError(
                f"The body of joint '{p.names[j]}' has an inertia no rigid body can have; MuJoCo refuses it.",
                advice="Mend the inertia of its link, or export without the MuJoCo XML (--no-mujoco).",
                joint=p.names[j],
            )
    return theta


def _is_rigid(theta: np.ndarray) -> bool:
    moments = np.linalg.eigvalsh(parameters_to_matrix(_about_centre(theta)))
    return bool(moments[0] + moments[1] >= moments[2] * (1.0 - 1e-12))


def _is_body(theta: np.ndarray) -> bool:
    return bool(theta[0] > 0.0 and np.linalg.eigvalsh(parameters_to_matrix(_about_centre(theta)))[0] > 0.0)


def inertial(theta: np.ndarray) -> str:
    """Return the tag of a body with the ten parameters theta (10,), about its joint's origin."""
    own = _about_centre(theta)
    xx, xy, yy, xz, yz, zz = own[4:]
    return (
        f'<inertial mass="{numbers(theta[0])}" pos="{numbers(theta[1:4] / theta[0])}" '
        f'fullinertia="{numbers([xx, yy, zz, xy, xz, yz])}"/>'
    )


def numbers(values: object) -> str:
    """Return numbers, of any shape, as the text of an attribute, to the last bit."""
    return " ".join(repr(float(v)) for v in np.ravel(np.asarray(values, dtype=float)))


def _about_centre(theta: np.ndarray) -> np.ndarray:
    centre = theta[1:4] / theta[0]
    return move_parameters(pin.SE3(np.eye(3), -centre), theta)
