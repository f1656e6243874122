"""Joints and wheels that stand still in all free-floating recordings: what is reported of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smsid.identify.momentum_rows import carried_matrix
from smsid.identify.stationary_joints import Still, taken_away
from smsid.likelihood.combinations import Combination
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import Prediction
from smsid.model.identifiable import BaseParameters
from smsid.model.regressor import Regressor

RESTING = 1e-7  # [rad/s] by which a held rate may vary: little of its noise was left (`measured_drive`)


def held_joints(at: Parameters, predictions: Sequence[Prediction]) -> Still:
    """Return the joints and wheels that are held in all of the motions."""
    if not predictions:
        return Still()
    model = at.layout.model

    def constant(columns: np.ndarray) -> tuple[int, ...]:
        spread = [np.ptp(p.v[:, columns], axis=0) for p in predictions]
        return tuple(np.flatnonzero(np.max(spread, axis=0) < RESTING).tolist())

    return Still(constant(model.arm_joints.v), constant(model.wheels.v))


def not_seen(at: Parameters, described: Parameters, still: Still, base: BaseParameters) -> list[Combination]:
    """Return what is not among the ``base`` because joints stand still: the prior alone knows it."""
    model, theta, jacobian = at.layout.model, at.theta(), at.theta_jacobian()
    full = np.eye(len(theta)) + carried_matrix(at.layout.model, Regressor(model))
    out = []
    for c in taken_away(model, still.joints, base):
        row = c.row @ full
        value, nominal = float(row @ theta), float(row @ described.theta())
        out.append(Combination(c.name, c.unit, value, row @ jacobian, nominal))
    return out
