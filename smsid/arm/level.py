"""Which way is down: gravity's direction in the axes of an arm's base, from its torques.

Torques are linear in gravity, and linear in the links, but not in both: the two angles are found with all
else in rounds of Gauss-Newton, and the intervals of all include theirs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from smsid.arm._smooth_motion import SmoothMotion
from smsid.arm.joint_torques import JointTorques, block_means
from smsid.effects.external import BaseTilt, tilted_gravity
from smsid.errors import DescriptionError
from smsid.model.identifiable import BaseParameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel

DIFFERENCE = 1e-4
SHOWN = np.array([0.4, 0.3])
"""Tilt at which the links' combinations are named: of all that any tilt tells apart [rad]."""


def with_gravity(model: SpacecraftModel, gravity: np.ndarray) -> SpacecraftModel:
    """Return the model under another gravity (3,) [m/s^2]."""
    turned = model.pin.copy()
    turned.gravity.linear = np.asarray(gravity)
    return replace(model, pin=turned, data=turned.createData(), source=None)


def gravity_slopes(gravity: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """Return the change (3, 2) [m/s^2 per rad] of gravity (3,) by the angles of a tilt (2,) [rad]."""
    both = (
        (tilted_gravity(gravity, *(tilt + d)) - tilted_gravity(gravity, *(tilt - d))) / (2.0 * DIFFERENCE)
        for d in DIFFERENCE * np.eye(2)
    )
    return np.column_stack(list(both))


@dataclass(frozen=True)
class Level:
    """The equations of an arm by the tilt of its base.

    ``gravity`` (3,) as described, ``own`` (2,) the tilt that the equations are of, ``unit`` (B, nv, links, 3)
    their rows per unit of gravity along each axis.
    """

    gravity: np.ndarray
    own: np.ndarray
    unit: np.ndarray

    @classmethod
    def of(cls, model: SpacecraftModel, motion: SmoothMotion, torques: JointTorques, tilt: BaseTilt) -> Level:
        """Return them, at the configurations in the middle of blocks.

        Raises:
            DescriptionError: there is no gravity.
        """
        angles = block_means(model.joint_angles(motion.q), torques.starts)
        q = model.set_joint_angles(model.home, angles)
        still = np.zeros((len(q), model.nv))
        unit = [Regressor(with_gravity(model, e)).torque(q, still, still) for e in np.eye(3)]
        nominal = np.asarray(model.description.gravity)
        if not np.any(nominal):
            raise DescriptionError("There is no gravity to lean.", advice="State gravity in the description.")
        return cls(nominal, np.array([tilt.x, tilt.y]), np.stack(unit, axis=-1))

    def at(self, tilt: np.ndarray) -> np.ndarray:
        """Return gravity (3,) at a tilt (2,) [rad]."""
        return tilted_gravity(self.gravity, *np.asarray(tilt, dtype=float))

    def equations_at_tilt(self, torques: JointTorques, tilt: np.ndarray) -> JointTorques:
        """Return equations that are of the tilt ``own`` at another tilt (2,) [rad]."""
        rows = np.array(torques.rows)
        rows[:, :, : self.unit.shape[2]] += self.unit @ (self.at(tilt) - self.at(self.own))
        return replace(torques, rows=rows)

    def columns(self, base: BaseParameters, x: np.ndarray, tilt: np.ndarray) -> np.ndarray:
        """Return torques (B, nv, 2) [N m/rad] per angle of a tilt (2,), of base parameters x (b,)."""
        links = base.independent < self.unit.shape[2]
        per_axis = np.einsum("bjla,l->bja", self.unit[:, :, base.independent[links]], x[links])
        return per_axis @ gravity_slopes(self.gravity, np.asarray(tilt, dtype=float))
