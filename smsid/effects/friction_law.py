"""The laws of friction, each written once: simulation, identification and diagnosis take them from here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

SMOOTHING = 0.005
"""Rate at which the sign of friction turns over, where nothing else is stated [rad/s | m/s]: at it Coulomb
friction reaches 76 %, below it nothing is known of its direction."""
TURNED = 2.0  # widths of the sign at which it has turned, to 96 %

STRIBECK_RATES = (0.02, 0.05, 0.1, 0.2)
"""Rates tried for Stribeck's curve [rad/s | m/s]; it sticks out of Coulomb's below that."""

STRIBECK_SHARES = (0.05, 0.1, 0.2, 0.4)
"""The same as shares of the rms of a joint's rate, for a first hint."""

Law = Literal["direction", "quadratic", "cubic", "stribeck", "load", "position", "temperature"]


@dataclass(frozen=True)
class Sliding:
    """What friction depends on, at one instant or at N: floats or arrays (N,).

    ``rate`` [rad/s | m/s]; ``sign`` of it, smoothed; ``angle`` [rad | m]; ``load``, the torque that drives
    the joint [N m | N]; ``warmer``, the temperature above the reference [K]; ``stribeck``, rate and exponent
    of Stribeck's curve.
    """

    rate: Any
    sign: Any
    angle: Any
    load: Any
    warmer: Any
    stribeck: tuple[float, float]

    @property
    def curve(self) -> Any:
        """Stribeck's curve, which falls from 1 with the rate."""
        rate, exponent = self.stribeck
        return np.exp(-(np.abs(self.rate / rate) ** exponent))


@dataclass(frozen=True)
class FrictionTerm:
    """A torque against the motion, per unit of the parameter ``field``.

    ``law`` it belongs to (empty: always part of friction); ``column`` says it in terms of `Sliding`.
    """

    field: str
    law: str
    column: Callable[[Sliding], Any]


TERMS: tuple[FrictionTerm, ...] = (
    FrictionTerm("viscous", "", lambda s: s.rate),
    FrictionTerm("coulomb", "", lambda s: s.sign),
    FrictionTerm("viscous_direction", "direction", lambda s: s.rate * s.sign),
    FrictionTerm("coulomb_direction", "direction", lambda s: s.sign * s.sign),
    FrictionTerm("quadratic", "quadratic", lambda s: s.rate * np.abs(s.rate)),
    FrictionTerm("cubic", "cubic", lambda s: s.rate**3),
    FrictionTerm("stribeck", "stribeck", lambda s: s.curve * s.sign),
    FrictionTerm("load", "load", lambda s: np.abs(s.load) * s.sign),
    FrictionTerm("position_cos", "position", lambda s: np.cos(s.angle) * s.sign),
    FrictionTerm("position_sin", "position", lambda s: np.sin(s.angle) * s.sign),
    FrictionTerm("viscous_temperature", "temperature", lambda s: s.warmer * s.rate),
    FrictionTerm("coulomb_temperature", "temperature", lambda s: s.warmer * s.sign),
)
"""Every term of friction. Sources: Armstrong-Helouvry, Dupont and Canudas de Wit (1994) for Coulomb, viscous
and Stribeck's; Taghirad and Belanger (1998) for the load; Bittencourt and Gunnarsson (2012) for temperature,
of which this is the linear part."""

LAW_OF_SHAPE: Mapping[str, str] = MappingProxyType(
    {
        "load-dependent": "load",
        "position-dependent": "position",
        "by direction": "direction",
        "quadratic drag": "quadratic",
        "cubic drag": "cubic",
    }
)
"""Laws by the shape that a diagnosis names."""

SIMPLER: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "by direction": ("viscous", "coulomb"),
        "quadratic drag": ("viscous",),
        "cubic drag": ("viscous", "quadratic drag"),
    }
)
"""Shapes of friction that come only where simpler ones, by name, explain clearly less."""

BY_FIELD: Mapping[str, FrictionTerm] = MappingProxyType({t.field: t for t in TERMS})


def fields_of(law: str) -> tuple[str, ...]:
    """Return the parameters of a law."""
    return tuple(t.field for t in TERMS if t.law == law)


def sliding_state(
    effect: Any,
    rate: Any,
    *,
    angle: Any = 0.0,
    load: Any = 0.0,
    temperature: Any = None,
    smoothing: float | None = None,
) -> Sliding:
    """Return what a `JointFriction` depends on, with its own smoothing, Stribeck curve and temperatures.

    Args:
        effect: the friction.
        rate: float or (N,) [rad/s | m/s], like all else.
        angle: [rad | m].
        load: torque that drives the joint [N m | N].
        temperature: [degC]; the effect's own if ``None``.
        smoothing: instead of the effect's.
    """
    own = effect.temperature if temperature is None else temperature
    return Sliding(
        rate,
        np.tanh(rate / (effect.smoothing if smoothing is None else smoothing)),
        angle,
        load,
        own - effect.reference_temperature,
        (effect.stribeck_rate, effect.stribeck_exponent),
    )


def friction_columns(effect: Any, fields: Iterable[str], at: Sliding) -> dict[str, Any]:
    """Return the torque against the motion per unit of each named parameter of a `JointFriction`."""
    return {f: BY_FIELD[f].column(at) for f in fields}


RATE = 1.0
"""Rate up to which laws are compared where a joint states no limit [rad/s | m/s]."""


def closest_friction(effect: Any, limit: float) -> tuple[float, float, str]:
    """Return the dry friction and the damper that come closest to a `JointFriction`, and how close.

    Least squares over all rates up to the joint's ``limit``, both directions alike, with the angle's mean and
    without what depends on the load. The damper comes on top of ``viscous``.
    """
    top = limit if np.isfinite(limit) and 0.0 < limit < 1e3 else RATE
    rates = np.linspace(-top, top, 201)
    angles = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    at = sliding_state(effect, rates[:, None], angle=angles, smoothing=1e-9 * top)
    fields = [t.field for t in TERMS if getattr(effect, t.field) and t.field not in ("viscous", "load")]
    torque = np.zeros((rates.size, angles.size))
    for field, column in friction_columns(effect, fields, at).items():
        torque += getattr(effect, field) * column
    torque = np.mean(torque, axis=1)
    dry, damping = np.linalg.lstsq(np.column_stack([np.sign(rates), rates]), torque, rcond=None)[0]
    if dry < 0.0:
        dry, damping = 0.0, rates @ torque / (rates @ rates)
    error = np.abs(torque - dry * np.sign(rates) - damping * rates).max()
    note = (
        f"dry friction {dry:.4g} and damping {effect.viscous + damping:.4g} come closest up to a rate of "
        f"{top:g}, within {error:.3g}"
    )
    return float(dry), float(damping), note
