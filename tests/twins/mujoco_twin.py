"""The spacecraft in MuJoCo: accelerations, momentum and recordings in this package's conventions.

MuJoCo's free joint has its linear velocity in inertial axes and its angular velocity in body axes, both of
the body frame's origin. With v_world = R v_b the body components are v_b_dot = R^T v_world_dot - omega x v_b.
A modal joint's coordinate is delta / L_t.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import mujoco
import numpy as np

from .channels import sample
from .mjcf import write_mjcf
from .numbers import PAPER, Spacecraft
from .state import Array, Inputs, State, rotation

Signal = Callable[[float], Array]


def quiet(t: float) -> Array:
    """No input at all: (3,) zeros."""
    return np.zeros(3)


@dataclass(frozen=True)
class Drive:
    """Inputs as functions of time [s], each returning (3,); they are taken as continuous from the right."""

    force_body: Signal = quiet  # [N]
    torque_body: Signal = quiet  # [N m]
    wheel_torque: Signal = quiet  # [N m]
    joint_torque: Signal = quiet  # [N m]

    def at(self, t: float) -> Inputs:
        """The inputs at time t [s]."""
        return Inputs(self.force_body(t), self.torque_body(t), self.wheel_torque(t), self.joint_torque(t))


@dataclass
class MujocoTwin:
    """One spacecraft in MuJoCo. Not for several threads at once: it owns an `MjData`."""

    numbers: Spacecraft = PAPER
    model: mujoco.MjModel = field(init=False, repr=False)
    data: mujoco.MjData = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(write_mjcf(self.numbers))
        self.data = mujoco.MjData(self.model)
        if (self.model.nq, self.model.nv) != (19, 18):
            raise ValueError(f"expected 19 positions and 18 velocities, got {self.model.nq}, {self.model.nv}")

    def accelerations(self, state: State, inputs: Inputs) -> Array:
        """Derivative (18,) of `State.velocity`, body axes [m/s2, rad/s2, ...]."""
        qpos, qvel = self._pack(state)
        return self._body_acceleration(state, self._forward(qpos, qvel, inputs))

    def mass_matrix(self, state: State) -> Array:
        """(18, 18) mass matrix dual to `State.velocity`."""
        qpos, qvel = self._pack(state)
        self._forward(qpos, qvel, Inputs())
        turn = self._turn(state.attitude)
        return turn.T @ self._full_mass() @ turn

    def momentum(self, state: State, about: str = "body") -> tuple[Array, Array]:
        """Linear and angular momentum, (3,) in body axes, from MuJoCo's subtree quantities [N s], [N m s].

        `about`: "body" for the body origin, "inertial" for the inertial origin.
        """
        qpos, qvel = self._pack(state)
        self._forward(qpos, qvel, Inputs())
        mujoco.mj_subtreeVel(self.model, self.data)
        base = self.model.body("base").id
        p = self.model.body_subtreemass[base] * self.data.subtree_linvel[base]
        origin = np.zeros(3) if about == "inertial" else state.position
        h = self.data.subtree_angmom[base] + np.cross(self.data.subtree_com[base] - origin, p)
        return state.attitude.T @ p, state.attitude.T @ h

    def energy(self, state: State) -> float:
        """T + V [J], by MuJoCo."""
        qpos, qvel = self._pack(state)
        self._forward(qpos, qvel, Inputs())
        return float(self.data.energy.sum())

    def simulate(
        self,
        drive: Drive,
        duration: float,
        *,
        initial: State | None = None,
        hold: bool = False,
        dt: float = 1e-3,
        rate: float = 100.0,
    ) -> dict[str, Array]:
        """Integrate with classical RK4 and return `t` and the channels of the reference recordings, (N, ...).

        hold: attitude held, arm and wheels locked (Exp. 1). The locked velocities are removed from the
            equations of motion and `tau_hold` is what their omega rows then ask for.
        dt: step [s], a divisor of 1 / rate; a step of an input must lie on this grid.
        rate: samples a second [Hz].
        """
        stride = round(1.0 / (rate * dt))
        if abs(stride * dt * rate - 1.0) > 1e-9:
            raise ValueError(f"dt = {dt} s does not divide the sampling time {1.0 / rate} s")
        qpos, qvel = self._pack(initial or State())
        rows: list[dict[str, Array]] = []
        steps = round(duration / dt)
        for n in range(steps + 1):
            t = n * dt
            if n % stride == 0:
                rows.append({"t": np.float64(t), **self._sample(qpos, qvel, drive.at(t), hold)})
            if n < steps:
                qpos, qvel = self._rk4(qpos, qvel, drive, t, dt, hold)
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}

    def simulate_state(self, drive: Drive, duration: float, *, initial: State, dt: float = 1e-3) -> State:
        """The state after `duration` [s], by the same integrator as `simulate`."""
        qpos, qvel = self._pack(initial)
        for n in range(round(duration / dt)):
            qpos, qvel = self._rk4(qpos, qvel, drive, n * dt, dt, False)
        return self._unpack(qpos, qvel)

    def _rk4(
        self, qpos: Array, qvel: Array, drive: Drive, t: float, dt: float, hold: bool
    ) -> tuple[Array, Array]:
        left = t + dt * (1.0 - 1e-9)  # the end of the step, before any jump of the inputs there
        middle = drive.at(t + dt / 2)
        inputs = (drive.at(t), middle, middle, drive.at(left))
        total_q, total_v = np.zeros(19), np.zeros(18)
        dq, dv = np.zeros(19), np.zeros(18)
        for u, ahead, weight in zip(inputs, (0.0, dt / 2, dt / 2, dt), (1, 2, 2, 1), strict=True):
            q, v = qpos + ahead * dq, qvel + ahead * dv
            dq, dv = _position_rate(q, v), self._forward(q, v, u, hold)
            total_q, total_v = total_q + weight * dq, total_v + weight * dv
        qpos, qvel = qpos + dt / 6 * total_q, qvel + dt / 6 * total_v
        qpos[3:7] /= np.linalg.norm(qpos[3:7])
        return qpos, qvel

    def _sample(self, qpos: Array, qvel: Array, inputs: Inputs, hold: bool) -> dict[str, Array]:
        state = self._unpack(qpos, qvel)
        acceleration = self._forward(qpos, qvel, inputs, hold)
        torque = np.zeros(3)
        if hold:
            needed = self._full_mass() @ acceleration + self.data.qfrc_bias - self.data.qfrc_passive
            torque = (needed - self.data.qfrc_applied)[3:6]
        return sample(self.numbers, state, self._body_acceleration(state, acceleration), inputs, torque)

    def _forward(self, qpos: Array, qvel: Array, inputs: Inputs, hold: bool = False) -> Array:
        """MuJoCo's qacc (18,) with `inputs`; with `hold`, omega, wheels and arm are locked."""
        d = self.data
        d.qpos, d.qvel = qpos, qvel
        applied = inputs.generalized
        w, x, y, z = qpos[3:7] / np.linalg.norm(qpos[3:7])
        applied[:3] = rotation(np.array([x, y, z, w])) @ applied[:3]
        d.qfrc_applied = applied
        mujoco.mj_forward(self.model, d)
        if not hold:
            return d.qacc.copy()
        free = np.r_[0:3, 12:18]
        acceleration = np.zeros(18)
        force = d.qfrc_applied + d.qfrc_passive - d.qfrc_bias
        acceleration[free] = np.linalg.solve(self._full_mass()[np.ix_(free, free)], force[free])
        return acceleration

    def _full_mass(self) -> Array:
        full = np.zeros((18, 18))
        mujoco.mj_fullM(self.model, self.data, full)
        return full

    def _turn(self, attitude: Array) -> Array:
        """(18, 18) from `State.velocity` to MuJoCo's qvel."""
        turn = np.eye(18)
        turn[:3, :3] = attitude
        turn[15:, 15:] = np.diag(1.0 / self.numbers.panel.translation)
        return turn

    def _body_acceleration(self, state: State, qacc: Array) -> Array:
        out = qacc.copy()
        out[:3] = state.attitude.T @ qacc[:3] - np.cross(state.omega_b, state.v_b)
        out[15:] *= self.numbers.panel.translation
        return out

    def _pack(self, state: State) -> tuple[Array, Array]:
        x, y, z, w = state.quaternion
        modes = state.delta / self.numbers.panel.translation
        qpos = np.concatenate([state.position, [w, x, y, z], state.wheel, state.q, state.rho, modes])
        return qpos, self._turn(state.attitude) @ state.velocity

    def _unpack(self, qpos: Array, qvel: Array) -> State:
        w, x, y, z = qpos[3:7]
        quaternion = np.array([x, y, z, w])
        scale = self.numbers.panel.translation
        return State(
            position=qpos[:3],
            quaternion=quaternion,
            v_b=rotation(quaternion).T @ qvel[:3],
            omega_b=qvel[3:6],
            wheel=qpos[7:10],
            wheel_rate=qvel[6:9],
            q=qpos[10:13],
            qd=qvel[9:12],
            rho=qpos[13:16],
            rho_dot=qvel[12:15],
            delta=scale * qpos[16:19],
            delta_dot=scale * qvel[15:18],
        )


def _position_rate(qpos: Array, qvel: Array) -> Array:
    """Derivative (19,) of MuJoCo's qpos; the quaternion's is q o (0, omega) / 2."""
    w, x, y, z = qpos[3:7]
    a, b, c = 0.5 * qvel[3:6]
    turn = (-x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a)
    return np.concatenate([qvel[:3], turn, qvel[6:]])
