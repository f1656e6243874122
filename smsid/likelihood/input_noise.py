"""Noise of the measured inputs, as it shows in the outputs.

In free floating the prediction is driven by measured joint and wheel motion. An error e of their rates moves
the predicted base velocity by A e, ``A = -M_ff^-1 M_fp`` (momentum is conserved), so the gyro's residual is
its own noise plus A e. The fitted motion lets errors through only in the band of the motion, but in that band
they are as white as the gyro's noise; what counts for the parameters is the density there. Each channel is
therefore whitened with its own covariance plus A S A^T, S the equivalent covariance per sample of the fitted
rates, in which what the positions say is already used (`MeasuredMotion`). Velocity, attitude and position
get the same treatment; accelerometers do not: their own noise is orders of magnitude above it in band.

Averaged over the motion. An error of the inputs also moves the regressors, which biases by the square of
noise over signal: at the reference noise 1e-8, so it is left out.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from smsid.likelihood.channels import Channel
from smsid.likelihood.drive import Drive
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction, rotation_matrices
from smsid.likelihood.sensitivity import skew

LOOKS = 60  # configurations averaged over


def with_input_noise(
    channels: tuple[Channel, ...], parameters: Parameters, drive: Drive, prediction: Prediction
) -> tuple[Channel, ...]:
    """Return the channels with the noise of measured joint and wheel motion added to their own."""
    if drive.held or (drive.joints is None and drive.wheels is None):
        return channels
    model = parameters.layout.model
    q, _, _ = prediction.at_nodes()
    chosen = np.unique(np.linspace(0, len(q) - 1, LOOKS).astype(int))
    index, rate, angle = [], [], []
    for group, motion in ((model.arm_joints, drive.joints), (model.wheels, drive.wheels)):
        if motion is not None:
            index += [int(i) for i in group.v]
            rate += list(motion.rate_density**2)
            angle += list(motion.angle_density**2)
    follow = np.array([base_response(prediction.model, q[i], drive.free, np.array(index)) for i in chosen])
    turn = rotation_matrices(q[chosen, 3:7])
    out = []
    for c in channels:
        linear, angular = follow[:, :3], follow[:, 3:]
        at = turn @ (linear - skew(np.asarray(c.sensor.position, dtype=float)) @ angular)
        gains = {
            "velocity": (at, rate),
            "position": (at, angle),
            "angular_rate": (angular, rate),
            "attitude": (angular, angle),
        }
        if c.quantity not in gains:
            out.append(c)
            continue
        gain, variance = gains[c.quantity]
        added = np.einsum("nij,j,nkj->ik", gain, np.array(variance), gain) / len(gain)
        out.append(c.with_covariance(c.covariance + added))
    return tuple(out)


def base_response(model: pin.Model, q: np.ndarray, free: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return d(base velocity) / d(rates ``index`` of v) (6, k) at conserved momentum, bus frame."""
    mass = pin.crba(model, model.createData(), q)
    mass = np.triu(mass) + np.triu(mass, 1).T
    response = -np.linalg.solve(mass[np.ix_(free, free)], mass[np.ix_(free, index)])
    out = np.zeros((6, len(index)))
    base = free < 6
    out[free[base]] = response[base]
    return out
