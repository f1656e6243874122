"""Spacecraft the tests of the controller share."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import ctrlsys
import numpy as np
import pinocchio as pin

from smsid.control._sensed import measured_truth
from smsid.control._statespace import StateSpace
from smsid.control._wheels import WheelLayout
from smsid.control.closed_loop import Actuators, TrackingRun, starting_point, tracking_of
from smsid.control.pd import ModelBasedController
from smsid.control.reduced import BodyTerms, ReducedDynamics
from smsid.description import Description, load_description
from smsid.model import SpacecraftModel, build_model
from smsid.simulate.integrate import ChartDerivative, initial_state

URDF = Path(__file__).resolve().parents[2] / "urdf"


@cache
def paper() -> SpacecraftModel:
    return build_model(load_description(URDF / "paper_sms.toml"))


@cache
def two_arms() -> SpacecraftModel:
    return build_model(load_description(URDF / "two_arm_sms.toml"))


@cache
def rigid_paper() -> SpacecraftModel:
    """The paper's spacecraft without slosh and panel."""
    described = load_description(URDF / "paper_sms.toml")
    sensors = tuple(s for s in described.sensor if s.kind != "accelerometers")
    return build_model(described.with_sensors(*sensors).model_copy(update={"effect": ()}))


def described(**changes) -> Description:
    return load_description(URDF / "paper_sms.toml").model_copy(update=changes)


def random_state(model: SpacecraftModel, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A state in full motion, base attitude and linear velocity included; slosh and bending at rest."""
    q, v = model.home.copy(), np.zeros(model.nv)
    q[:3] = rng.standard_normal(3)
    q[3:7] = pin.Quaternion(pin.exp3(rng.standard_normal(3))).coeffs()
    q = model.set_joint_angles(q, rng.uniform(-2.0, 2.0, len(model.arm_joints)))
    v[:3], v[3:6] = rng.standard_normal(3), 0.3 * rng.standard_normal(3)
    v[model.arm_joints.v] = rng.standard_normal(len(model.arm_joints))
    v[model.wheels.v] = 50.0 * rng.standard_normal(len(model.wheels))
    return q, v


def slicot_norm(s: StateSpace) -> float:
    """The H-infinity norm by SLICOT's ab13dd."""
    f = [np.asfortranarray(x) for x in (s.a, np.eye(s.order), s.b, s.c, s.d)]
    size, guess = s.d.shape[::-1], np.array([0.0, 1.0])
    gain, _, info = ctrlsys.ab13dd("C", "I", "N", "D", s.order, *size, guess, *f, 1e-12)
    assert info == 0
    return gain[0] / gain[1]


def track_continuously(
    model: SpacecraftModel, controller: ModelBasedController, *, dt: float, duration: float | None = None
) -> TrackingRun:
    """Fly with the exact state fed back continuously: the controller is part of the state derivative.

    Fourth-order Runge-Kutta with steps of ``dt`` [s], no limits; without robust term, whose state is sampled.
    """
    assert controller.filter is None
    duration = controller.reference.duration if duration is None else duration
    layout = WheelLayout.of(model)

    def force(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        torques = controller.command(t, measured_truth(model, q, v)).torques
        tau = np.zeros(model.nv)
        tau[model.wheels.v], tau[model.arm_joints.v] = -layout.inverse @ torques[:3], torques[3:]
        return tau

    def acceleration(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return model.acceleration(t, q, v, force(t, q, v))

    steps, nv = round(duration / dt), model.nv
    q, v = initial_state(model, starting_point(model, controller), None)
    rows = [(0.0, q, v, force(0.0, q, v))]
    for i in range(steps):
        t, k = i * dt, np.empty((4, 2 * nv))
        slope = ChartDerivative(model, acceleration, q)
        y = np.concatenate([np.zeros(nv), v])
        slope(t, y, k[0])
        slope(t + dt / 2, y + dt / 2 * k[0], k[1])
        slope(t + dt / 2, y + dt / 2 * k[1], k[2])
        # just before the end of the step, where the reference may jump
        slope(t + dt * (1.0 - 1e-9), y + dt * k[2], k[3])
        y = y + dt / 6 * (k[0] + 2 * k[1] + 2 * k[2] + k[3])
        q, v = pin.integrate(model.pin, q, y[:nv]), y[nv:]
        rows.append((t + dt, q, v, force(t + dt, q, v)))
    time, qs, vs, tau = (np.array(x) for x in zip(*rows, strict=True))
    return tracking_of(model, controller, time, qs, vs, tau, Actuators(model, dt))


def joint_space(
    reduced: ReducedDynamics,
    coordinates: np.ndarray,
    rates: np.ndarray,
    wheel_rates: np.ndarray | None = None,
) -> BodyTerms:
    """Return H qdd + c = J_c^T Q_c (40) in the paper's coordinates (41): roll, pitch, yaw, arm joints.

    ``coordinates``, ``rates`` (3 + n,) q and its derivative [rad, rad/s]; ``wheel_rates`` (w,) [rad/s],
    by default those of zero total momentum. ``input`` is J_c^T (3 + n, 3 + n).
    """
    chart, turning = np.eye(reduced.size), np.zeros(reduced.size)
    chart[:3, :3] = jacobian = pin.rpy.computeRpyJacobian(coordinates[:3], pin.LOCAL)
    change = pin.rpy.computeRpyJacobianTimeDerivative(coordinates[:3], rates[:3], pin.LOCAL)
    turning[:3] = change @ rates[:3]
    terms = reduced.body_terms(jacobian @ rates[:3], coordinates[3:], rates[3:], wheel_rates)
    bias = terms.bias + terms.inertia @ turning
    return BodyTerms(chart.T @ terms.inertia @ chart, chart.T @ bias, chart.T @ reduced.base_input(terms))
