"""Many flights under controllers that differ only in their model, side by side: `track`, a few times faster.

What does not need Pinocchio is done for all flights at once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from smsid.control.attitude import SMALLEST_COSINE, euler_jacobian, euler_rotation
from smsid.control.closed_loop import Actuators, Tracking, starting_point, tracking_of
from smsid.control.pd import ModelBasedController
from smsid.control.sensed import SensedState
from smsid.errors import ControlError, SimulationError
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate.held_step import held_step
from smsid.simulate.truth import rotations


def track_side_by_side(
    model: SpacecraftModel,
    controllers: Sequence[ModelBasedController],
    *,
    rate: float,
    delay: int = 0,
    sensed: Sequence[SensedState] | None = None,
) -> list[Tracking]:
    """Fly the complete spacecraft under each controller, as `track` does with the exact same result.

    Args:
        model: the truth.
        controllers: same gains, reference and robust term, quaternion coordinates; their dynamics differ.
        rate: of the controllers [Hz]; a step of the simulation per call.
        delay: calls between measuring and acting.
        sensed: one per flight, of sensors with white noise alone; None: the exact state.

    Raises:
        ControlError: controllers or sensors that cannot fly side by side, an attitude error near half a turn.
        SimulationError: a loop blew up.
    """
    first, count = controllers[0], len(controllers)
    if not can_fly_side_by_side(controllers, sensed):
        raise ControlError(
            "These flights cannot be flown side by side.",
            advice="Use `track`: other gains or coordinates, redundant wheels, or sensors that are late, "
            "slow, scaled or limited.",
        )
    duration, period = first.reference.duration, 1.0 / rate
    steps, arm, wheels = round(duration * rate), model.arm_joints.v, model.wheels.v
    q = np.tile(starting_point(model, first), (count, 1))
    v = np.zeros((count, model.nv))
    path_q, path_v = np.empty((steps + 1, count, model.nq)), np.empty((steps + 1, count, model.nv))
    path_tau = np.zeros((steps + 1, count, model.nv))
    path_q[0], path_v[0] = q, v
    pending = [np.zeros((count, model.nv))] * delay
    law = _Law(first, count)
    actuators = [Actuators(model, period) for _ in controllers]
    for i in range(steps):
        t = i * period
        turned, omega = rotations(q), v[:, 3:6]
        angles, rates, spins = model.joint_angles(q), v[:, arm], v[:, wheels]
        if sensed is not None:
            noise = {k: np.array([s.streams[k].errors[i] for s in sensed]) for k in sensed[0].streams}
            turned = turned @ noise["attitude"]
            omega, angles = omega + noise["angular_rate"], angles + noise["joint_position"]
            rates, spins = rates + noise["joint_velocity"], spins + noise["wheel_rate"]
        wanted = law.acceleration(t, turned, omega, angles, rates)
        torques = _torques(controllers, wanted, omega, angles, rates, spins)
        pending.append(_applied(model, actuators, torques, v[:, wheels], period))
        tau = path_tau[i] = pending.pop(0)
        for k in range(count):
            q[k], v[k], _ = held_step(model, t, period, q[k], v[k], tau[k])
        if not np.isfinite(v).all():
            raise SimulationError(f"A closed loop blew up at t = {t + period:.6g} s.", time=t)
        path_q[i + 1], path_v[i + 1] = q, v
    path_tau[-1] = path_tau[-2]
    time = period * np.arange(steps + 1)
    return [
        tracking_of(model, c, time, path_q[:, k], path_v[:, k], path_tau[:, k], a)
        for k, (c, a) in enumerate(zip(controllers, actuators, strict=True))
    ]


def can_fly_side_by_side(
    controllers: Sequence[ModelBasedController], sensed: Sequence[SensedState] | None = None
) -> bool:
    """Return whether `track_side_by_side` takes these controllers and sensors."""
    first = controllers[0]
    same = all(
        c.gains is first.gains and c.reference is first.reference and c.coordinates == "quaternion"
        for c in controllers
    )
    redundant = first.dynamics.layout.null_space.shape[1] > 0
    return same and not redundant and (sensed is None or all(map(_plain, sensed)))


class _Law:
    """Wanted accelerations of all flights: the bracket of (43) and (46)."""

    def __init__(self, controller: ModelBasedController, count: int) -> None:
        self.reference, self.gains, self.filter = (
            controller.reference,
            controller.gains,
            controller.filter,
        )
        self.state = np.zeros((count, self.filter.order if self.filter else 0))

    def acceleration(
        self, t: float, turned: np.ndarray, omega: np.ndarray, angles: np.ndarray, rates: np.ndarray
    ) -> np.ndarray:
        """Return (flights, 3 + n): angular acceleration of the base, body axes, and of the joints."""
        x, dx, ddx = self.reference.at(t)
        jacobian, change = euler_jacobian(x[:3], dx[:3])
        rate_d, acceleration_d = jacobian @ dx[:3], jacobian @ ddx[:3] + change @ dx[:3]
        relative = euler_rotation(x[:3]).T @ turned
        quaternion = Rotation.from_matrix(relative).as_quat()
        quaternion *= np.where(quaternion[:, 3:] < 0.0, -1.0, 1.0)
        e, w = quaternion[:, :3], quaternion[:, 3:]
        if (w < SMALLEST_COSINE).any():
            raise ControlError("The attitude error is near half a turn: which way is back?")
        seen = np.einsum("bji,j->bi", relative, rate_d)
        slip = omega - seen
        moved = w * slip + np.cross(e, slip)
        turning = -0.5 * np.sum(e * slip, axis=1, keepdims=True) * slip + 0.5 * np.cross(moved, slip)
        error = np.hstack([-2.0 * e, x[3:] - angles])
        rate = np.hstack([-moved, dx[3:] - rates])
        wanted = (
            rate @ self.gains.derivative.T + error @ self.gains.proportional.T - self._robust(error, rate)
        )
        back = wanted[:, :3] - turning
        # (w I + [e]x)^-1 = (w I + [e]x)^T + e e^T / w
        turned_back = w * back - np.cross(e, back) + e * (np.sum(e * back, axis=1, keepdims=True) / w)
        wanted[:, :3] = turned_back + np.einsum("bji,j->bi", relative, acceleration_d) - np.cross(omega, seen)
        wanted[:, 3:] += ddx[3:]
        return wanted

    def _robust(self, error: np.ndarray, rate: np.ndarray) -> np.ndarray:
        f = self.filter
        if f is None:
            return np.zeros_like(error)
        y = np.hstack([error, rate])
        out = self.state @ f.c.T + y @ f.d.T
        self.state = self.state @ f.a.T + y @ f.b.T
        return out


def _torques(
    controllers: Sequence[ModelBasedController],
    wanted: np.ndarray,
    omega: np.ndarray,
    angles: np.ndarray,
    rates: np.ndarray,
    spins: np.ndarray,
) -> np.ndarray:
    """Return Q_c (flights, 3 + n), as `ReducedDynamics.torques` of each controller's model."""
    size = controllers[0].dynamics.pin.nv
    mass, force = np.empty((len(controllers), size, size)), np.empty((len(controllers), size))
    total = np.array([c.dynamics.mass for c in controllers])
    for k, controller in enumerate(controllers):
        d = controller.dynamics
        q, v = d.configuration(angles[k]), d.velocity(omega[k], rates[k], spins[k])
        mass[k] = pin.crba(d.pin, d.data, q)
        force[k] = pin.nonLinearEffects(d.pin, d.data, q, v)
    d = controllers[0].dynamics
    w, left = len(d.wheels), d.left
    coupling = mass[:, :3, 3:]
    across = coupling.transpose(0, 2, 1)
    schur = (mass[:, 3:, 3:] - across @ coupling / total[:, None, None])[:, left[:, None], left]
    bias = (force[:, 3:] - (across @ force[:, :3, None])[..., 0] / total[:, None])[:, left]
    given = np.concatenate([schur[:, :w, w:], bias[:, :w, None]], axis=2)
    spun = np.linalg.solve(schur[:, :w, :w], given)
    rest = schur[:, w:, :w]
    inertia = schur[:, w:, w:] - rest @ spun[:, :, :-1]
    needed = (inertia @ wanted[..., None])[..., 0] + bias[:, w:] - (rest @ spun[:, :, -1:])[..., 0]
    enters = np.zeros((len(controllers), d.size, d.size))
    enters[:, :, :3] = -spun[:, :, :-1].transpose(0, 2, 1) @ -d.layout.inverse
    enters[:, :, 3:] = np.eye(d.size)[:, 3:]
    return np.linalg.solve(enters, needed[..., None])[..., 0]


def _applied(
    model: SpacecraftModel,
    actuators: Sequence[Actuators],
    torques: np.ndarray,
    spins: np.ndarray,
    period: float,
) -> np.ndarray:
    """Return generalised forces (flights, nv) within limits; flights at a limit go through `Actuators`."""
    layout, effort = actuators[0].layout, actuators[0].effort
    wheels = -torques[:, :3] @ layout.inverse.T
    tau = np.zeros((len(torques), model.nv))
    tau[:, model.wheels.v], tau[:, model.arm_joints.v] = wheels, torques[:, 3:]
    fast = np.abs(spins + period * wheels / layout.inertia) > layout.max_rate * (1.0 - 1e-9)
    beyond = np.abs(wheels) > layout.max_torque * (1.0 - 1e-9)
    limited = fast.any(axis=1) | beyond.any(axis=1) | (np.abs(torques[:, 3:]) > effort).any(axis=1)
    for k in np.flatnonzero(limited).tolist():
        tau[k] = actuators[k](torques[k], spins[k])
    return tau


def _plain(sensed: SensedState) -> bool:
    """Whether all that the sensors do is to add noise, at every call."""
    return "wheel_rate" in sensed.streams and all(
        s.linear is None
        and s.saturation is None
        and s.step == 0.0
        and s.late == 0.0
        and s.rate * sensed.period > 1.0 - 1e-9
        for s in sensed.streams.values()
    )
