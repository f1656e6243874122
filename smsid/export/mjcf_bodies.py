"""A moving body in MuJoCo XML: its joint's axes, and mass and inertia that MuJoCo accepts.

MuJoCo wants mass and a proper inertia on every moving body. Where a body lacks them, some are lent from its
parent in a way that leaves the motion as it was: rotational inertia to a body that only slides, mass on the
axis and inertia across it to a body that only turns.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from smsid.effects.inertial_parameters import move_parameters, parameters_to_matrix, pseudo_inertia
from smsid.errors import DescriptionError
from smsid.likelihood.pseudo_inertia import inertial_parameters

LENT = 1e-6
"""[kg], [kg m^2] lent to bodies that lack it."""
POINT = 3e-14
"""Inertia [kg m^2] of a mass without extent across the axis it turns about: the least that MuJoCo takes."""


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

    ``axes``: as from `joint_axes`. The motion of the whole is the same, but for `POINT` where a mass has no
    extent across the axis that it turns about, which nothing can lend.

    Raises:
        DescriptionError: a body's inertia is none that a body can have, nor can its parent lend what lacks.
    """
    theta = [np.asarray(i.toDynamicParameters()) for i in p.inertias]
    stacked = stacked_joints(p)
    for j in range(p.njoints - 1, 0, -1):
        if j in stacked or _is_body(theta[j]):
            continue
        free = _lendable(axes[j])
        others = np.linalg.eigh(free @ free.T)[1][:, : 4 - free.shape[1]]
        own = pseudo_inertia(theta[j])
        across = np.linalg.eigvalsh(others.T @ own @ others)[0]
        if abs(across) < POINT and others.shape[1] == 2:
            theta[j] = theta[j] + POINT * np.array([0.0, 0, 0, 0, 1, 0, 1, 0, 0, 1])
            own = pseudo_inertia(theta[j])
            if np.linalg.eigvalsh(own)[0] > 0.0:
                continue
        elif across <= 0.0:
            raise DescriptionError(
                f"The body of joint '{p.names[j]}' has no mass, or an inertia that no rigid body can have; "
                "MuJoCo refuses it.",
                advice="Mend mass and inertia of its link, or export without the MuJoCo XML (--no-mujoco).",
                joint=p.names[j],
            )
        # The least that makes the body one (Schur's complement) leaves the parent the most.
        coupling = free.T @ own @ others
        least = coupling @ np.linalg.solve(others.T @ own @ others, coupling.T) - free.T @ own @ free
        sizes, directions = np.linalg.eigh(least)
        lent = inertial_parameters(free @ directions * np.maximum(sizes + LENT, 0.0) @ (free @ directions).T)
        theta[j] = theta[j] + lent
        if p.parents[j]:
            theta[p.parents[j]] = theta[p.parents[j]] - move_parameters(p.jointPlacements[j], lent)
    return theta


def _lendable(axes: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (4, n) of the pseudo-inertia that a joint (6, nv) does not set in motion.

    Of a body that turns: mass on its axis; of one that slides: extent without mass; of a free one: nothing.
    """
    if axes.shape[1] == 6:
        return np.zeros((4, 0))
    if axes[:3].any():
        return np.eye(4)[:, :3]
    return np.column_stack([np.append(axes[3:, 0] / np.linalg.norm(axes[3:, 0]), 0.0), np.eye(4)[3]])


def _is_body(theta: np.ndarray) -> bool:
    """Whether MuJoCo takes the parameters: a mass, moments above zero, none above the others' sum."""
    if theta[0] <= 0.0:
        return False
    moments = np.linalg.eigvalsh(parameters_to_matrix(_about_centre(theta)))
    return bool(moments[0] > 1e-9 and moments[0] + moments[1] >= moments[2] * (1.0 - 1e-12))


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
