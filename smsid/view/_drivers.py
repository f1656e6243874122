"""What moves a part: from configurations to poses in the parent part's axes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from smsid.model.spacecraft import SpacecraftModel
from smsid.view._momentum import Momenta, momenta
from smsid.view._motion import DrawnMotion
from smsid.view._surface import Surface

DEFLECTION = "deflection of appendages drawn"


@dataclass(frozen=True)
class Scale:
    """How many times larger than life slosh displacements, deflections and wheel angles are drawn."""

    slosh: float = 1.0
    panel: float = 1.0
    wheel: float = 1.0

    @property
    def notes(self) -> tuple[str, ...]:
        """What is not true to scale, in words."""
        factors = {"slosh drawn": self.slosh, DEFLECTION: self.panel}
        found = [
            f"{what} {factor:g} times larger" if factor > 1.0 else f"{what} {1 / factor:g} times smaller"
            for what, factor in factors.items()
            if factor != 1.0
        ]
        found += [f"wheels drawn {1 / self.wheel:g} times slower"] if self.wheel != 1.0 else []
        return tuple(found)


@dataclass(frozen=True)
class DrawnFrames:
    """A motion as drawn: q (N, nq) with slosh and wheels scaled, joint poses in their parents.

    ``deflection`` q (N, nq) has the deflections scaled; ``motion`` is what is drawn.
    """

    model: SpacecraftModel = field(repr=False)
    motion: DrawnMotion = field(repr=False)
    q: np.ndarray
    joints: np.ndarray  # (N, njoints, 4, 4)
    deflection: np.ndarray = field(repr=False)

    @classmethod
    def of(cls, model: SpacecraftModel, motion: DrawnMotion, scale: Scale) -> DrawnFrames:
        """Return the frames of a motion at a scale."""
        q = np.array(motion.q, dtype=float)
        for joint in model.slosh:
            q[:, joint.q] *= scale.slosh
        for j, k in zip(model.wheels.joints, model.wheels.q, strict=True):
            if model.pin.joints[int(j)].nq == 1:
                q[:, k] *= scale.wheel
        deflection = motion.q * scale.panel
        data = model.pin.createData()
        joints = np.empty((len(q), model.pin.njoints, 4, 4))
        for i, row in enumerate(q):
            pin.forwardKinematics(model.pin, data, row)
            for j in range(model.pin.njoints):
                joints[i, j] = data.liMi[j].homogeneous
        return cls(model, motion, q, joints, deflection)

    @cached_property
    def momenta(self) -> Momenta:
        """Centre of mass and momenta, true to scale."""
        return momenta(self.model, self.motion)


Driver = Callable[[DrawnFrames], np.ndarray]
"""Poses (N, 4, 4) of a part over the frames: rotation, translation [m], perhaps scale along its own axes."""


def joint_driver(joint: int) -> Driver:
    """Return what moves a part with a joint, in the axes of the joint's parent."""
    return lambda frames: frames.joints[:, joint]


def centre_poses(frames: DrawnFrames) -> np.ndarray:
    """Return poses (N, 4, 4) at the centre of mass, in inertial axes."""
    poses = np.tile(np.eye(4), (len(frames.q), 1, 1))
    poses[:, :3, 3] = frames.momenta.com
    return poses


@dataclass(frozen=True)
class StripDriver:
    """The part is one strip of a bending surface."""

    surface: Surface
    strips: int
    index: int
    q: np.ndarray  # of the modes
    scale: np.ndarray  # modal coordinate = scale * q

    def __call__(self, frames: DrawnFrames) -> np.ndarray:
        """Return the strip's poses (N, 4, 4) in surface axes."""
        delta = frames.deflection[:, self.q] * self.scale
        return self.surface.strip_poses(delta, self.strips, np.array([self.index]))[:, 0]


@dataclass(frozen=True)
class VectorDriver:
    """A sign along x of unit size that takes direction and size of a vector.

    ``vector`` gives (N, 3) of the frames, in the parent's axes; ``point`` (3,) [m] is where it starts, or
    ``None`` for the centre of mass.
    """

    vector: Callable[[DrawnFrames], np.ndarray]
    point: np.ndarray | None
    length_per_unit: float

    def __call__(self, frames: DrawnFrames) -> np.ndarray:
        """Return poses (N, 4, 4); without a vector the sign shrinks to nothing."""
        vector = self.vector(frames)
        size = np.linalg.norm(vector, axis=1)
        unit = np.where(size[:, None] > 0.0, vector, [1.0, 0.0, 0.0])
        unit /= np.linalg.norm(unit, axis=1)[:, None]
        half = unit + np.array([1.0, 0.0, 0.0])
        back = np.linalg.norm(half, axis=1) < 1e-9
        half[back] = [0.0, 0.0, 1.0]
        # half a turn about the bisector takes x to the unit vector
        turn = Rotation.from_rotvec(np.pi * half / np.linalg.norm(half, axis=1)[:, None])
        poses = np.zeros((len(size), 4, 4))
        poses[:, :3, :3] = turn.as_matrix() * np.maximum(size * self.length_per_unit, 1e-4)[:, None, None]
        poses[:, :3, 3] = frames.momenta.com if self.point is None else self.point
        poses[:, 3, 3] = 1.0
        return poses
