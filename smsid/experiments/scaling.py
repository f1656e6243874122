"""How strong the named experiments are on a craft of its own size and limits."""

from __future__ import annotations

import numpy as np

from smsid.model.spacecraft import SpacecraftModel, motion_columns

THRUST = 40.0  # [N] of Exp. 1 per axis, equation (48)
DEFAULT_ACCELERATION = 0.02  # [m/s^2] by thrust along one axis; the paper's spacecraft takes 0.018
LIMIT_SHARE = 0.9  # of a declared thrust limit that is used when it is what limits
BUS_RATE = 0.2  # [rad/s] of the bus at most when wheels give it all their momentum
DEFAULT_WHEEL_RATE = 400.0  # [rad/s] of a wheel without declared limit
WHEEL_TORQUE = 1.0  # [N m] of a wheel without declared limit
SWING = 0.6  # [rad] of an arm joint about home
SLIDE_SHARE = 0.2  # of the largest bus dimension: how far a joint slides about home


def thrust_strength(model: SpacecraftModel) -> tuple[float, str]:
    """Return the thrust per axis [N] of Exp. 1, 40 N or less, and what limits it.

    That is empty, a small craft or weak thrusters.
    """
    limit = model.description.thrust.max_force
    choices = [
        (THRUST, ""),
        (DEFAULT_ACCELERATION * model.mass, f"{DEFAULT_ACCELERATION:g} m/s^2 on {model.mass:.4g} kg"),
    ]
    if limit is not None and limit < THRUST:
        choices.append((LIMIT_SHARE * limit, f"[thrust] max_force = {limit:g} N"))
    return min(choices, key=lambda choice: choice[0])


def spin_inertias(model: SpacecraftModel) -> np.ndarray:
    """Return the spin inertia of every wheel (wheels,) [kg m^2], also of those that are joints of a URDF."""
    inertias = []
    for joint in model.wheels.joints.tolist():
        axis = motion_columns(model.pin, joint)[3:, 0]
        about = model.pin.inertias[joint].matrix()[3:, 3:]
        inertias.append(float(axis @ about @ axis))
    return np.array(inertias)


def wheel_strengths(model: SpacecraftModel, share: float) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return the largest torque [N m] and momentum [N m s] of every wheel (wheels,), and what limits them.

    ``share`` of the declared limits is used. A light bus keeps to ``BUS_RATE``.
    """
    inertias = spin_inertias(model)
    torque = share * np.array([w.max_torque or WHEEL_TORQUE for w in model.description.wheel])
    rate = np.array([w.max_rate or DEFAULT_WHEEL_RATE for w in model.description.wheel])
    momentum = share * rate * inertias
    notes = []
    if model.free:
        moments = model.pin.inertias[1].inertia
        bound = BUS_RATE * float(np.linalg.eigvalsh(moments)[0])
        for i, name in enumerate(model.wheels.names):
            if momentum[i] > bound:
                notes.append(f"{name}: {bound:.3g} N m s, which turn the bus at {BUS_RATE:g} rad/s")
        momentum = np.minimum(momentum, bound)
    return torque, momentum, notes


def bus_size(model: SpacecraftModel) -> float | None:
    """Return the largest edge [m] of the box with the bus's mass and moments; None on a welded bus.

    Panels and other effects do not count: a tank is in the bus itself.
    """
    if not model.free:
        return None
    inertia = (model.source or model).pin.inertias[1]
    moments = np.linalg.eigvalsh(inertia.inertia)
    square = 6.0 * (moments.sum() - 2.0 * moments) / inertia.mass
    return float(np.sqrt(max(square.max(), 0.0)))


def swings(model: SpacecraftModel, amplitude: float) -> np.ndarray:
    """Return how far every arm joint moves about home (joints,) [rad | m] before limits: sliding ones by
    the size of the craft.
    """
    size = bus_size(model)
    slide = amplitude if size is None else min(amplitude, SLIDE_SHARE * size * amplitude / SWING)
    kinds = [model.pin.joints[int(j)].shortname() for j in model.arm_joints.joints]
    return np.array([slide if "JointModelP" in k and "Planar" not in k else amplitude for k in kinds])
