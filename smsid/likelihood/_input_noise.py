"""Noise of the measured inputs, as it shows in the outputs.

In free floating the prediction is driven by measured joint and wheel motion. An error e of their rates moves
the predicted base velocity by A e, ``A = -M_ff^-1 M_fp`` (momentum is conserved), so the gyro's residual is
its own noise plus A e. The fitted motion lets errors through only in the band of the motion, but in that band
they are as white as the gyro's noise; what counts for the parameters is the density there. Each channel is
therefore whitened with its own covariance plus A S A^T, S the equivalent covariance per sample of the fitted
rates (`FittedMotion`); velocity, attitude and position get the same treatment.

For wheels that is all: a wheel's error moves the bus by 1e-4 of itself. Errors of the joints also shake
the panels near their resonance, where the response is a hundred times A e and not white; so the final passes
estimate the joints' motion together with everything else, encoders and outputs deciding between them, and
this whitening stands in for it only in the first ones.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from smsid.identify.momentum_rows import skew
from smsid.likelihood.channels import Channel
from smsid.likelihood.inputs import DrivenMotion
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction
from smsid.simulate.truth import rotation_matrices

LOOKS = 60  # configurations averaged over


def with_input_noise(
    channels: tuple[Channel, ...],
    parameters: Parameters,
    drive: DrivenMotion,
    prediction: Prediction,
    joints_follow: bool,
) -> tuple[Channel, ...]:
    """Return the channels with the noise of measured motion added to their own.

    ``joints_follow``: the joint motion is estimated with everything else, so only the wheels' noise is left.
    """
    joints = None if joints_follow else drive.joints
    if drive.held or (joints is None and drive.wheels is None):
        return channels
    model = parameters.layout.model
    q = prediction.q
    chosen = np.unique(np.linspace(0, len(q) - 1, LOOKS).astype(int))
    index, rate, angle = [], [], []
    for group, motion in ((model.arm_joints, joints), (model.wheels, drive.wheels)):
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
    """Return d(base velocity) / d(rates ``index`` (k,) of v) (6, k) at conserved momentum, bus frame.

    ``free`` are the indices in v of what follows freely.
    """
    mass = pin.crba(model, model.createData(), q)
    mass = np.triu(mass) + np.triu(mass, 1).T
    response = -np.linalg.solve(mass[np.ix_(free, free)], mass[np.ix_(free, index)])
    out = np.zeros((6, len(index)))
    base = free < 6
    out[free[base]] = response[base]
    return out
