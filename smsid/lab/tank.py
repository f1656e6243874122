"""Slosh from a tank that is moved: force and motion of the container in, frequency, damping, mass and lag
out. The equivalent mass on a spring is that of Abramson (1966), NASA SP-106.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.optimize import least_squares

from smsid._short_repr import short_repr
from smsid.arm.regression import correlation_lags
from smsid.errors import NotIdentifiableError, RecordingError
from smsid.identify.estimate import Estimate, classify
from smsid.identify.robust import hac_covariance
from smsid.recording.clock import check_order
from smsid.recording.lag import Lag, estimate_lag
from smsid.recording.resampling import linear
from smsid.sensing.filters import zero_phase

logger = logging.getLogger(__name__)

Model = Literal["rigid", "slosh", "softening spring", "softening inertia"]
NAMES = (
    "rigid_mass",
    "lag",
    "force_offset",
    "force_offset_per_metre",
    "slosh_mass",
    "frequency",
    "damping",
    "softening",
)
UNITS = ("kg", "s", "N", "N/m", "kg", "Hz", "1", "1/m^2")
SCALES = np.array([1.0, 0.01, 0.1, 0.1, 0.1, 0.1, 0.01, 100.0])
SHIFTS = np.array([0.0] * 7 + [1.0])
"""Finite differences are relative: a softening of zero must not be one of the variable."""

COUNTS: dict[str, int] = {"rigid": 4, "slosh": 7, "softening spring": 8, "softening inertia": 8}
AT_REST = 0.02
"""Share of the largest acceleration below which the container counts as at rest."""


@short_repr
@dataclass(frozen=True)
class TankTest:
    """Force and motion along one axis on one clock, both through the same zero-phase low-pass.

    ``time`` (N,) [s], ``force`` (N,) that moves the container [N], ``position`` (N,) of the container [m],
    ``at_rest`` (N,) mask, ``cutoff`` [Hz]; ``lag`` of the force behind the motion by cross-correlation.
    """

    time: np.ndarray
    force: np.ndarray
    position: np.ndarray
    at_rest: np.ndarray
    cutoff: float
    lag: Lag

    @property
    def before(self) -> np.ndarray:
        """Mask (N,) of the samples before the container first moves."""
        return self.time < self.time[~self.at_rest][0]


@short_repr
@dataclass(frozen=True)
class TankFit:
    """A fitted model of the tank.

    ``residual`` (N,) measured minus predicted force [N]; ``ring_down`` and ``moving`` its root mean square
    after the motion and during it [N].
    """

    model: Model
    estimate: Estimate
    values: np.ndarray
    residual: np.ndarray
    ring_down: float
    moving: float
    log_likelihood: float

    def quiet(self, test: TankTest) -> float:
        """Return what is left before the motion, root mean square [N]; not-a-number without such samples."""
        before = test.before
        return float(np.sqrt(np.mean(self.residual[before] ** 2))) if before.any() else float("nan")


LARGEST_LAG = 0.1  # [s] up to which a lag of the force is sought


def tank_test(
    force: tuple[np.ndarray, np.ndarray], motion: tuple[np.ndarray, np.ndarray], *, cutoff: float = 15.0
) -> TankTest:
    """Bring force and motion, each with its own clock, together.

    Args:
        force: times (N,) [s] and force (N,) along the axis of motion, positive where it accelerates the
        tank [N]. motion: times (M,) [s] and position (M,) of the container along that axis [m].
        cutoff: of the zero-phase low-pass that takes arm vibration away [Hz]; well above the third
            harmonic of the slosh, which its softening excites.

    Raises:
        RecordingError: clocks that do not increase, no common span, or force and acceleration are not alike.
    """
    for name, (times, values) in (("force", force), ("motion", motion)):
        check_order(np.asarray(times, dtype=float), name)
        if np.shape(times) != np.shape(values):
            raise RecordingError(f"{name}: times {np.shape(times)} and samples {np.shape(values)} differ.")
    step = 1.0 / (8.0 * cutoff)
    begin, end = max(force[0][0], motion[0][0]), min(force[0][-1], motion[0][-1])
    raw = min(float(np.median(np.diff(t))) for t in (force[0], motion[0]))
    fine = np.arange(begin, end, raw)
    smooth = [
        zero_phase(linear(np.asarray(t), np.asarray(x)[:, None], fine)[:, 0], 1.0 / raw, cutoff)
        for t, x in (force, motion)
    ]
    every = max(1, int(step / raw))
    times, pushed, position = fine[::every], smooth[0][::every], smooth[1][::every]
    acceleration = make_interp_spline(times, position, k=5).derivative(2)(times)
    lag = estimate_lag((times, acceleration), (times, pushed), largest=LARGEST_LAG)
    late = acceleration[np.maximum(np.arange(times.size) - round(lag.value / (times[1] - times[0])), 0)]
    moving = np.maximum(np.abs(acceleration), np.abs(late)) > AT_REST * np.abs(acceleration).max()
    first, last = np.flatnonzero(moving)[[0, -1]]
    at_rest = np.ones(times.size, dtype=bool)
    at_rest[first : last + 1] = False
    return TankTest(times, pushed, position, at_rest, cutoff, lag)


def fit_tank(
    test: TankTest, model: Model = "softening inertia", *, frequency: float | None = None
) -> TankFit:
    """Fit a rigid mass, alone or with a slosh mass m on a spring, which may soften with amplitude.

    ``F = rigid_mass a + m (a + x'') + offset`` with x where the slosh mass is in the tank and a the
    container's acceleration, ``lag`` earlier, and

    - ``slosh``: ``x'' + c x' + w^2 x = -a``;
    - ``softening spring``: ``x'' + c x' + w^2 (x - softening x^3) = -a``;
    - ``softening inertia``: ``(1 + softening x^2) x'' + softening x x'^2 + c x' + w^2 x = -a``. The potential
      energy of a free surface is exactly quadratic in its amplitude; what depends on amplitude is the kinetic
      energy.

    ``c = 2 damping w``. The offset may change with position, as a force sensor's does that tilts. Output
    error, at rest and in motion each weighted by its own residual, the lag within the interval that
    cross-correlation leaves; intervals allow for errors correlated in time. Compare models by
    ``log_likelihood``.

    Args:
        test: of `tank_test`.
        model: what to fit.
        frequency: first guess [Hz]; default the peak of the ring-down's spectrum.

    Raises:
        NotIdentifiableError: the fit does not converge, or there is too little ring-down.

    Source: of the inertial model, Faltinsen and Timokha (2009), *Sloshing*, modal equations with one mode.
    """
    ring = _ring_down(test)
    if frequency is None:
        frequency = _peak_frequency(test.time[ring], test.force[ring])
    if np.ptp(test.time[ring]) < 5.0 / frequency:
        raise NotIdentifiableError(
            f"{np.ptp(test.time[ring]):.3g} s of ring-down are too short.",
            advice="Record five periods or more.",
        )
    if model.startswith("softening"):
        # The likelihood has several hills: one is climbed from the linear fit, one from a softening that
        # shows.
        linear_fit = fit_tank(test, "slosh", frequency=frequency)
        guess = _guess(test, frequency)
        starts = [np.append(linear_fit.values, 1.0), guess, np.append(guess[:-1], 10.0 * guess[-1])]
    else:
        starts = [_guess(test, frequency)]
    fits, failures = [], []
    for start in starts:
        try:
            fits.append(_fit_model(test, model, start[: COUNTS[model]], frequency))
        except NotIdentifiableError as failure:
            failures.append(failure)
            logger.info("%s from %s: %s", model, start, failure)
    if not fits:
        raise failures[0]
    return max(fits, key=lambda fit: fit.log_likelihood)


def _guess(test: TankTest, frequency: float) -> np.ndarray:
    gain = abs(test.lag.gain)
    return np.array([gain, test.lag.value, 0.0, 0.0, 0.1 * gain, frequency, 0.01, 100.0])


def _fit_model(test: TankTest, model: Model, start: np.ndarray, frequency: float) -> TankFit:
    count = COUNTS[model]
    ring = _ring_down(test)
    spline = make_interp_spline(test.time, test.position, k=5).derivative(2)
    x = start / SCALES[:count] + SHIFTS[:count]
    noise = np.array([np.std(test.force[~test.at_rest]) / 10.0, np.std(test.force[ring]) / 3.0])
    weight = np.where(test.at_rest, 1.0 / noise[1], 1.0 / noise[0])

    def errors(scaled: np.ndarray) -> np.ndarray:
        return (
            test.force - _predict_force((scaled - SHIFTS[:count]) * SCALES[:count], test, spline, model)
        ) * weight

    lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
    lower[1], upper[1] = (test.lag.value + np.array([-1.0, 1.0]) / (16.0 * frequency)) / SCALES[1]
    lower[4:7] = 0.0
    for _ in range(3):
        found = least_squares(
            errors, np.clip(x, lower + 1e-9, upper - 1e-9), bounds=(lower, upper), diff_step=1e-4
        )
        if not found.success:
            raise NotIdentifiableError(
                f"The tank's fit failed: {found.message}", advice="Give another frequency."
            )
        x = found.x
        residual = errors(x) / weight
        noise = np.array([np.std(residual[~test.at_rest]), np.std(residual[test.at_rest])])
        weight = np.where(test.at_rest, 1.0 / noise[1], 1.0 / noise[0])
    white = residual * weight
    lags = correlation_lags(white[:, None])
    jacobian = found.jac / SCALES[:count]
    idle = [n for n, c in zip(NAMES, np.linalg.norm(jacobian, axis=0), strict=False) if not c > 0.0]
    if idle:
        raise NotIdentifiableError(
            f"The tank's force does not depend on {', '.join(idle)} where the fit ended.",
            advice="Try a simpler model.",
            parameters=tuple(idle),
        )
    covariance = hac_covariance(jacobian, white, white.size, lags)
    sigma = np.sqrt(np.diag(covariance))
    values = (x - SHIFTS[:count]) * SCALES[:count]
    parameters = tuple(
        classify(f"tank.{n}", v, u, s, "tank")
        for n, v, u, s in zip(NAMES, values, UNITS, sigma, strict=False)
    )
    notes = [f"residuals correlated over {lags} samples"]
    at_bound = (found.x - lower < 1e-3) & np.isfinite(lower) | (upper - found.x < 1e-3) & np.isfinite(upper)
    notes += [
        f"tank.{NAMES[k]} ended at a bound of its search: the model does not fit, the interval says nothing"
        for k in np.flatnonzero(at_bound).tolist()
    ]
    likelihood = -float(np.sum(test.at_rest) * np.log(noise[1]) + np.sum(~test.at_rest) * np.log(noise[0]))
    estimate = Estimate(
        "tank", f"output error, {model}", parameters, notes=tuple(notes), covariance=covariance
    )
    after, during = (float(np.sqrt(np.mean(residual[m] ** 2))) for m in (ring, ~test.at_rest))
    return TankFit(model, estimate, values, residual, after, during, likelihood)


def _peak_frequency(times: np.ndarray, force: np.ndarray) -> float:
    if times.size < 16:
        raise NotIdentifiableError(f"{times.size} samples of ring-down are too few.", advice="Record longer.")
    spectrum = np.abs(np.fft.rfft((force - force.mean()) * np.hanning(force.size), 8 * force.size))
    return float(np.fft.rfftfreq(8 * force.size, times[1] - times[0])[np.argmax(spectrum)])


def _ring_down(test: TankTest) -> np.ndarray:
    return test.at_rest & (test.time > test.time[~test.at_rest][-1])


def cylinder_slosh(
    radius: float, depth: float, density: float = 1000.0, gravity: float = 9.81
) -> tuple[float, float]:
    """Return frequency [Hz] and mass [kg] of the first antisymmetric mode of a liquid in an upright cylinder.

    Source: Abramson (1966), *The dynamic behavior of liquids in moving containers*, NASA SP-106; linear, no
    surface tension. ``radius`` and ``depth`` [m], ``density`` [kg/m^3], ``gravity`` [m/s^2].
    """
    root = 1.8411837813406593  # of J1'
    frequency = np.sqrt(gravity * root / radius * np.tanh(root * depth / radius)) / (2 * np.pi)
    liquid = density * np.pi * radius**2 * depth
    share = 2.0 * radius * np.tanh(root * depth / radius) / (root * depth * (root**2 - 1.0))
    return float(frequency), float(liquid * share)


def _predict_force(values: np.ndarray, test: TankTest, spline: BSpline, model: Model) -> np.ndarray:
    rigid, lag, offset, slope = values[:4]
    step = float(test.time[1] - test.time[0])
    halves = test.time[0] + 0.5 * step * np.arange(2 * test.time.size + 1) - lag
    halves = spline(np.clip(halves, test.time[0], test.time[-1]))
    a = halves[:-1:2]
    out = rigid * a + offset + slope * (test.position - test.position[0])
    if model == "rigid":
        return out
    mass, frequency, damping = values[4:7]
    softening = float(values[7]) if values.size > 7 else 0.0
    kinetic, cubic = (softening, 0.0) if model == "softening inertia" else (0.0, softening)
    return out + mass * _absolute(halves, step, 2 * np.pi * float(frequency), float(damping), kinetic, cubic)


def _absolute(a: np.ndarray, h: float, w: float, damping: float, kinetic: float, cubic: float) -> np.ndarray:
    """Absolute acceleration (N,) of a slosh mass from rest [m/s^2], by Runge-Kutta; a (2 N + 1,) every h /
    2 [s].
    """
    c, w2 = 2.0 * damping * w, w * w

    def slope(x: float, v: float, u: float) -> float:
        return -(u + c * v + x * (w2 * (1.0 - cubic * x * x) + kinetic * v * v)) / (1.0 + kinetic * x * x)

    x = v = 0.0
    out = np.empty(a.size // 2)
    inputs = a.tolist()
    for k in range(out.size):
        now, middle, after = inputs[2 * k : 2 * k + 3]
        k1 = slope(x, v, now)
        out[k] = now + k1
        v2 = v + 0.5 * h * k1
        k2 = slope(x + 0.5 * h * v, v2, middle)
        v3 = v + 0.5 * h * k2
        k3 = slope(x + 0.5 * h * v2, v3, middle)
        v4 = v + h * k3
        k4 = slope(x + h * v3, v4, after)
        x, v = x + h * (v + 2 * v2 + 2 * v3 + v4) / 6.0, v + h * (k1 + 2 * k2 + 2 * k3 + k4) / 6.0
        if not abs(x) < 1e3:  # a softening spring lets go: no solution there
            out[k:] = 1e6
            break
    return out
