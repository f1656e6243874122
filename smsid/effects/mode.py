"""A bending mode, and the joint that stands for it in the model.

A mass-normalised mode with translational participation L_t (3,) and rotational participation L_r (3,) about
the root is a screw: the point mass |L_t|^2 sits where L_r = r x L_t and slides along L_t. Reproduces (5),
(7), (9) and (13): linear momentum and first moments exactly, the inertia to first order for bending of a
straight beam.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
from pydantic import Field

from smsid.effects.base import Vector3, physical
from smsid.effects.table import Table
from smsid.errors import DescriptionError


class Mode(Table):
    """One mass-normalised mode as a finite-element program delivers it.

    ``frequency`` [Hz], ``damping`` ratio, ``translation`` L_t [kg^.5] and ``rotation`` L_r about the root
    [kg^.5 m] in appendage axes, ``shape`` at the appendage's stations (stations, 3) [kg^-.5].
    """

    frequency: float = physical("Hz", lower=0.0, gt=0.0, description="of the clamped mode")
    damping: float = physical("1", lower=0.0, ge=0.0, description="damping ratio")
    translation: Vector3 = physical(
        "kg^0.5", sparse=True, description="L_t, translational participation, appendage axes"
    )
    rotation: Vector3 = physical(
        "kg^0.5 m", sparse=True, description="L_r, rotational participation about the root"
    )
    shape: tuple[Vector3, ...] = Field(
        default=(), description="mass-normalised displacement at each station, appendage axes [kg^-.5]"
    )

    def heavier(self, factor: float) -> Mode:
        """Return the mode with ``factor`` times the modal mass."""
        root = float(np.sqrt(factor))
        return self.model_copy(
            update={
                "translation": tuple(root * x for x in self.translation),
                "rotation": tuple(root * x for x in self.rotation),
                "shape": tuple(tuple(x / root for x in s) for s in self.shape),
            }
        )


ModeJoint = tuple[pin.JointModel, pin.Inertia, pin.SE3, float]


@lru_cache(maxsize=64)
def mode_joints(
    modes: tuple[Mode, ...], parameters: tuple[float, ...]
) -> tuple[tuple[ModeJoint, ...], np.ndarray]:
    """Return what `mode_joint` gives for every mode, and the parameters (10,) of the rigid remainder."""
    remainder = np.array(parameters)
    rigid = pin.Inertia.FromDynamicParameters(remainder)
    parts = tuple(mode_joint(mode, rigid) for mode in modes)
    for _, inertia, placement, _ in parts:
        remainder = remainder - placement.act(inertia).toDynamicParameters()
    remainder.setflags(write=False)
    return parts, remainder


def mode_joint(mode: Mode, rigid: pin.Inertia) -> ModeJoint:
    """Return joint, inertia in the joint frame, placement in the appendage axes, and scale ``delta / s``.

    Raises `DescriptionError` for a mode that moves nothing.
    """
    lt, lr = np.asarray(mode.translation), np.asarray(mode.rotation)
    size = np.linalg.norm(lt)
    lever = rigid.inertia.trace() ** 0.5 / rigid.mass**0.5
    if size * lever < 1e-9 * np.linalg.norm(lr) or size == 0.0:
        moment = np.linalg.norm(lr)
        if moment == 0.0:
            raise DescriptionError(
                "A mode without translational and rotational participation moves nothing.",
                advice="Remove the mode, or give its participation factors.",
            )
        axis = lr / moment
        inertia = pin.Inertia(0.0, np.zeros(3), moment**2 * np.outer(axis, axis))
        return pin.JointModelRevoluteUnaligned(axis), inertia, pin.SE3.Identity(), float(moment)
    n = lt / size
    placement = pin.SE3(np.eye(3), np.cross(lt, lr) / size**2)
    twist = float(lr @ n)
    if abs(twist) <= 1e-9 * size * lever:
        inertia = pin.Inertia(float(size**2), np.zeros(3), np.zeros((3, 3)))
        return pin.JointModelPrismaticUnaligned(n), inertia, placement, float(size)
    # share the modal energy between translation and twist in the ratio of the effective mass fractions
    about = rigid.inertia + rigid.mass * _point(rigid.lever - placement.translation)
    translation_share = size**2 / rigid.mass
    twist_share = twist**2 / float(n @ about @ n)
    w = translation_share / (translation_share + twist_share)
    mass, spin = size**2 / w, twist**2 / (1.0 - w)
    s_rate, angle_rate = w / size, (1.0 - w) / twist  # per unit delta rate
    inertia = pin.Inertia(float(mass), np.zeros(3), spin * np.outer(n, n))
    joint = pin.JointModelHelicalUnaligned(n, float(s_rate / angle_rate))
    return joint, inertia, placement, float(1.0 / angle_rate)


def _point(r: np.ndarray) -> np.ndarray:
    return (r @ r) * np.eye(3) - np.outer(r, r)
