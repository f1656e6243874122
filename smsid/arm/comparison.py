"""Measured torques of an arm beside those that a model predicts.

Relative errors are what the literature on identified robots quotes (Gautier 1997).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection
from dataclasses import dataclass

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


class JudgedArm(ABC):
    """An identified arm that can be held against recordings.

    ``estimate`` is what was identified, ``model`` that of its links, ``unused`` the joints whose torque
    signals took no part.
    """

    estimate: Estimate
    model: SpacecraftModel
    unused: tuple[str, ...] = ()

    @abstractmethod
    def compare(self, recording: Recording | None = None) -> TorqueComparison:
        """Return torques of the recording identified from, or of another."""

    def residual(self, recording: Recording | None = None) -> np.ndarray:
        """Return measured minus predicted torques (B, nv) at the joints [N m | N], see `compare`."""
        both = self.compare(recording)
        return both.measured - both.predicted

    def judge(self, recording: Recording) -> TorqueErrors:
        """Return how far torques are predicted on a recording, see `compare`.

        Raises:
            RecordingError: as `smooth_motion`.
        """
        both = self.compare(recording)
        return torque_errors(self.model, both.predicted, both.measured, self.unused)

    def verdict(self) -> list[str]:
        """Return sentences on what is left of the torques."""
        return []
