"""Torques of joints and wheels that follow their measured motion: how far they wander."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from smsid.estimation._torque_walk import UNKNOWN_FACTOR, acceleration_walks
from smsid.estimation.input_hold import input_channels
from smsid.estimation.measurements import Measurements
from smsid.estimation.problem import UnknownInput
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

LIVELY = 10.0  # times its likeliest walk that a torque has: too lively costs little, too smooth is wrong
WINDOW = 0.5  # [s] of a reading whose polynomial gives its acceleration and jerk


def followed_torques(
    model: SpacecraftModel, recording: Recording, data: Measurements, followed: Sequence[int]
) -> list[UnknownInput]:
    """Return the torques of degrees of freedom (k,) that are ``followed``, as lively as their motion says.

    A recorded command is where they wander about, no evidence that they stay near it.
    """
    found: list[UnknownInput] = []
    inputs, times = input_channels(model, recording), data.times
    mass = np.diag(pin.crba(model.pin, model.pin.createData(), model.home))
    for group, torque, quantities in (
        (model.arm_joints, "joint_torque", ("joint_velocity", "joint_position")),
        (model.wheels, "wheel_torque", ("wheel_rate",)),
    ):
        free = [i for i, v in enumerate(group.v) if int(v) in followed]
        if not free:
            continue
        block = next(b for q in quantities for b in data.blocks if b.quantity == q)
        integrations = 2 if block.quantity == "joint_position" else 1
        readings = data.values[:, block.rows]
        acceleration, jerk = _motion_scales(times, readings, integrations)
        size = mass[group.v] * acceleration
        if torque in inputs:
            commands = np.asarray(recording[inputs[torque]], dtype=float).reshape(-1, len(group))
            size = np.maximum(size, np.sqrt(np.nanmean(commands**2, axis=0)))
        told = acceleration_walks(times, readings, data.sigma[block.rows], integrations, (acceleration, jerk))
        walk = LIVELY * mass[group.v] * [t.walk for t in told]
        slope = mass[group.v] * [t.slope for t in told]
        for i in free:
            own = int(group.v[i]), UNKNOWN_FACTOR * float(size[i]), float(walk[i])
            row = block.rows.start + i
            found.append(UnknownInput(*own, motor=torque in inputs, row=row, slope=float(slope[i])))
    return found


def _motion_scales(times: np.ndarray, x: np.ndarray, integrations: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the root mean square acceleration and jerk (k,) of rates x (N, k), or after two ``integrations``
    angles, at ``times`` (N,) [s].

    From parabolas or cubics through `WINDOW` [s] of it.
    """
    there = np.isfinite(x).all(axis=1)
    t, x = times[there], x[there]
    half = max(4, round(0.5 * WINDOW / float(np.median(np.diff(t)))))
    if len(t) < 2 * half + 2:
        return np.zeros(x.shape[1]), np.zeros(x.shape[1])
    accelerations, jerks = [], []
    for k in range(half, len(t) - half, max(half, len(t) // 2000)):
        own = slice(k - half, k + half + 1)
        fit = np.polynomial.polynomial.polyfit(t[own] - t[k], x[own], integrations + 1)
        accelerations.append((integrations * fit[integrations]) ** 2)
        jerks.append((integrations * (integrations + 1) * fit[integrations + 1]) ** 2)
    return np.sqrt(np.mean(accelerations, axis=0)), np.sqrt(np.mean(jerks, axis=0))
