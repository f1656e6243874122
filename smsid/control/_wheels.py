"""Reaction wheels: torques about base axes on any layout, within torque and speed limits, saturation told."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from scipy.optimize import linprog

from smsid.errors import ControlError
from smsid.model.spacecraft import SpacecraftModel

SMALLEST_SINGULAR_VALUE = 1e-3
"""Relative to the largest; a layout below it cannot turn the base about every axis."""


@dataclass(frozen=True)
class Allocation:
    """Motor torques ``wheels`` (w,) [N m]; ``torque_limited``, ``rate_limited`` (w,): those at a limit."""

    wheels: np.ndarray
    torque_limited: np.ndarray
    rate_limited: np.ndarray


@dataclass(frozen=True)
class WheelLayout:
    """Wheels by name with unit ``axes`` (3, w) in the bus frame and spin ``inertia`` (w,) [kg m^2].

    ``max_torque`` (w,) [N m] and ``max_rate`` (w,) [rad/s]; infinite where there is no limit. Raises
    `ControlError` when shapes do not fit or the axes do not span space.
    """

    names: tuple[str, ...]
    axes: np.ndarray
    inertia: np.ndarray
    max_torque: np.ndarray
    max_rate: np.ndarray
    inverse: np.ndarray = field(init=False, repr=False)
    null_space: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        w = len(self.names)
        shapes = {"axes": (3, w), "inertia": (w,), "max_torque": (w,), "max_rate": (w,)}
        for name, shape in shapes.items():
            if np.shape(getattr(self, name)) != shape:
                raise ControlError(
                    f"`{name}` of {w} wheels has shape {np.shape(getattr(self, name))}, not {shape}.",
                    advice="Give one column or value per wheel.",
                )
        positive = {"inertia": self.inertia, "max_torque": self.max_torque, "max_rate": self.max_rate}
        for name, values in positive.items():
            if not (np.asarray(values) > 0.0).all():
                raise ControlError(f"`{name}` of the wheels is {values}.", advice="It must be positive.")
        u, s, vt = np.linalg.svd(self.axes) if w else (np.eye(3), np.zeros(0), np.zeros((0, 0)))
        singular = np.concatenate([s, np.zeros(3 - len(s))])
        if singular[2] < SMALLEST_SINGULAR_VALUE * max(singular[0], 1e-300):
            raise ControlError(
                f"The {w} wheels {', '.join(self.names) or '(none)'} cannot turn the base about body axis "
                f"{np.round(u[:, 2], 3).tolist()}: the layout is singular.",
                advice="Three wheels or more are needed, their axes not in one plane.",
                axes=self.axes,
                singular_values=singular,
            )
        object.__setattr__(self, "inverse", np.linalg.pinv(self.axes))
        object.__setattr__(self, "null_space", vt[3:].T)

    @classmethod
    def of(cls, model: SpacecraftModel) -> WheelLayout:
        """Return the layout of a spacecraft; limits are those of its description."""
        neutral = pin.neutral(model.pin)
        data = model.pin.createData()
        pin.computeJointJacobians(model.pin, data, neutral)
        mass = pin.crba(model.pin, data, neutral)
        axes, inertia = np.zeros((3, len(model.wheels))), np.zeros(len(model.wheels))
        for k, (joint, index) in enumerate(zip(model.wheels.joints, model.wheels.v, strict=True)):
            columns = pin.getJointJacobian(model.pin, data, int(joint), pin.LOCAL_WORLD_ALIGNED)
            axes[:, k] = columns[3:, index]
            inertia[k] = mass[index, index]
        wheels = model.description.wheel
        return cls(
            tuple(w.name for w in wheels),
            axes,
            inertia,
            np.array([np.inf if w.max_torque is None else w.max_torque for w in wheels]),
            np.array([np.inf if w.max_rate is None else w.max_rate for w in wheels]),
        )

    def allocate(self, torque: np.ndarray, rates: np.ndarray, period: float) -> Allocation:
        """Return motor torques that put ``torque`` (3,) [N m], body axes, on the base.

        The least-norm torques; where one is beyond its limit, those of least largest share of the limits;
        where that is still beyond, all scaled so that the direction is kept. A wheel whose speed would pass
        its limit within ``period`` [s] gets what takes it just to the limit, ``rates`` (w,) [rad/s] being the
        wheels' speeds.

        Raises `ControlError` when ``torque`` or ``rates`` has another shape.
        """
        if np.shape(torque) != (3,) or np.shape(rates) != (len(self.names),):
            raise ControlError(
                f"A base torque of shape {np.shape(torque)} and wheel rates of shape {np.shape(rates)} were "
                f"given, not (3,) and ({len(self.names)},)."
            )
        wheels = -self.inverse @ torque
        torque_limited = np.abs(wheels) > self.max_torque * (1.0 + 1e-12)
        if torque_limited.any():
            wheels = self._least_share_torques(wheels)
            share = float((np.abs(wheels) / self.max_torque).max())
            torque_limited = np.abs(wheels) >= self.max_torque * (1.0 + 1e-9)
            if share > 1.0:
                wheels = wheels / share
        room = self.inertia / period
        highest = np.minimum(self.max_torque, room * (self.max_rate - rates))
        lowest = np.maximum(-self.max_torque, room * (-self.max_rate - rates))
        limited = np.clip(wheels, np.minimum(lowest, self.max_torque), np.maximum(highest, -self.max_torque))
        rate_limited = np.abs(limited - wheels) > 1e-12 * (1.0 + np.abs(wheels))
        return Allocation(limited, torque_limited, rate_limited)

    def _least_share_torques(self, wheels: np.ndarray) -> np.ndarray:
        """Return the torques of the same effect whose largest share of the limits is least."""
        n = self.null_space.shape[1]
        limited = np.isfinite(self.max_torque)
        if n == 0:
            return wheels
        basis, bound = self.null_space[limited], self.max_torque[limited, None]
        rows = np.vstack([np.hstack([basis, -bound]), np.hstack([-basis, -bound])])
        limits = np.concatenate([-wheels[limited], wheels[limited]])
        found = linprog(np.eye(n + 1)[-1], A_ub=rows, b_ub=limits, bounds=[(None, None)] * n + [(0, None)])
        return wheels + self.null_space @ found.x[:n] if found.status == 0 else wheels
