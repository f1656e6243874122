"""What is known of the state when a recording begins: its first samples, and wide priors for the rest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from smsid.estimation.measurements import Measurements, matrix
from smsid.estimation.problem import Belief
from smsid.model.spacecraft import SpacecraftModel, set_group_angles

READ_SIGMAS = 5.0  # standard deviations of a sensor's noise by which its first reading may be off
LATEST_FIRST = 2.0  # [s] how late a channel's first sample may come and still say where the motion began


@dataclass(frozen=True)
class InitialPrior:
    """Standard deviations of what no sensor reads at the first sample.

    ``position`` [m], ``attitude`` [rad], ``velocity`` [m/s] and ``rate`` [rad/s] of the bus, ``joint_angle``
    [rad | m] and ``joint_rate`` [rad/s | m/s], ``wheel_rate`` [rad/s]; ``hidden`` of slosh and modal
    coordinates and of their rates [m, m/s], ``by_name`` the same for single tanks and appendages. ``at_rest``
    says that nothing moves at all: only where slosh and modes are in equilibrium.
    """

    position: float = 10.0
    attitude: float = 0.5
    velocity: float = 1.0
    rate: float = 0.05
    joint_angle: float = 0.5
    joint_rate: float = 0.2
    wheel_rate: float = 100.0
    hidden: tuple[float, float] = (0.3, 0.1)
    by_name: dict[str, tuple[float, float]] = field(default_factory=dict)
    at_rest: bool = False


AT_REST = 1e-6  # [m, rad, m/s, rad/s] how far from rest a motion that begins at rest may be


def initial_belief(
    model: SpacecraftModel,
    data: Measurements,
    locked: np.ndarray,
    prior: InitialPrior | None = None,
    unsure: np.ndarray | None = None,
) -> Belief:
    """Return mean and covariance of the state at the first sample.

    What is measured is read from the first samples, `READ_SIGMAS` times their noise wide; a rate not
    measured from the change of what is; the rest has the prior's mean zero (home, at rest) and width.
    ``locked`` are degrees of freedom (k,) held still. ``unsure`` (rows,) are standard deviations of readings
    beside their noise: of sensors whose errors are unknown.
    """
    prior = prior or InitialPrior()
    nv = model.nv
    q, v = model.home.copy(), np.zeros(nv)
    sigma = _prior_sigma(model, prior)
    place, rate = sigma[:nv], sigma[nv:]
    position: tuple[np.ndarray, np.ndarray, float] | None = None
    speed: tuple[np.ndarray, np.ndarray, float] | None = None
    turned = False
    for block in data.blocks:
        if block.quantity == "acceleration":  # tells what acts, not where the motion is
            continue
        k = _first(data, block.rows)
        if k is None:
            continue
        first = np.linalg.solve(block.gain, data.values[k, block.rows] - block.bias)
        noise = READ_SIGMAS * data.sigma[block.rows]
        if unsure is not None:  # a reading tells no less than the prior, however wide its sensor's errors
            noise = np.hypot(noise, np.minimum(unsure[block.rows], _width(prior, block.quantity)))
        if block.quantity == "joint_position":
            q = set_group_angles(model.arm_joints, q, first)
            place[model.arm_joints.v] = np.maximum(noise, 1e-6)
        elif block.quantity == "joint_velocity":
            v[model.arm_joints.v] = first
            rate[model.arm_joints.v] = np.maximum(noise, 1e-6)
        elif block.quantity == "wheel_rate":
            v[model.wheels.v] = first
            rate[model.wheels.v] = np.maximum(noise, 1e-6)
        elif not model.free:
            continue
        elif block.quantity == "angular_rate":
            v[3:6] = first
            rate[3:6] = np.maximum(noise, 0.002)  # a gyro may have a bias
            turned = True
        elif block.quantity == "attitude":
            turned_by = pin.Quaternion(pin.exp3(-block.bias)).coeffs()
            q[3:7] = (pin.Quaternion(data.attitude[block.channel][k]) * pin.Quaternion(turned_by)).coeffs()
            place[3:6] = np.maximum(noise, 1e-6)
        elif block.quantity == "position":
            position = first, np.asarray(block.sensor.position), float(noise.max())
        elif block.quantity == "velocity":
            speed = first, np.asarray(block.sensor.position), float(noise.max())
    if model.free:
        rotation = matrix(q[3:7])
        if not turned and _rate_of_attitude(data) is not None:
            v[3:6] = _rate_of_attitude(data)
        if position is not None:
            q[:3] = position[0] - rotation @ position[1]
            lever = float(np.linalg.norm(position[1]))
            place[:3] = position[2] + lever * float(place[3:6].max())
        if speed is not None:
            v[:3] = rotation.T @ speed[0] - np.cross(v[3:6], speed[1])
            rate[:3] = speed[2] + 0.01
    v[locked], place[locked], rate[locked] = 0.0, 1e-3, 1e-9
    return Belief(pin.normalize(model.pin, q), v, np.diag(sigma**2))


def _prior_sigma(model: SpacecraftModel, prior: InitialPrior) -> np.ndarray:
    """Return the standard deviations (2 nv,) of what is not read."""
    nv = model.nv
    sigma = np.concatenate([np.full(nv, prior.hidden[0]), np.full(nv, prior.hidden[1])])
    place, rate = sigma[:nv], sigma[nv:]
    for joint in range(1, model.pin.njoints):
        name = model.pin.names[joint]
        owner = next((n for n in prior.by_name if name == n or name.startswith(f"{n}.")), None)
        if owner is not None:
            index = slice(
                model.pin.joints[joint].idx_v, model.pin.joints[joint].idx_v + model.pin.joints[joint].nv
            )
            place[index], rate[index] = prior.by_name[owner]
    if prior.at_rest:
        place[:], rate[:] = AT_REST, AT_REST
    if model.free:
        place[:3], place[3:6] = prior.position, prior.attitude
        if not prior.at_rest:
            rate[:3], rate[3:6] = prior.velocity, prior.rate
    place[model.arm_joints.v], place[model.wheels.v] = prior.joint_angle, 1e-3
    if not prior.at_rest:
        rate[model.arm_joints.v], rate[model.wheels.v] = prior.joint_rate, prior.wheel_rate
    return sigma


def _width(prior: InitialPrior, quantity: str) -> float:
    """Return the prior's standard deviation of what a quantity reads."""
    return {
        "joint_position": prior.joint_angle,
        "joint_velocity": prior.joint_rate,
        "wheel_rate": prior.wheel_rate,
        "angular_rate": prior.rate,
        "attitude": prior.attitude,
        "position": prior.position,
        "velocity": prior.velocity,
    }.get(quantity, np.inf)


def _first(data: Measurements, rows: slice) -> int | None:
    """Return the first sample at which a channel is there, if that is soon enough."""
    there = np.flatnonzero(np.isfinite(data.values[:, rows]).all(axis=1))
    if not len(there) or data.times[there[0]] - data.times[0] > LATEST_FIRST:
        return None
    return int(there[0])


def _rate_of_attitude(data: Measurements) -> np.ndarray | None:
    """Return the mean angular rate (3,) over the first second of attitudes, body axes."""
    for q in data.attitude.values():
        there = np.flatnonzero(np.isfinite(q).all(axis=1))
        there = there[data.times[there] <= data.times[0] + 1.0]
        if len(there) > 1:
            first, last = (matrix(q[i]) for i in (there[0], there[-1]))
            return pin.log3(first.T @ last) / float(data.times[there[-1]] - data.times[there[0]])
    return None
