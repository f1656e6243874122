"""The complete nonlinear spacecraft under control: sensors, sampling, delay, wheel and joint limits.

The flights of section V of the paper, (10)-(15) under (43) or (46); and what slosh, panel and sensors do to
the loop, d_d of (45), as a bound the weights can use.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import joblib
import numpy as np
import pinocchio as pin

from smsid.control._attitude import attitude_errors
from smsid.control._compiled_flight import PLAIN, CompiledFlight
from smsid.control._sensed import SensedState, measured_truth
from smsid.control._wheels import WheelLayout
from smsid.control.gains import Gains
from smsid.control.pd import ModelBasedController
from smsid.control.reduced import ReducedDynamics
from smsid.control.trajectory import Motion
from smsid.control.weights import in_band
from smsid.errors import ControlError
from smsid.model.spacecraft import SpacecraftModel
from smsid.sensing.sensor import Sensor
from smsid.simulate.fixed_step import simulate_closed_loop
from smsid.simulate.truth import rotation_matrices

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrackingRun:
    """A run at the controller's samples ``time`` (N,) [s], errors of the true state, not of the measured one.

    ``error`` (N, 3 + n) e, e_b first [rad]; ``torques`` (N, 3 + n) what acted, base axes and joints [N m];
    ``wheel_torque``, ``wheel_rate`` (N, w). ``saturated`` counts the samples at which a limit was met, by
    actuator. ``q``, ``v`` are the true states.
    """

    time: np.ndarray
    error: np.ndarray
    error_rate: np.ndarray
    torques: np.ndarray
    wheel_torque: np.ndarray
    wheel_rate: np.ndarray
    q: np.ndarray
    v: np.ndarray
    saturated: dict[str, int] = field(default_factory=dict)

    @property
    def base(self) -> float:
        """Largest attitude error e_b about any axis [rad]."""
        return float(np.abs(self.error[:, :3]).max())

    @property
    def joints(self) -> float:
        """Largest joint error e_i of any joint [rad]."""
        return float(np.abs(self.error[:, 3:]).max())


class Actuators:
    """From Q_c to generalised forces of the spacecraft, within limits; ``hits`` counts samples at a limit."""

    def __init__(self, model: SpacecraftModel, period: float) -> None:
        """Take the limits of wheels from the description, those of joints from the URDF (0: none)."""
        self.model, self.period = model, period
        self.layout = WheelLayout.of(model)
        self.effort = model.joint_limits.effort
        self.hits: dict[str, int] = {}

    def __call__(self, torques: np.ndarray, wheel_rates: np.ndarray) -> np.ndarray:
        """Return the generalised forces (nv,) for Q_c (3 + n,) at the true wheel rates (w,) [rad/s]."""
        found = self.layout.allocate(torques[:3], wheel_rates, self.period)
        joints = np.clip(torques[3:], -self.effort, self.effort)
        self.add_hits(np.concatenate([found.torque_limited, found.rate_limited, joints != torques[3:]]))
        tau = np.zeros(self.model.nv)
        tau[self.model.wheels.v], tau[self.model.arm_joints.v] = found.wheels, joints
        return tau

    def add_hits(self, counts: np.ndarray) -> None:
        """Add how often limits were met (2 w + n,): torques and rates of wheels, torques of joints."""
        wheels, joints = self.layout.names, self.model.arm_joints.names
        names = [*(f"{k} torque" for k in wheels), *(f"{k} speed" for k in wheels)]
        names += [f"{k} torque" for k in joints]
        for k in np.flatnonzero(counts):
            if names[k] not in self.hits:
                logger.info("%s is at its limit", names[k])  # the run says so, and how often
            self.hits[names[k]] = self.hits.get(names[k], 0) + int(counts[k])


def track(
    model: SpacecraftModel,
    controller: ModelBasedController,
    *,
    duration: float | None = None,
    rate: float = 100.0,
    dt: float | None = None,
    delay: int = 0,
    sensors: Sequence[Sensor] | None = None,
    rng: np.random.Generator | None = None,
    limits: bool = True,
    start: np.ndarray | None = None,
) -> TrackingRun:
    """Fly the complete spacecraft under the controller.

    Args:
        model: the truth, slosh and panel included.
        controller: made for calls at ``rate``; its robust term is reset.
        duration: [s]; by default until the reference rests.
        rate: of the controller [Hz]. ``dt``: step of the simulation [s], by default one per call.
        delay: calls between measuring and acting.
        sensors: what the controller sees with; None: the exact state. ``rng`` draws their errors.
        limits: whether wheels and joints have limits.
        start: q (nq,) at rest; by default home with the reference's first attitude and joint angles.

    Raises:
        ControlError: sensors without ``rng``, sizes that do not fit, a singular attitude.
        SimulationError: the loop blew up.
    """
    duration = controller.reference.duration if duration is None else duration
    controller.reset()
    q0 = starting_point(model, controller) if start is None else start
    actuators = Actuators(model, 1.0 / rate)
    if not limits:
        none = np.full(len(model.wheels), np.inf)
        actuators.layout = replace(actuators.layout, max_torque=none, max_rate=none)
        actuators.effort = np.full_like(actuators.effort, np.inf)
    if sensors is not None and rng is None:
        raise ControlError("Sensors were given without a generator for their errors.", advice="Pass rng.")
    sensed = SensedState(model, sensors, duration, rate, rng) if sensors is not None and rng else None
    step = 1.0 / rate if dt is None else dt

    def plain(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        seen = measured_truth(model, q, v) if sensed is None else sensed(t, q, v)
        return actuators(controller.command(t, seen).torques, v[model.wheels.v])

    flight = CompiledFlight.of(model, controller, actuators, sensed, duration, rate, step)
    if flight is not None and delay >= 0:
        found, every = flight.run(q0, delay), 1
    else:
        with PLAIN:
            found = simulate_closed_loop(
                model, plain, duration, dt=step, control_rate=rate, q0=q0, delay=delay, audit=False
            )
        every = round(1.0 / (rate * step))
    time, q, v, tau = (x[::every] for x in (found.time, found.q, found.v, found.tau))
    return tracking_of(model, controller, time, q, v, tau, actuators)


def track_many(
    model: SpacecraftModel,
    controllers: Sequence[ModelBasedController],
    *,
    rate: float = 100.0,
    delay: int = 0,
    sensors: Sequence[Sensor] | None = None,
    generators: Sequence[np.random.Generator] | None = None,
    workers: int | None = None,
) -> list[TrackingRun]:
    """Fly the complete spacecraft under each controller, as `track` does, several at a time.

    Compiled flights run in ``workers`` threads, by default one per core; others take turns. ``generators``
    draw the errors of sensors, one per flight; ``rate``, ``delay`` and ``sensors`` are those of `track`. No
    controller stands twice. Raises what `track` raises.
    """
    draws = [None] * len(controllers) if generators is None else generators
    with ThreadPoolExecutor(workers or joblib.cpu_count()) as pool:
        flights = [
            pool.submit(track, model, controller, rate=rate, delay=delay, sensors=sensors, rng=rng)
            for controller, rng in zip(controllers, draws, strict=True)
        ]
        return [flight.result() for flight in flights]


def starting_point(model: SpacecraftModel, controller: ModelBasedController) -> np.ndarray:
    """Return q (nq,): home with the attitude and joint angles of the reference's beginning."""
    wanted = controller.reference.at(0.0)[0]
    q = model.set_joint_angles(model.home, wanted[3:])
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(*wanted[:3])).coeffs()
    return q


def tracking_of(
    model: SpacecraftModel,
    controller: ModelBasedController,
    time: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    tau: np.ndarray,
    actuators: Actuators,
) -> TrackingRun:
    """Return a run from ``time`` (N,) [s], states q (N, nq), v (N, nv) and generalised forces tau (N, nv)."""
    wanted = controller.reference.sampled(time)
    position, rate = wanted[:, 0], wanted[:, 1]
    base, base_rate = attitude_errors(
        controller.coordinates, rotation_matrices(q[:, 3:7]), v[:, 3:6], position[:, :3], rate[:, :3]
    )
    error = np.hstack([base, position[:, 3:] - model.joint_angles(q)])
    error_rate = np.hstack([base_rate, rate[:, 3:] - v[:, model.arm_joints.v]])
    wheels = tau[:, model.wheels.v]
    torques = np.hstack([-wheels @ actuators.layout.axes.T, tau[:, model.arm_joints.v]])
    return TrackingRun(
        time, error, error_rate, torques, wheels, v[:, model.wheels.v], q, v, dict(actuators.hits)
    )


def disturbance(run: TrackingRun, gains: Gains) -> np.ndarray:
    """Return d_tot = dde + K_D de + K_P e (N, 3 + n) [rad/s^2] of a run, (45); dde by central differences."""
    second = np.gradient(run.error_rate, run.time, axis=0)
    return second + run.error_rate @ gains.derivative + run.error @ gains.proportional


def left_out(model: SpacecraftModel, gains: Gains, reference: Motion, *, rate: float = 100.0) -> np.ndarray:
    """Return the bound (3 + n,) [rad/s^2] on what slosh and panel do along a reference: the largest |d_d|.

    The complete spacecraft flies the reference under PD with its own parameters and exact measurements, so
    all that is left of (45) is d_d (and the hold of the sampled torques, which the loop sees as well).
    """
    run = track(
        model, ModelBasedController(ReducedDynamics(model), gains, reference), rate=rate, limits=False
    )
    return np.abs(disturbance(run, gains)).max(axis=0)


def sensor_noise(
    sensors: Sequence[Sensor], joints: int, rate: float, crossover: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return one sigma of noise on angles and rates, (3 + n,) each [rad, rad/s], in the band of the loop.

    As `sensor_sigma`, sampled at ``rate`` [Hz], below ``crossover`` [rad/s].
    """
    angle, speed = sensor_sigma(sensors, joints)
    return in_band(angle, rate, crossover), in_band(speed, rate, crossover)


def sensor_sigma(sensors: Sequence[Sensor], joints: int) -> tuple[np.ndarray, np.ndarray]:
    """Return one sigma of a sample's noise on angles and rates, (3 + n,) each [rad, rad/s].

    White noise of the first sensor that measures the quantity; biases are no noise and not counted. Raises
    `ControlError` when a quantity is not measured, or without noise.
    """
    sizes = {"attitude": 3, "joint_position": joints, "angular_rate": 3, "joint_velocity": joints}
    sigma = {}
    for quantity, size in sizes.items():
        if not size:  # no joints
            sigma[quantity] = np.zeros(0)
            continue
        owner = next((s for s in sensors if quantity in s.quantities), None)
        if owner is None:
            raise ControlError(
                f"No sensor measures {quantity.replace('_', ' ')}, so its noise is not known.",
                advice="Add a sensor to the description.",
            )
        sigma[quantity] = np.broadcast_to(owner.error(quantity).white_sigma(owner.rate), size)
        if not (sigma[quantity] > 0.0).all():
            raise ControlError(
                f"No noise is stated of {quantity.replace('_', ' ')}, measured by '{owner.name}'; a design "
                "without noise is ill-posed.",
                advice=f"State it in the description: errors.{quantity} = {{ noise_sigma = ... }}, or let "
                "another sensor measure it.",
                sensor=owner.name,
            )
    return (
        np.concatenate([sigma["attitude"], sigma["joint_position"]]),
        np.concatenate([sigma["angular_rate"], sigma["joint_velocity"]]),
    )
