"""State and inputs of the 18-degree-of-freedom spacecraft as plain arrays, the same for every twin."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

Array = np.ndarray


def rotation(quaternion: Array) -> Array:
    """(3, 3) rotation, body to inertial, of a unit quaternion x y z w (4,)."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _zero() -> Array:
    return np.zeros(3)


@dataclass(frozen=True)
class State:
    """All arrays are (3,) except the quaternion (4,). SI units."""

    position: Array = field(default_factory=_zero)  # body origin, inertial axes [m]
    quaternion: Array = field(
        default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0])
    )  # x y z w, body to inertial
    v_b: Array = field(default_factory=_zero)  # velocity of the body origin, body axes [m/s]
    omega_b: Array = field(default_factory=_zero)  # body rate, body axes [rad/s]
    wheel: Array = field(default_factory=_zero)  # wheel angles [rad]
    wheel_rate: Array = field(default_factory=_zero)  # relative to the base [rad/s]
    q: Array = field(default_factory=_zero)  # arm joints [rad]
    qd: Array = field(default_factory=_zero)  # [rad/s]
    rho: Array = field(default_factory=_zero)  # slosh displacement from c_s, body axes [m]
    rho_dot: Array = field(default_factory=_zero)  # its component-wise derivative [m/s]
    delta: Array = field(default_factory=_zero)  # mass-normalised modal coordinates [kg^1/2 m]
    delta_dot: Array = field(default_factory=_zero)  # [kg^1/2 m/s]

    @property
    def attitude(self) -> Array:
        """(3, 3) rotation, body to inertial."""
        return rotation(self.quaternion)

    @property
    def velocity(self) -> Array:
        """(18,) quasi-velocities [v_b, omega_b, wheels, arm, rho_dot, delta_dot]."""
        return np.concatenate(
            [self.v_b, self.omega_b, self.wheel_rate, self.qd, self.rho_dot, self.delta_dot]
        )

    @classmethod
    def random(cls, rng: np.random.Generator) -> State:
        """A state with every part in motion, an order of magnitude above what the experiments reach."""
        quaternion = rng.standard_normal(4)
        return cls(
            position=3.0 * rng.standard_normal(3),
            quaternion=quaternion / np.linalg.norm(quaternion),
            v_b=rng.standard_normal(3),
            omega_b=0.3 * rng.standard_normal(3),
            wheel=rng.uniform(-np.pi, np.pi, 3),
            wheel_rate=50.0 * rng.standard_normal(3),
            q=rng.uniform(-np.pi, np.pi, 3),
            qd=rng.standard_normal(3),
            rho=0.3 * rng.standard_normal(3),
            rho_dot=0.3 * rng.standard_normal(3),
            delta=2.0 * rng.standard_normal(3),
            delta_dot=2.0 * rng.standard_normal(3),
        )


@dataclass(frozen=True)
class Inputs:
    """What acts on the spacecraft, each (3,)."""

    force_body: Array = field(default_factory=_zero)  # at the body origin, body axes [N]
    torque_body: Array = field(default_factory=_zero)  # about the body origin, body axes [N m]
    wheel_torque: Array = field(
        default_factory=_zero
    )  # motor torque on the wheel, reaction on the base [N m]
    joint_torque: Array = field(default_factory=_zero)  # motor torque on the child [N m]

    @property
    def generalized(self) -> Array:
        """(18,) forces dual to `State.velocity`; slosh and panel are not actuated."""
        return np.concatenate(
            [self.force_body, self.torque_body, self.wheel_torque, self.joint_torque, np.zeros(6)]
        )

    @classmethod
    def random(cls, rng: np.random.Generator) -> Inputs:
        """Inputs of the size the experiments use."""
        scale = (40.0, 20.0, 2.0, 30.0)
        return cls(*(s * rng.standard_normal(3) for s in scale))
