"""Drives of the reference recordings: the thrust profile (48), Fourier torques read off the recording."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .mujoco_twin import Drive, Signal, quiet
from .state import Array, State

Q0_ARM = np.array([0.4, -0.6, 0.9])  # arm at t = 0 in every recording [rad]


def thrust(axes: Array, duration: float = 120.0, size: float = 40.0) -> Signal:
    """(48): +size, then -size, then 0 [N] along `axes` (3,), switching at 1/6 and 1/3 of `duration` [s]."""

    def force(t: float) -> Array:
        if t < duration / 6:
            return size * axes
        return -size * axes if t < duration / 3 else np.zeros(3)

    return force


def fourier(t: Array, values: Array, base: float = 1 / 40, harmonics: int = 5) -> tuple[Signal, float]:
    """Fit a truncated Fourier series to values (N, 3) at t (N,) [s]; base frequency [Hz].

    Returns the series and the largest residual relative to the largest value [1].
    """
    order = 2 * np.pi * base * np.arange(1, harmonics + 1)

    def columns(at: Array | float) -> Array:
        angle = np.multiply.outer(at, order)
        return np.concatenate([np.ones((*np.shape(at), 1)), np.cos(angle), np.sin(angle)], axis=-1)

    coefficients = np.linalg.lstsq(columns(t), values, rcond=None)[0]
    residual = np.abs(columns(t) @ coefficients - values).max() / np.abs(values).max()
    return lambda at: columns(at) @ coefficients, float(residual)


def exp1(axes: tuple[int, int, int]) -> tuple[Drive, State]:
    """Drive and initial state of Exp. 1, thrust along `axes`; to be simulated with `hold=True` for 120 s."""
    return Drive(force_body=thrust(np.array(axes, dtype=float))), State(q=Q0_ARM.copy())


def exp2(recording: Mapping[str, Array]) -> tuple[Drive, State, float]:
    """Drive, initial state and fit residual [1] of Exp. 2 from the recorded `t`, `tau_rw`, `tau_arm`."""
    t = np.asarray(recording["t"], dtype=float)
    wheels, residual_wheels = fourier(t, np.asarray(recording["tau_rw"], dtype=float))
    arm, residual_arm = fourier(t, np.asarray(recording["tau_arm"], dtype=float))
    drive = Drive(force_body=quiet, wheel_torque=wheels, joint_torque=arm)
    return drive, State(q=Q0_ARM.copy()), max(residual_wheels, residual_arm)
