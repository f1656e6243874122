"""Torques of joints and wheels that follow their measured motion: how far they wander beside commands."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from smsid.estimation.input_hold import Hold, commanded, input_channels, means, unevenness
from smsid.estimation.input_timing import CLEARLY, timings
from smsid.estimation.measurements import Measurements
from smsid.estimation.problem import CommandTiming, UnknownInput
from smsid.estimation.torque_walk import UNKNOWN, AccelerationWalk, acceleration_walks
from smsid.inputs.signals import sample
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.simulate import Inputs

LOGGER = logging.getLogger(__name__)
LIVELY = 10.0  # times its likeliest walk that a torque has: too lively costs little, too smooth is wrong
WINDOW = 0.5  # [s] of a reading whose polynomial gives its acceleration and jerk


def followed_torques(
    model: SpacecraftModel,
    recording: Recording,
    data: Measurements,
    followed: Sequence[int],
    locked: np.ndarray,
    looks: CommandTiming,
) -> tuple[list[UnknownInput], CommandTiming]:
    """Return the torques of degrees of freedom (k,) that are ``followed``, as lively as their motion says.

    Beside a recorded command, as lively as what all commands leave of the motion, of a craft of which nothing
    but ``locked`` degrees of freedom (j,) is held. Also how commands act between samples: as it ``looks``
    unless these readings clearly say else, of which the filter's likelihood holds nothing.
    """
    times, inputs = data.times, input_channels(model, recording)
    mass = np.diag(pin.crba(model.pin, model.pin.createData(), model.home))
    holds: list[Hold] = list(dict.fromkeys((looks.hold, *(t.hold for t in timings(recording)))))
    signals = [commanded(model, recording, h, required=False) for h in holds]
    moved = [_moved(model, s, times, locked) for s in signals]
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
            command = sample(getattr(signals[0], torque), times)
            size = np.maximum(size, np.sqrt(np.nanmean(command**2, axis=0)))
            left = [readings - by[integrations - 1][:, group.v] for by in moved]
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


def _moved(model: SpacecraftModel, inputs: Inputs, times: np.ndarray, locked: np.ndarray) -> list[np.ndarray]:
    """Return what commands change rates and angles by at ``times`` (N,) [s], (N, nv) each, near home."""
    free = np.setdiff1d(np.arange(model.nv), locked)
    upper = np.triu(pin.crba(model.pin, model.pin.createData(), model.home))
    inverse = np.zeros((model.nv, model.nv))
    inverse[np.ix_(free, free)] = np.linalg.inv((upper + np.triu(upper, 1).T)[np.ix_(free, free)])
    signal, h = inputs.driven(model).applied(model), np.diff(times)[:, None]
    mean, more = (x @ inverse for x in (means(signal, times), unevenness(signal, times)))
    rates = np.cumsum(np.vstack([np.zeros(model.nv), h * mean]), axis=0)
    steps = h * rates[:-1] + 0.5 * h**2 * mean + more
    return [rates, np.cumsum(np.vstack([np.zeros(model.nv), steps]), axis=0)]


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
