"""Desired trajectories: the paper's trapezoid of joint rates, minimum jerk, and shaped versions of either.

Input shapers are impulses whose convolution with a command leaves named modes at rest: Singer and Seering
(1990), ZV and ZVD; Singhose, Seering and Singer (1994), EI: exact for an undamped mode, here with the
damping's decay from impulse to impulse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from smsid.effects.spatial import turns
from smsid.errors import ControlError
from smsid.model.spacecraft import SpacecraftModel

PAPER_ACCELERATION = 0.001
"""a_0 of section V [rad/s^2]."""
PAPER_PHASES = (20.0, 20.0, 20.0, 20.0)
"""Acceleration, coasting, deceleration, rest of section V [s]."""
TRAVEL_SHARE = 0.9
"""Of a joint's room and rate that the motion of a design uses where these limit it."""


class Motion:
    """A desired motion of ``size`` coordinates that rests after ``duration`` [s].

    Those of one's own give `at`, or `sampled` for many times at once.
    """

    size: int
    duration: float

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position, rate and acceleration (size,) at t [s]."""
        x, v, a = self.sampled(np.array([t]))[0]
        return x, v, a

    def sampled(self, times: np.ndarray) -> np.ndarray:
        """Return position, rate and acceleration (N, 3, size) at times (N,) [s], as (46) asks."""
        return np.array([self.at(float(t)) for t in times]).reshape(len(times), 3, self.size)


@dataclass(frozen=True)
class Piecewise(Motion):
    """Polynomials between ``breaks`` (k + 1,) [s]: ``coefficients`` (k, order, size), lowest power first.

    Before the first break and after the last it rests where it was; at a break the later piece counts.
    """

    breaks: tuple[float, ...]
    coefficients: np.ndarray

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.coefficients.shape[2]

    @property
    def duration(self) -> float:
        """When it rests [s]."""
        return self.breaks[-1]

    def sampled(self, times: np.ndarray) -> np.ndarray:
        """Return position, rate and acceleration (N, 3, size) at times (N,) [s], as `at`."""
        inside = (times >= self.breaks[0]) & (times < self.breaks[-1])
        within = np.clip(times, self.breaks[0], self.breaks[-1])
        piece = np.clip(np.searchsorted(self.breaks, within, side="right") - 1, 0, len(self.breaks) - 2)
        s = (within - np.array(self.breaks)[piece])[:, None]
        x, v, a = np.zeros((3, len(times), self.size))
        for power in range(self.coefficients.shape[1] - 1, -1, -1):
            a = a * s + 2.0 * v
            v = v * s + x
            x = x * s + self.coefficients[piece, power]
        return np.stack([x, v * inside[:, None], a * inside[:, None]], axis=1)


def trapezoid(
    start: Sequence[float] | np.ndarray,
    acceleration: float | Sequence[float] | np.ndarray = PAPER_ACCELERATION,
    phases: Sequence[float] = PAPER_PHASES,
) -> Piecewise:
    """Return the paper's trapezoid of joint rates (section V).

    Args:
        start: (size,) position at the beginning [rad].
        acceleration: a_0, one for all coordinates or (size,) [rad/s^2].
        phases: how long it accelerates, coasts, decelerates (as long as it accelerates) and rests [s].

    Raises:
        ControlError: phases that are not four, not positive or do not end at rest, or shapes that do not fit.
    """
    x = np.asarray(start, dtype=float)
    given = np.asarray(acceleration, dtype=float)
    a = np.broadcast_to(given, x.shape) if given.shape in ((), x.shape) else np.full(x.shape, np.nan)
    if x.ndim != 1 or not np.isfinite(x).all() or not np.isfinite(a).all():
        raise ControlError(
            f"An acceleration of shape {np.shape(acceleration)} does not fit a start of shape {x.shape}.",
            advice="Give one finite acceleration, or one per joint.",
        )
    if len(phases) != 4 or min(phases) < 0.0 or phases[0] <= 0.0 or phases[0] != phases[2]:
        raise ControlError(
            f"The phases {tuple(phases)} s do not end at rest.",
            advice="Give four: acceleration, coasting, deceleration as long as the acceleration, rest.",
        )
    t1, t2 = phases[0], phases[1]
    v, zero = a * t1, np.zeros_like(x)
    after1 = x + 0.5 * a * t1**2
    after2 = after1 + v * t2
    after3 = after2 + 0.5 * a * t1**2
    pieces = [
        (t1, x, zero, a / 2),
        (t2, after1, v, zero),
        (t1, after2, v, -a / 2),
        (phases[3], after3, zero, zero),
    ]
    kept = [p for p in pieces if p[0] > 0.0]
    breaks = np.concatenate([[0.0], np.cumsum([p[0] for p in kept])])
    return Piecewise(tuple(breaks.tolist()), np.array([p[1:] for p in kept]))


def minimum_jerk(
    start: Sequence[float] | np.ndarray, stop: Sequence[float] | np.ndarray, duration: float
) -> Piecewise:
    """Return the rest-to-rest motion of least integral of squared jerk, start to stop (size,) [rad].

    10 s^3 - 15 s^4 + 6 s^5 of the way, s = t / duration (Flash and Hogan, 1985). Raises `ControlError` when
    shapes do not fit or the duration [s] is not positive.
    """
    x, y = np.asarray(start, dtype=float), np.asarray(stop, dtype=float)
    if x.shape != y.shape or x.ndim != 1 or not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise ControlError(
            f"A start of shape {x.shape} and a stop of shape {y.shape} do not fit, or are not finite."
        )
    if not 0.0 < duration < np.inf:
        raise ControlError(f"A motion cannot last {duration} s.", advice="Give a positive duration.")
    way, zero = y - x, np.zeros_like(x)
    rows = [x, zero, zero, 10 * way / duration**3, -15 * way / duration**4, 6 * way / duration**5]
    return Piecewise((0.0, float(duration)), np.array([rows]))


@dataclass(frozen=True)
class ShapedMotion(Motion):
    """A motion convolved with the impulses of a shaper: the same way, later by the shaper's length."""

    motion: Motion
    shaper: Shaper

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.motion.size

    @property
    def duration(self) -> float:
        """When it rests [s]."""
        return self.motion.duration + float(self.shaper.times[-1])

    def sampled(self, times: np.ndarray) -> np.ndarray:
        """Return position, rate and acceleration (N, 3, size) at times (N,) [s], as `at`."""
        pairs = zip(self.shaper.amplitudes.tolist(), self.shaper.times.tolist(), strict=True)
        return np.sum([weight * self.motion.sampled(times - later) for weight, later in pairs], axis=0)


@dataclass(frozen=True)
class Reference(Motion):
    """What the controller follows: roll, pitch, yaw of the base and the arm joints, (3 + n,).

    The base rests at ``attitude`` (3,) [rad] unless ``base`` moves it.
    """

    joints: Motion
    attitude: tuple[float, float, float] = (0.0, 0.0, 0.0)
    base: Motion | None = None

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return 3 + self.joints.size

    @property
    def duration(self) -> float:
        """When it rests [s]."""
        return max(self.joints.duration, self.base.duration if self.base else 0.0)

    def sampled(self, times: np.ndarray) -> np.ndarray:
        """Return position, rate and acceleration (N, 3, 3 + n) at times (N,) [s], as `at`."""
        out = np.zeros((len(times), 3, self.size))
        out[:, 0, :3] = self.attitude
        if self.base is not None:
            out[:, :, :3] = self.base.sampled(times)
        out[:, :, 3:] = self.joints.sampled(times)
        return out


def design_motion(model: SpacecraftModel) -> Piecewise:
    """Return the paper's trapezoid from home, gentler and the other way round where joints need it.

    A joint travels at most `TRAVEL_SHARE` of its way to the farther limit, at as much of its largest rate.
    """
    home, limits = model.joint_angles(model.home), model.joint_limits
    rise, coast = PAPER_PHASES[:2]
    acceleration = np.minimum(PAPER_ACCELERATION, TRAVEL_SHARE * limits.rate / rise)
    way, up, down = acceleration * rise * (rise + coast), limits.upper - home, home - limits.lower
    share = np.where(up >= down, 1.0, -1.0) * np.clip(TRAVEL_SHARE * np.maximum(up, down) / way, 0.0, 1.0)
    return trapezoid(home, np.where(way > up, share, 1.0) * acceleration)


def check_joints(motion: Motion, model: SpacecraftModel) -> None:
    """Raise `ControlError` when a motion of the arm joints leaves their limits in angle or rate.

    The message names the joint, the time and the limit.
    """
    joints = model.arm_joints
    if motion.size != len(joints):
        raise ControlError(
            f"The trajectory moves {motion.size} joints, the spacecraft has {len(joints)}: "
            f"{', '.join(joints.names)}.",
            advice="Give one column per arm joint.",
        )
    times = np.linspace(0.0, motion.duration, 2000)
    found = motion.sampled(times)
    angles, rates, limits = found[:, 0], found[:, 1], model.joint_limits
    for k, name in enumerate(joints.names):
        unit = "rad" if turns(model.pin, int(joints.joints[k])) else "m"
        for values, lower, upper, what in (
            (angles[:, k], limits.lower[k], limits.upper[k], unit),
            (np.abs(rates[:, k]), -np.inf, limits.rate[k], f"{unit}/s"),
        ):
            beyond = np.flatnonzero((values < lower - 1e-12) | (values > upper + 1e-12))
            if beyond.size:
                first = beyond[0]
                limit = upper if values[first] > upper else lower
                raise ControlError(
                    f"Joint '{name}' would be at {values[first]:.4g} {what} at t = {times[first]:.4g} s, "
                    f"past its limit of {limit:.4g} {what}.",
                    advice="Shorten the motion, slow it down, or start elsewhere.",
                    joint=name,
                    limits=(float(lower), float(upper)),
                )


Kind = Literal["zv", "zvd", "ei"]


@dataclass(frozen=True)
class Shaper:
    """Impulses ``amplitudes`` (k,), summing to one, at ``times`` (k,) [s], the first at zero."""

    amplitudes: np.ndarray
    times: np.ndarray

    def residual(self, frequency: float | np.ndarray, damping: float = 0.0) -> np.ndarray:
        """Return the vibration left in a mode over that of one impulse, at frequencies [Hz] of any shape."""
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)[..., None]
        decay = damping * omega
        turn = omega * np.sqrt(1.0 - damping**2)
        sums = np.sum(self.amplitudes * np.exp((decay + 1j * turn) * self.times), axis=-1)
        return np.abs(sums) * np.exp(-decay[..., 0] * self.times[-1])


def shaper(
    kind: Kind,
    frequencies: Sequence[float],
    damping: float | Sequence[float] = 0.0,
    *,
    tolerance: float = 0.05,
) -> Shaper:
    """Return the shaper for modes of the given frequencies [Hz] and damping ratios.

    ``zv`` leaves nothing at the frequencies, ``zvd`` nothing and to second order around them, ``ei`` up to
    ``tolerance`` at the frequency, and no more in a wider band around it. Several modes: the shapers
    convolved.

    Raises:
        ControlError: an unknown kind, or frequencies, damping or a tolerance that cannot be.
    """
    f = np.atleast_1d(np.asarray(frequencies, dtype=float))
    if f.size == 0 or not (np.isfinite(f) & (f > 0.0)).all():
        raise ControlError(
            f"A shaper cannot be made for the frequencies {f.tolist()} Hz.", advice="Give positive ones."
        )
    try:
        zeta = np.broadcast_to(np.asarray(damping, dtype=float), f.shape)
    except ValueError as error:
        raise ControlError(f"{np.size(damping)} damping ratios do not fit {f.size} frequencies.") from error
    if not ((zeta >= 0.0) & (zeta < 1.0)).all():
        raise ControlError(
            f"Damping ratios {zeta.tolist()} are not in [0, 1).",
            advice="A mode that does not swing needs no shaper.",
        )
    if not 0.0 < tolerance < 1.0:
        raise ControlError(f"A tolerance of {tolerance} is not between 0 and 1.")
    amplitudes, times = np.ones(1), np.zeros(1)
    for one, ratio in zip(f.tolist(), zeta.tolist(), strict=True):
        a, t = _single(kind, one, ratio, tolerance)
        amplitudes = np.outer(amplitudes, a).ravel()
        times = np.add.outer(times, t).ravel()
    order = np.argsort(times, kind="stable")
    return Shaper(amplitudes[order], times[order])


def _single(kind: str, frequency: float, damping: float, v: float) -> tuple[np.ndarray, np.ndarray]:
    root = np.sqrt(1.0 - damping**2)
    k, half = float(np.exp(-damping * np.pi / root)), 0.5 / (frequency * root)
    weights = {
        "zv": [1.0, k],
        "zvd": [1.0, 2.0 * k, k**2],
        "ei": [(1.0 + v) / 4.0, (1.0 - v) / 2.0 * k, (1.0 + v) / 4.0 * k**2],
    }
    if kind not in weights:
        raise ControlError(f"There is no shaper '{kind}'.", advice=f"Use one of {', '.join(weights)}.")
    amplitudes = np.array(weights[kind])
    return amplitudes / amplitudes.sum(), half * np.arange(len(amplitudes))
