"""A rigid satellite by Euler's equations: profiles of torque, wheels that saturate, a gyro, the bound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

INERTIA = np.array([[6.53, 0.45, -0.30], [0.45, 5.96, 0.22], [-0.30, 0.22, 4.53]])  # [kg m^2]
ELEMENTS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
SECONDS, RATE = 60.0, 10.0
GYRO = 1e-4  # [rad/s]
LIMITS = 0.5, 0.5  # of a wheel [N m], [N m s]
DISTURBANCE = np.array([0.008, -0.005, 0.006])  # [N m]
TIMES = np.arange(round(SECONDS * RATE) + 1) / RATE
FINE = 4  # steps of the integration a sample
PHASES = np.array([0.0, 2.1, 4.2])


def profiles() -> dict[str, np.ndarray]:
    """Return torques (601, 3) at the samples, integral of their squares 1 N^2 m^2 s."""
    t, rng = TIMES[:, None], np.random.default_rng(0)
    turn = 2 * np.pi * t
    shapes = {"constant": np.tile([1.0, 0.3, -0.2], (len(TIMES), 1))}
    shapes["sine about x 0.02 Hz"] = np.sin(0.02 * turn) * [1.0, 0.0, 0.0]
    shapes["sines alike 0.02 Hz"] = np.sin(0.02 * turn) * np.ones(3)
    for f in (0.005, 0.02, 0.08, 0.2):
        shapes[f"sines in three phases {f:g} Hz"] = np.sin(f * turn + PHASES)
    ones = np.ones(3)
    shapes["three tones"] = np.sin(turn * np.array([0.01, 0.035, 0.07]) + np.arange(3.0)) * ones
    begin, grown = np.array([0.005, 0.01, 0.02]), np.array([0.05, 0.06, 0.08]) / SECONDS
    shapes["chirps"] = np.sin(2 * np.pi * (begin * t + 0.5 * grown * t**2) + np.arange(3.0))
    held = (TIMES / 4.0).astype(int)
    shapes["binary held 4 s"] = rng.choice([-1.0, 1.0], (held[-1] + 1, 3))[held]
    shapes["Gaussian held 4 s"] = rng.normal(size=(held[-1] + 1, 3))[held]
    return {n: scaled(x) for n, x in shapes.items()}


def scaled(torque: np.ndarray) -> np.ndarray:
    """Return a torque (601, 3) with the energy that all profiles have."""
    return torque / np.sqrt(np.trapezoid(np.sum(torque**2, axis=1), TIMES))


@dataclass(frozen=True)
class Motion:
    """Rates (601, 3), momenta of the wheels about the body's axes (601, 3), share of time saturated."""

    rate: np.ndarray
    wheels: np.ndarray
    saturated: float


def move(
    torque: np.ndarray,
    inertia: np.ndarray = INERTIA,
    *,
    wheels: bool = False,
    external: np.ndarray | None = None,
    start: np.ndarray | None = None,
    growth: np.ndarray | None = None,
) -> Motion:
    """Integrate Euler's equations (RK4, 40 Hz), torque (601, 3) on the body linear between samples.

    With ``wheels`` the torque is theirs: within `LIMITS`, and nothing beyond the momentum they can hold.
    ``inertia`` is that of all with wheels locked, their momentum that of their rates against the body.
    ``inertia`` (..., 3, 3), ``external`` [N m] and ``start`` [rad/s] (..., 3) may be many. ``growth`` (3, 3)
    [kg m^2/s] is how the inertia changes, by what takes its momentum along: no torque comes of it.
    """
    most, full = LIMITS
    step = 1.0 / (RATE * FINE)
    momenta, given, saturated = _given(torque, wheels, step, most, full)
    outside = np.zeros(3) if external is None else np.asarray(external)
    begin = np.zeros(3) if start is None else np.asarray(start)
    shape = np.broadcast_shapes(inertia.shape[:-2], outside.shape[:-1], begin.shape[:-1])
    now, inverse = inertia, np.linalg.inv(inertia)
    w = np.broadcast_to(begin, (*shape, 3))
    rates = [w]
    for k in range(len(given)):
        if growth is not None:  # in the middle of the step
            now = inertia + growth * (k + 0.5) * step
            inverse = np.linalg.inv(now)
        w = turned(w, momenta[k], momenta[k + 1], given[k], step, now, inverse, outside)
        if k % FINE == FINE - 1:
            rates.append(w)
    return Motion(np.stack(rates, axis=-2), momenta[::FINE], saturated)


AHEAD, BEHIND = [1, 2, 0], [2, 0, 1]


def turned(
    w: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
    torque: np.ndarray,
    step: float,
    inertia: np.ndarray,
    inverse: np.ndarray,
    external: np.ndarray,
) -> np.ndarray:
    """Return the rates (..., 3) a step [s] later: wheels' momenta go straight from one to the other (..., 3).

    ``torque`` (3, ..., 3) is theirs on the body at begin, middle and end; ``inverse`` is that of the inertia.
    """

    def derivative(w: np.ndarray, h: np.ndarray, u: np.ndarray) -> np.ndarray:
        angular = (inertia @ w[..., None])[..., 0] + h
        cross = (w[..., AHEAD] * angular[..., BEHIND]) - (w[..., BEHIND] * angular[..., AHEAD])
        return (inverse @ (u + external - cross)[..., None])[..., 0]

    between = 0.5 * (before + after)
    k1 = derivative(w, before, torque[0])
    k2 = derivative(w + step / 2 * k1, between, torque[1])
    k3 = derivative(w + step / 2 * k2, between, torque[1])
    k4 = derivative(w + step * k3, after, torque[2])
    return w + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _given(
    torque: np.ndarray, wheels: bool, step: float, most: float, full: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return momenta of the wheels at the ends of the steps, torques on the body (steps, 3, 3) at begin,
    middle and end of each, and the share of time in which a wheel is at a limit.
    """
    fine = np.arange(FINE * (len(TIMES) - 1))[:, None] + np.array([0.0, 0.5, 1.0])
    at = np.stack([np.interp(fine / FINE, np.arange(len(TIMES)), torque[:, i]) for i in range(3)], axis=-1)
    momenta = np.zeros((len(fine) + 1, 3))
    if not wheels:
        return momenta, at, 0.0
    # held over a step: what the wheels take is then what the body gets, to rounding
    wanted = np.clip(-at[:, 1], -most, most)
    for k, u in enumerate(wanted):
        momenta[k + 1] = np.clip(momenta[k] + step * u, -full, full)
    hdot = np.diff(momenta, axis=0) / step
    saturated = float(np.mean(np.any(np.abs(hdot - wanted) > 1e-9, axis=1)))
    return momenta, np.repeat(-hdot[:, None], 3, axis=1), saturated


def with_elements(values: np.ndarray) -> np.ndarray:
    """Return the inertia (3, 3) of its six elements, in the order of `ELEMENTS`."""
    out = np.zeros((3, 3))
    for (i, k), v in zip(ELEMENTS, values, strict=True):
        out[i, k] = out[k, i] = v
    return out


def elements(inertia: np.ndarray) -> np.ndarray:
    """Return the six elements of an inertia, in the order of `ELEMENTS`."""
    return np.array([inertia[i, k] for i, k in ELEMENTS])


def covariance_bound(
    moved: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray], *, disturbed: bool
) -> np.ndarray:
    """Return the Cramer-Rao bound (6, 6) of the elements, start and disturbance (where any) unknown.

    ``moved(inertia, start, external)`` gives the rates (n, 601, 3) of n of each. Singular directions have an
    infinite bound: values beyond 1e6 say so.
    """
    size = 6 + 3 + 3 * disturbed

    here = np.concatenate([elements(INERTIA), np.zeros(3), DISTURBANCE if disturbed else []])
    step = np.array([1e-4] * 6 + [1e-6] * (size - 6))
    x = here + np.concatenate([np.diag(step), -np.diag(step)])
    external = x[:, 9:12] if disturbed else np.zeros((2 * size, 3))
    found = moved(np.array([with_elements(e) for e in x[:, :6]]), x[:, 6:9], external)
    change = (found[:size] - found[size:]).reshape(size, -1)
    whitened = (change / (2.0 * step[:, None]) / GYRO).T
    information = whitened.T @ whitened
    scale = np.sqrt(np.maximum(np.diag(information), 1e-30))
    values, basis = np.linalg.eigh(information / np.outer(scale, scale))
    inverse = (basis / np.maximum(values, 1e-14)) @ basis.T / np.outer(scale, scale)
    return inverse[:6, :6]
