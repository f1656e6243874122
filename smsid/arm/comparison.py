"""Measured torques of an arm beside those that a model predicts.

Relative errors are what the literature on identified robots quotes (Gautier 1997).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from smsid._short_repr import short_repr
from smsid.identify.estimate import Estimate
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording


@dataclass(frozen=True)
class TorqueErrors:
    """How far predicted torques are from measured ones.

    ``relative`` is ``|predicted - measured| / |measured|`` over all samples and joints, ``by_joint`` the
    same of each that has torques; ``rmse`` by joint [N m | N].
    """

    relative: float
    by_joint: dict[str, float]
    rmse: dict[str, float]


@short_repr
@dataclass(frozen=True)
class TorqueComparison:
    """``time`` (B,) [s], ``measured`` and ``predicted`` torques (B, nv) of the model's joints [N m | N]."""

    time: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray


def torque_errors(
    model: SpacecraftModel, predicted: np.ndarray, measured: np.ndarray, without: Collection[str] = ()
) -> TorqueErrors:
    """Compare torques of the model's joints, ``predicted`` and ``measured``, (N, nv) [N m].

    Joints ``without`` torques, both zero, are not listed.
    """
    error = predicted - measured
    joints = dict(zip(model.arm_joints.names, model.arm_joints.v.tolist(), strict=True))
    joints = {n: k for n, k in joints.items() if n not in without}
    size = {n: float(np.linalg.norm(measured[:, k])) for n, k in joints.items()}
    return TorqueErrors(
        float(np.linalg.norm(error) / np.linalg.norm(measured)),
        {n: float(np.linalg.norm(error[:, k])) / size[n] for n, k in joints.items() if size[n] > 0.0},
        {n: float(np.sqrt(np.mean(error[:, k] ** 2))) for n, k in joints.items()},
    )


class JudgedArm(Protocol):
    """An identified arm that can be held against recordings."""

    @property
    def estimate(self) -> Estimate:
        """Return what was identified."""
        ...

    @property
    def model(self) -> SpacecraftModel:
        """Return the model of its links."""
        ...

    def compare(self, recording: Recording | None = None) -> TorqueComparison:
        """Return torques of the recording identified from, or of another."""
        ...

    def residual(self, recording: Recording | None = None) -> np.ndarray:
        """Return measured minus predicted torques (B, nv) [N m | N]."""
        ...

    def judge(self, recording: Recording) -> TorqueErrors:
        """Return the errors on a recording."""
        ...
