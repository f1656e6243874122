"""Free-floating experiments as points of a box: Fourier series of joints and wheels within their limits.

A point holds, for every joint and wheel, the coefficients of its series. Their shape is free; the size is
what range, rate and wheel limits allow times the length of the joint's coefficients, at most one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from smsid.design.forecast import once_integrated, wheel_inertias
from smsid.design.limits import Limits, least
from smsid.errors import ExperimentError
from smsid.experiments import Experiment, FourierProfile
from smsid.inputs.signals import Fourier
from smsid.model.spacecraft import SpacecraftModel

LOOKS = 600  # times at which a series is held against its limits


@dataclass(frozen=True)
class SeriesSpace:
    """Series of ``harmonics`` terms over ``duration`` [s], the first with ``periods`` periods in it."""

    model: SpacecraftModel
    limits: Limits
    duration: float
    harmonics: int
    periods: int

    @property
    def size(self) -> int:
        """Number of coordinates of a point."""
        return 2 * self.harmonics * (len(self.model.arm_joints) + len(self.model.wheels))

    def random(self, rng: np.random.Generator) -> np.ndarray:
        """Return a random point (size,), the paper's kind of excitation."""
        order = np.tile(np.arange(1, self.harmonics + 1), self.size // self.harmonics)
        return (rng.normal(size=self.size) / order).ravel()

    def experiment(self, point: np.ndarray, shrink: float = 1.0, name: str = "design") -> Experiment:
        """Return the experiment of a point (size,), joints' motion and wheels' torque times ``shrink``.

        It starts at home and at rest.
        """
        n, frequency = len(self.model.arm_joints), self.periods / self.duration
        parts = point.reshape(-1, 2, self.harmonics)
        motion = torque = None
        if n:
            a, b = self._joints(parts[:n])
            a, b = shrink * a, shrink * b
            home = self.model.joint_angles(self.model.home)
            motion = FourierProfile(
                frequency=frequency, cos=_rows(a), sin=_rows(b), offset=tuple(home - a.sum(axis=1))
            )
        if len(self.model.wheels):
            a, b = self._wheels(parts[n:])
            torque = FourierProfile(frequency=frequency, cos=_rows(shrink * a), sin=_rows(shrink * b))
        return Experiment(
            name=name,
            note="designed: Fourier series on joints and wheels, free floating",
            duration=self.duration,
            joint_motion=motion,
            wheel_torque=torque,
        )

    @cached_property
    def _times(self) -> np.ndarray:
        return np.linspace(0.0, self.duration / self.periods, LOOKS)

    @cached_property
    def _waves(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angular frequencies (H,), and cosines and sines (H, times)."""
        w = 2.0 * np.pi * self.periods / self.duration * np.arange(1, self.harmonics + 1)
        phase = np.outer(w, self._times)
        return w, np.cos(phase), np.sin(phase)

    def _joints(self, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        w, cos, sin = self._waves
        a, b = parts[:, 0], parts[:, 1]
        b = b - (b @ w)[:, None] * w / (w @ w)  # at rest at the start
        swing = a @ (cos - 1.0) + b @ sin
        rate = (b * w) @ cos - (a * w) @ sin
        low, high, speed = self._joint_limits
        factor = np.full(len(a), np.inf)
        for room, reach in ((high, swing.max(axis=1)), (low, -swing.min(axis=1))):
            factor = np.minimum(factor, room / np.maximum(reach, 1e-12))
        factor = np.minimum(factor, speed / np.maximum(np.abs(rate).max(axis=1), 1e-12))
        factor *= np.minimum(1.0, np.linalg.norm(parts.reshape(len(a), -1), axis=1))
        return a * factor[:, None], b * factor[:, None]

    @cached_property
    def _joint_limits(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Room below and above home [rad], and rate [rad/s], each (joints,)."""
        model, limits = self.model, self.limits
        home = model.joint_angles(model.home)
        low, high = np.full((2, len(home)), 2.0 * np.pi)
        for i, (j, k) in enumerate(zip(model.arm_joints.joints, model.arm_joints.q, strict=True)):
            bounds = model.pin.lowerPositionLimit[k], model.pin.upperPositionLimit[k]
            if model.pin.joints[int(j)].nq == 1 and np.isfinite(bounds).all() and bounds[1] > bounds[0]:
                middle, half = sum(bounds) / 2.0, limits.usable * (bounds[1] - bounds[0]) / 2.0
                low[i], high[i] = home[i] - (middle - half), middle + half - home[i]
            if min(low[i], high[i]) <= 0.0:
                raise ExperimentError(
                    f"{model.arm_joints.names[i]} is at its limit at home: {home[i]:.4g} rad of "
                    f"{bounds[0]:.4g} to {bounds[1]:.4g} rad.",
                    advice="Give the arm another `home`.",
                )
        if limits.swing is not None:
            low, high = (np.minimum(x, limits.usable * limits.swing) for x in (low, high))
        speed = np.array([float(x) for x in model.pin.velocityLimit[model.arm_joints.v]])
        speed = np.where((speed > 0.0) & (speed < 1e20), speed, np.inf)
        if limits.joint_rate is not None:
            speed = np.minimum(speed, limits.joint_rate)
        if not np.isfinite(speed).all():
            name = model.arm_joints.names[int(np.argmax(~np.isfinite(speed)))]
            raise ExperimentError(
                f"{name} has no limit of its rate.", advice="State it in the URDF, or give --joint-rate."
            )
        return low, high, limits.usable * speed

    def _wheels(self, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, b = parts[:, 0], parts[:, 1]
        series = Fourier(self.periods / self.duration, a, b, np.zeros(len(a)))
        times = np.linspace(0.0, self.duration, LOOKS)
        peak = np.abs(series.sampled(times)).max(axis=0)
        spin = np.abs(once_integrated(series, times)).max(axis=0) / wheel_inertias(self.model)
        factor = np.full(len(a), np.inf)
        for i, wheel in enumerate(self.model.description.wheel):
            torque = least(wheel.max_torque, self.limits.wheel_torque)
            rate = least(wheel.max_rate, self.limits.wheel_rate)
            if torque is None and rate is None:
                raise ExperimentError(
                    f"{wheel.name} has no limit of torque or rate.",
                    advice="State `max_torque` in the description, or give --wheel-torque.",
                )
            for limit, value in ((torque, peak[i]), (rate, spin[i])):
                if limit is not None:
                    factor[i] = min(factor[i], self.limits.usable * limit / max(value, 1e-12))
        factor *= np.minimum(1.0, np.linalg.norm(parts.reshape(len(a), -1), axis=1))
        return a * factor[:, None], b * factor[:, None]


def _rows(matrix: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(x) for x in row) for row in matrix)
