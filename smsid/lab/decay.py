"""A free decay: frequency and damping with intervals, from a few seconds of one channel.

The signal is a sum of decaying oscillations, a constant and a drift, with white noise: the likelihood is that
of nonlinear least squares, amplitudes and phases projected out (Golub and Pereyra 1973), started from the
matrix pencil (Hua and Sarkar 1990). How many there are is Schwarz's criterion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import hankel, svd
from scipy.optimize import least_squares

from smsid.arm.regression import correlation_lags
from smsid.errors import NotIdentifiableError
from smsid.identify.estimate import Estimate, ParameterEstimate, classify

if TYPE_CHECKING:
    from smsid.lab.modal import AmbientMode

MOST = 4
"""Oscillations tried at once."""

PENCIL = 600
"""Samples that the pencil starts from, at most."""

LEAST = 20
"""Samples a decay must have."""

CYCLES = 1.5
"""Periods that must be seen of an oscillation."""

HEAVIEST = 0.7
"""Largest damping ratio that is called an oscillation."""

CLEAR = 20.0
"""Fall of Schwarz's criterion from which on an oscillation is there at all: e^10 to 1."""


@dataclass(frozen=True)
class DecayMode:
    """``frequency`` [Hz], undamped, and ``damping`` ratio, each with one standard deviation; ``amplitude`` at
    the beginning, in the channel's unit.
    """

    frequency: float
    damping: float
    amplitude: float
    frequency_sigma: float
    damping_sigma: float


@dataclass(frozen=True)
class FreeDecay:
    """Decaying oscillations of a signal, and the standard deviation of its ``noise``."""

    modes: tuple[DecayMode, ...]
    noise: float

    def estimate(self, name: str) -> Estimate:
        """Return it as an estimate, ``mode1.frequency`` and so on."""
        return Estimate("free decay", "free decay", mode_parameters(self.modes), (name,), {}, ())


def mode_parameters(modes: Sequence[DecayMode | AmbientMode]) -> tuple[ParameterEstimate, ...]:
    """Return ``mode1.frequency`` [Hz], ``mode1.damping`` and so on."""
    return tuple(
        classify(f"mode{k}.{f}", getattr(m, f), unit, getattr(m, f"{f}_sigma"), "modes")
        for k, m in enumerate(modes, start=1)
        for f, unit in (("frequency", "Hz"), ("damping", "1"))
    )


def free_decay(signal: np.ndarray, rate: float, *, highest: float | None = None) -> FreeDecay:
    """Fit decaying oscillations to a signal.

    Args:
        signal: (N,) one channel, from when it was let go on.
        rate: samples per second [Hz].
        highest: highest frequency sought [Hz]; half the rate if left out.

    Raises:
        NotIdentifiableError: too short, or nothing oscillates and decays; the reason is said.
    """
    y = np.asarray(signal, dtype=float)
    if y.ndim != 1 or y.size < LEAST or not np.isfinite(y).all():
        raise NotIdentifiableError(
            f"A free decay takes one channel of at least {LEAST} whole samples.", advice="Record longer."
        )
    t = np.arange(y.size) / rate
    top = min(highest or 0.5 * rate, 0.5 * rate)
    scale = float(np.std(y))
    if scale == 0.0:
        raise NotIdentifiableError("The channel is constant: nothing decays.", advice="Take another channel.")
    y = y / scale
    best = _Fit(t, y, np.zeros((0, 2)))
    none, last = best.criterion, best
    for count in range(1, MOST + 1):
        start = _start(y, rate, count, top, t[-1])
        if start is None:
            break
        last = _fit_modes(t, y, start, top)
        if last.criterion < best.criterion:
            best = last
    if not len(best.poles) or best.criterion > none - CLEAR:
        raise NotIdentifiableError(
            "Nothing that oscillates and decays stands out of the noise and the drift.",
            advice=f"Begin when it is let go, record {CYCLES:g} periods or more, or raise --highest.",
        )
    return best.result(scale)


class _Fit:
    """Poles (k, 2) of decay and angular rate [1/s, rad/s], with the linear rest projected out."""

    def __init__(self, t: np.ndarray, y: np.ndarray, poles: np.ndarray) -> None:
        self.t, self.y, self.poles = t, y, poles
        self.linear = np.linalg.lstsq(self.columns(), y, rcond=None)[0]
        self.left = y - self.columns() @ self.linear
        free = y.size - self.linear.size - poles.size
        self.variance = float(self.left @ self.left) / max(free, 1)
        parameters = self.linear.size + poles.size
        square = max(float(np.mean(self.left**2)), 1e-24)
        self.criterion = y.size * np.log(square) + parameters * np.log(y.size)

    def columns(self) -> np.ndarray:
        t = self.t
        parts = [np.ones_like(t), t / t[-1] - 0.5]
        for decay, omega in self.poles:
            parts += [np.exp(-decay * t) * np.cos(omega * t), np.exp(-decay * t) * np.sin(omega * t)]
        return np.column_stack(parts)

    def slopes(self) -> np.ndarray:
        """Derivatives (N, 2 k) by the poles."""
        columns, t = self.columns(), self.t[:, None]
        (cos, sin), (a, b) = ((x[..., 2::2], x[..., 3::2]) for x in (columns, self.linear))
        slopes = np.stack([-t * (a * cos + b * sin), t * (b * cos - a * sin)], axis=2)
        return slopes.reshape(len(slopes), -1)

    def result(self, scale: float) -> FreeDecay:
        columns = self.columns()
        q = np.linalg.qr(columns)[0]
        slopes = self.slopes()
        slopes = slopes - q @ (q.T @ slopes)
        lags = correlation_lags(self.left[:, None])
        covariance = self.variance * max(lags, 1) * np.linalg.pinv(slopes.T @ slopes)
        modes = []
        for k, (decay, omega) in enumerate(self.poles):
            natural = float(np.hypot(decay, omega))
            own = covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
            by_frequency = np.array([decay, omega]) / natural / (2.0 * np.pi)
            by_damping = np.array([omega**2, -decay * omega]) / natural**3
            modes.append(
                DecayMode(
                    natural / (2.0 * np.pi),
                    float(decay) / natural,
                    scale * float(np.hypot(*self.linear[2 + 2 * k : 4 + 2 * k])),
                    float(np.sqrt(by_frequency @ own @ by_frequency)),
                    float(np.sqrt(by_damping @ own @ by_damping)),
                )
            )
        modes.sort(key=lambda m: m.frequency)
        return FreeDecay(tuple(modes), scale * float(np.sqrt(self.variance)))


def _start(y: np.ndarray, rate: float, count: int, top: float, duration: float) -> np.ndarray | None:
    """Return poles (count, 2) of the matrix pencil of greatest energy, or ``None`` where there are none."""
    step = max(1, int(np.ceil(y.size / PENCIL)), int(rate / (6.0 * top)))
    coarse = y[: y.size - y.size % step].reshape(-1, step).mean(axis=1) if step > 1 else y
    coarse = coarse - np.polyval(np.polyfit(np.arange(coarse.size), coarse, 1), np.arange(coarse.size))
    rows = coarse.size // 2
    _, _, vt = svd(hankel(coarse[:rows], coarse[rows - 1 :]), full_matrices=False)
    v = vt[: 2 * count].T
    roots = np.log(np.linalg.eigvals(np.linalg.pinv(v[:-1]) @ v[1:]).astype(complex)) * rate / step
    found = [
        (max(-r.real, 1e-3 / duration), r.imag)
        for r in roots
        if r.imag > 2.0 * np.pi * CYCLES / duration and r.imag < 2.0 * np.pi * top
    ]
    return np.array(found) if found else None


def _fit_modes(t: np.ndarray, y: np.ndarray, start: np.ndarray, top: float) -> _Fit:
    def residual(x: np.ndarray) -> np.ndarray:
        return _Fit(t, y, x.reshape(-1, 2)).left

    omegas = 2.0 * np.pi * np.array([CYCLES / t[-1], top])
    start = np.clip(start, [0.0, omegas[0]], [HEAVIEST * omegas[1], omegas[1]])
    low = np.tile([-0.1 / t[-1], 0.99 * omegas[0]], len(start))
    high = np.tile([HEAVIEST * 1.01 * omegas[1], 1.01 * omegas[1]], len(start))
    found = least_squares(
        residual, start.ravel(), bounds=(low, high), x_scale=np.maximum(np.abs(start.ravel()), 0.1)
    )
    return _Fit(t, y, found.x.reshape(-1, 2))
