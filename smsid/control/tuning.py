"""Gains that keep clear of the identified natural frequencies, as large as noise and wheels allow.

Each group, attitude and joints, gets K_P = w^2, K_D = 2 w (critically damped, as the paper's K_P = K_D = 4 is
with w = 2 rad/s). Allowed are w outside every mode's band: its frequency over the 95 % intervals, coupled
(base and joints free) and held, widened by `CLEARANCE`. Among those w is best whose error, the steady one
under the disturbance plus three standard deviations of noise, is least; noise may not ask for more than the
actuators have, nor the gains be too fast for the controller's rate. The loop with slosh and panel inside is
examined before the gains are handed out. What the paper asks for in section V: gains that do not excite
natural frequencies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, solve_continuous_lyapunov

from smsid._statistics import NORMAL95
from smsid.control._robust import FlexiblePlant, Pole, named_poles, reduced_mass
from smsid.control._uncertain_plant import UncertainPlant
from smsid.control.gains import Gains, gains
from smsid.errors import ControlError

CLEARANCE = 1.25
"""Factor by which a gain's frequency stays away from a mode's interval, on either side."""
CANDIDATES = np.geomspace(0.05, 20.0, 121)
"""Frequencies of the gains that are tried [rad/s]."""
SPREAD = 3.0
"""Standard deviations of noise that count."""
DRAWS = 200
FASTEST = 0.2
"""Largest frequency of the gains times the period of the controller's calls."""


@dataclass(frozen=True)
class NaturalFrequency:
    """A natural frequency [rad/s] of slosh or panel, 95 % interval; ``held``: base and joints held."""

    name: str
    held: bool
    frequency: float
    low: float
    high: float

    @property
    def band(self) -> tuple[float, float]:
        """Where no gain's frequency may lie [rad/s]."""
        return self.low / CLEARANCE, self.high * CLEARANCE


@dataclass(frozen=True)
class Demands:
    """What the gains have to do, per coordinate (3 + n,), attitude first.

    ``disturbance`` [rad/s^2]; ``angle_noise``, ``rate_noise`` one sigma of what is sampled [rad, rad/s] at
    ``rate`` [Hz]; ``strength`` largest acceleration the actuators can give [rad/s^2], inf for no limit.
    ``fastest`` [rad/s] is the largest frequency of the gains, below where delay and the like take over.
    """

    disturbance: np.ndarray
    angle_noise: np.ndarray
    rate_noise: np.ndarray
    strength: np.ndarray
    rate: float
    fastest: float = np.inf


@dataclass(frozen=True)
class TuningResult:
    """``gains`` at ``attitude`` and ``joints`` [rad/s], the expected ``error`` (3 + n,) [rad], and the modes.

    ``poles`` are those of the loop with slosh and bending inside.
    """

    gains: Gains
    attitude: float
    joints: float
    error: np.ndarray
    modes: tuple[NaturalFrequency, ...]
    poles: tuple[Pole, ...]


def natural_modes(plant: UncertainPlant, rng: np.random.Generator) -> tuple[NaturalFrequency, ...]:
    """Return the natural frequencies of slosh and bending with their intervals.

    From `DRAWS` plants with parameters Gaussian within their intervals; 2.5 to 97.5 %.
    """
    found = []
    drawn = [rng.standard_normal(len(plant.changes)) / NORMAL95 for _ in range(DRAWS)]
    for held in (False, True):
        exact, names = _frequencies(plant, np.zeros(len(plant.changes)), held)
        spread = np.array([_frequencies(plant, d, held)[0] for d in drawn])
        low, high = np.percentile(spread, [2.5, 97.5], axis=0)
        found += [
            NaturalFrequency(n, held, float(f), float(min(a, f)), float(max(b, f)))
            for n, f, a, b in zip(names, exact, low, high, strict=True)
        ]
    return tuple(sorted(found, key=lambda m: m.frequency))


def tuned_gains(
    flexible: FlexiblePlant, inertia: np.ndarray, demands: Demands, modes: tuple[NaturalFrequency, ...]
) -> TuningResult:
    """Return gains that keep clear of the modes.

    ``inertia`` (3 + n, 3 + n) [kg m^2] is the controller's H_hat.

    Raises `ControlError` when no frequency is clear of all bands within what the actuators can do, or when
    the loop with these gains would be unstable or drive a mode.
    """
    size = flexible.actuated
    if len(inertia) != size or np.shape(demands.disturbance) != (size,):
        raise ControlError(f"Demands or inertia do not fit a spacecraft of {size} coordinates.")
    clear = [
        w
        for w in CANDIDATES
        if w <= min(FASTEST * demands.rate, demands.fastest)
        and not any(m.band[0] <= w <= m.band[1] for m in modes)
    ]
    chosen, errors = [], np.zeros(size)
    for group in (np.arange(3), np.arange(3, size)):
        if not len(group):
            chosen.append(np.nan)
            continue
        scored = [(_expected_error(w, demands, group), w) for w in clear]
        possible = [(float(e.max()), w, e) for e, w in scored if e is not None]
        if not possible:
            raise ControlError(
                "No gains keep clear of the natural frequencies within what the actuators can do.",
                advice="Identify the modes better, or take quieter sensors or stronger actuators.",
                bands=[m.band for m in modes],
            )
        _, w, expected = min(possible, key=lambda x: x[0])
        chosen.append(float(w))
        errors[group] = expected
    w = np.concatenate([np.full(3, chosen[0]), np.full(size - 3, chosen[1])])
    found = gains(size, w**2, 2.0 * w)
    poles = named_poles(flexible, inertia, found)
    bad = [p for p in poles if p.flag]
    if bad:
        raise ControlError(
            f"The gains found make {bad[0].name} at {abs(bad[0].value):.4g} rad/s {bad[0].flag}.",
            advice="Identify the mode better, or give gains by hand.",
            poles=poles,
        )
    return TuningResult(found, chosen[0], chosen[1], errors, modes, poles)


def noise_error(frequency: float, angle_noise: float, rate_noise: float, rate: float) -> float:
    """Return one sigma of e [rad] that white measurement noise makes under K_P = w^2, K_D = 2 w.

    dde + K_D de + K_P e = -(K_P n_1 + K_D n_2), the samples' noise held for 1 / ``rate`` [s].
    """
    a = np.array([[0.0, 1.0], [-(frequency**2), -2.0 * frequency]])
    intensity = ((frequency**2 * angle_noise) ** 2 + (2.0 * frequency * rate_noise) ** 2) / rate
    covariance = solve_continuous_lyapunov(a, -np.diag([0.0, intensity]))
    return float(np.sqrt(covariance[0, 0]))


def _expected_error(w: float, demands: Demands, group: np.ndarray) -> np.ndarray | None:
    """Return the expected error (k,) [rad] of a group at w, or nothing where the actuators do not suffice."""
    angle, speed = demands.angle_noise[group], demands.rate_noise[group]
    asked = SPREAD * np.hypot(w**2 * angle, 2.0 * w * speed) + demands.disturbance[group]
    if (asked > demands.strength[group]).any():
        return None
    noise = [noise_error(w, a, b, demands.rate) for a, b in zip(angle, speed, strict=True)]
    return demands.disturbance[group] / w**2 + SPREAD * np.array(noise)


def _frequencies(plant: UncertainPlant, delta: np.ndarray, held: bool) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return undamped natural frequencies of slosh and bending, ascending, and what moves most in each."""
    mass, _, stiffness = plant.at(delta)
    k = plant.actuated
    kept = plant.kept[k:] if held else plant.kept
    # held: the base neither turns nor do joints move, but it is free to translate
    out = np.setdiff1d(np.arange(len(mass)), plant.kept)
    reduced = reduced_mass(mass, kept.tolist(), out.tolist())
    values, vectors = eigh(np.diag(stiffness[kept]), reduced)
    start = 0 if held else k  # as many modes without stiffness as there are free coordinates
    shares = (vectors.T[start:] ** 2 * np.diag(reduced))[:, start:]
    names = [plant.names[k:][best] for best in np.argmax(shares, axis=1)]
    return np.sqrt(np.maximum(values[start:], 0.0)), tuple(names)
