"""What moves a part: from configurations to poses in the parent part's axes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from smsid.model.spacecraft import SpacecraftModel
from smsid.view.motion import Motion
from smsid.view.surface import Surface


@dataclass(frozen=True)
class Scale:
    """How many times larger than life slosh displacements, deflections and wheel angles are drawn."""

    slosh: float = 1.0
    panel: float = 1.0
    wheel: float = 1.0

    @property
    def notes(self) -> tuple[str, ...]:
        """What is not true to scale, in words."""
        factors = {"slosh": self.slosh, "deflection of appendages": self.panel}
        found = [
            f"{what} drawn {factor:g} times larger"
            if factor > 1.0
            else f"{what} drawn {1 / factor:g} times smaller"
            for what, factor in factors.items()
            if factor != 1.0
        ]
        return (
            (*found, f"wheels drawn {1 / self.wheel:g} times slower") if self.wheel != 1.0 else tuple(found)
        )


@dataclass(frozen=True)
class Frames:
    """A motion as drawn: q (N, nq) with slosh and wheels scaled, joint poses in their parents, thrust (N, 3).

    ``deflection`` q (N, nq) has the deflections scaled.
    """

    q: np.ndarray
    joints: np.ndarray  # (N, njoints, 4, 4)
    force: np.ndarray
    deflection: np.ndarray = field(repr=False)

    @classmethod
    def of(cls, model: SpacecraftModel, motion: Motion, scale: Scale) -> Frames:
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
        return cls(q, joints, motion.force, deflection)


class Driver(Protocol):
    """Poses of a part over the frames."""

    def poses(self, frames: Frames) -> np.ndarray:
        """Return (N, 4, 4): rotation, translation [m], and perhaps scale along the part's own axes."""
        ...


@dataclass(frozen=True)
class JointDriver:
    """The part moves with a joint, in the axes of the joint's parent."""

    joint: int

    def poses(self, frames: Frames) -> np.ndarray:
        """Return the joint's poses (N, 4, 4)."""
        return frames.joints[:, self.joint]


@dataclass(frozen=True)
class StripDriver:
    """The part is one strip of a bending surface."""

    surface: Surface
    strips: int
    index: int
    q: np.ndarray  # of the modes
    scale: np.ndarray  # modal coordinate = scale * q

    def poses(self, frames: Frames) -> np.ndarray:
        """Return the strip's poses (N, 4, 4) in surface axes."""
        delta = frames.deflection[:, self.q] * self.scale
        return self.surface.strip_poses(delta, self.strips, np.array([self.index]))[:, 0]


@dataclass(frozen=True)
class ForceDriver:
    """An arrow along x of unit length at ``point`` that takes direction and size of the thrust."""

    point: np.ndarray
    length_per_newton: float

    def poses(self, frames: Frames) -> np.ndarray:
        """Return poses (N, 4, 4) in body axes; without force the arrow shrinks to nothing."""
        size = np.linalg.norm(frames.force, axis=1)
        unit = np.where(size[:, None] > 0.0, frames.force, [1.0, 0.0, 0.0])
        unit /= np.linalg.norm(unit, axis=1)[:, None]
        half = unit + np.array([1.0, 0.0, 0.0])
        back = np.linalg.norm(half, axis=1) < 1e-9
        half[back] = [0.0, 0.0, 1.0]
        # half a turn about the bisector takes x to the unit vector
        turn = Rotation.from_rotvec(np.pi * half / np.linalg.norm(half, axis=1)[:, None])
        poses = np.zeros((len(size), 4, 4))
        poses[:, :3, :3] = turn.as_matrix() * np.maximum(size * self.length_per_newton, 1e-4)[:, None, None]
        poses[:, :3, 3] = self.point
        poses[:, 3, 3] = 1.0
        return poses
