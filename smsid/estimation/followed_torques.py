"""Torques of joints and wheels that follow their measured motion: how far they wander beside commands."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from smsid.estimation.input_hold import Hold, commanded, input_channels, integral
from smsid.estimation.input_timing import CLEARLY, timings
from smsid.estimation.measurements import Measurements
from smsid.estimation.problem import CommandTiming, UnknownInput
from smsid.estimation.torque_walk import UNKNOWN, AccelerationWalk, acceleration_walks
from smsid.inputs.signals import sample
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

LOGGER = logging.getLogger(__name__)
LIVELY = 10.0  # times its likeliest walk that a torque has: too lively costs little, too smooth is wrong
WINDOW = 0.5  # [s] of a reading whose polynomial gives its acceleration and jerk


def followed_torques(
    model: SpacecraftModel,
    recording: Recording,
    data: Measurements,
    followed: Sequence[int],
    looks: CommandTiming,
) -> tuple[list[UnknownInput], CommandTiming]:
    """Return the torques of degrees of freedom that are ``followed``, as lively as their motion says.

    Beside a recorded command, as lively as what that leaves of the motion: what it does not move in the joint
    by itself. Also how commands act between samples: as it ``looks`` unless these readings clearly say else,
    of which the filter's likelihood holds nothing.
    """
    times = data.times
    inertia = pin.crba(model.pin, model.pin.createData(), model.home)
    mass = np.diag(inertia)
    alone = 1.0 / np.diag(np.linalg.inv(np.triu(inertia) + np.triu(inertia, 1).T))
    inputs = input_channels(model, recording)
    holds: list[Hold] = list(dict.fromkeys((looks.hold, *(t.hold for t in timings(recording)))))
    signals = [commanded(model, recording, h, required=False) for h in holds]
    found: list[tuple[UnknownInput, list[AccelerationWalk]]] = []
    for group, torque, quantities in (
        (model.arm_joints, "joint_torque", ("joint_velocity", "joint_position")),
        (model.wheels, "wheel_torque", ("wheel_rate",)),
    ):
        free = [i for i, v in enumerate(group.v) if int(v) in followed]
        if not free:
            continue
        block = next(b for q in quantities for b in data.blocks if b.quantity == q)
        integrations = 2 if block.quantity == "joint_position" else 1
        readings, sigma = data.values[:, block.rows], data.sigma[block.rows]
        size = mass[group.v] * _motion_scales(times, readings, integrations)[0]
        left = [readings]
        if torque in inputs:
            commands = [getattr(s, torque) for s in signals]
            size = np.maximum(size, np.sqrt(np.nanmean(sample(commands[0], times) ** 2, axis=0)))
            left = [readings - integral(c, times, integrations) / alone[group.v] for c in commands]
        walks = [
            acceleration_walks(times, x, sigma, integrations, _motion_scales(times, x, integrations))
            for x in left
        ]
        walks = walks if torque in inputs else walks * len(holds)
        for i in free:
            own = int(group.v[i]), UNKNOWN * float(size[i]), float(mass[group.v[i]])
            unknown = UnknownInput(*own, motor=torque in inputs, row=block.rows.start + i)
            found.append((unknown, [w[i] for w in walks]))
    likely = [sum(walks[k].log_likelihood for _, walks in found) for k in range(len(holds))]
    LOGGER.info(
        "by what is followed: %s", ", ".join(f"{h} {x:.1f}" for h, x in zip(holds, likely, strict=True))
    )
    best = int(np.argmax(likely)) if max(likely) > likely[0] + CLEARLY else 0
    unknown = [
        replace(u, walk=LIVELY * u.walk * walks[best].walk, slope=u.walk * walks[best].slope)
        for u, walks in found
    ]
    return unknown, replace(looks, hold=holds[best])


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
