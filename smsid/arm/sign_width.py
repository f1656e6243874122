"""How sharply friction changes its sign: a width of the rate, found from the torques.

Friction ``F tanh(v / w)`` has the width w. What a description states is kept; what it leaves open is found
here with its uncertainty, which the intervals of friction then include.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from smsid.arm.columns import joint_index
from smsid.arm.joint_torques import SIGN_FIELD, JointTorques, block_means, rate_spread, sign_rate
from smsid.arm.regression import correlation_lags
from smsid.arm.smooth_motion import SmoothMotion
from smsid.description import Description
from smsid.effects import Effect
from smsid.model.spacecraft import SpacecraftModel

SHARPEST = 1e-4
"""Least width tried, as a share of the largest rate."""

WIDEST = 0.5
"""Largest width tried, as a share of the rate's rms: beyond, friction is viscous."""

USUAL = 0.01
"""Width expected before the torques are looked at, as a share of the rate's rms, within a factor `WITHIN`."""

WITHIN = 4.0

TOLD = 6.6
"""Fall of chi-squared from which on friction, or its width, is told (1 % of chance)."""

STEPS = 13
DIFFERENCE = 0.05


@dataclass(frozen=True)
class SignWidth:
    """Width of the sign of an effect's friction: ``value`` [rad/s | m/s].

    ``status``: ``found``, ``stated`` by the description, or ``unseen`` (no friction to tell it from).
    ``size`` is the friction it was found with, ``sigma`` the standard deviation of its logarithm.
    """

    effect: str
    value: float
    status: str
    size: float = 0.0
    sigma: float = 0.0


def sign_widths(model: SpacecraftModel, motion: SmoothMotion, torques: JointTorques) -> tuple[SignWidth, ...]:
    """Return the width of every effect with friction that changes sign.

    Each is found from the equations of its own joints, all else that acts on them free.
    """
    found = []
    for effect in model.description.effect:
        if not hasattr(effect, SIGN_FIELD):
            continue
        own = float(getattr(effect, SIGN_FIELD))
        if own != type(effect).model_fields[SIGN_FIELD].default:
            found.append(SignWidth(effect.name, own, "stated"))
        else:
            found.append(_found(effect, model, motion, torques, own))
    return tuple(found)


def sign_column(
    effect: Effect, width: float, model: SpacecraftModel, motion: SmoothMotion, starts: np.ndarray
) -> np.ndarray:
    """Return the mean sign (B,) of an effect's rate over blocks, see `with_width`."""
    spread = rate_spread(effect, model, motion)
    wide = float(np.sqrt(width**2 + 0.5 * np.pi * spread**2))
    return block_means(np.tanh(sign_rate(effect, model, motion.v) / wide), starts)


def width_columns(
    widths: Sequence[SignWidth], model: SpacecraftModel, motion: SmoothMotion, torques: JointTorques
) -> np.ndarray:
    """Return torques (B, nv, k) per unit of the logarithm of every width that was found."""
    effects = {e.name: e for e in model.description.effect}
    out = []
    for w in widths:
        if w.status != "found":
            continue
        effect = effects[w.effect]
        above, below = (
            sign_column(effect, w.value * np.exp(d), model, motion, torques.starts)
            for d in (DIFFERENCE, -DIFFERENCE)
        )
        slope = w.size * (above - below) / (2.0 * DIFFERENCE)
        column = np.zeros(torques.torque.shape)
        for k, weight in _acts_on(effect, model):
            column[:, k] = weight * slope
        out.append(column)
    return np.stack(out, axis=2) if out else np.zeros((*torques.torque.shape, 0))


def width_bounds(effect: Effect, model: SpacecraftModel, motion: SmoothMotion) -> tuple[float, float]:
    """Return the least and the largest width of an effect's sign that a motion could tell."""
    rate = sign_rate(effect, model, motion.v)
    least = max(SHARPEST * float(np.abs(rate).max()), rate_spread(effect, model, motion))
    return least, WIDEST * float(np.sqrt(np.mean(rate**2)))


def usual_width(effect: Effect, model: SpacecraftModel, motion: SmoothMotion) -> float:
    """Return the width that is expected of an effect's sign before torques are looked at."""
    low, high = width_bounds(effect, model, motion)
    usual = USUAL * float(np.sqrt(np.mean(sign_rate(effect, model, motion.v) ** 2)))
    return float(np.clip(usual, low, high))


def with_sign_widths(
    torques: JointTorques, widths: Sequence[SignWidth], model: SpacecraftModel, motion: SmoothMotion
) -> JointTorques:
    """Return the equations with the columns of friction's signs made with these widths."""
    effects = {e.name: e for e in model.description.effect}
    rows = np.array(torques.rows)
    for w in widths:
        effect, place = effects[w.effect], torques.names.index(f"{w.effect}.coulomb")
        column = sign_column(effect, w.value, model, motion, torques.starts)
        for k, weight in _acts_on(effect, model):
            rows[:, k, place] = weight * column
    return replace(torques, rows=rows)


def with_widths(description: Description, widths: Sequence[SignWidth]) -> Description:
    """Return the description whose effects have the widths that were found."""
    found = {w.effect: w.value for w in widths if w.status == "found"}
    effects = [
        e.model_copy(update={SIGN_FIELD: found[e.name]}) if e.name in found else e for e in description.effect
    ]
    return description.with_effects(*effects)


def width_notes(widths: Sequence[SignWidth]) -> list[str]:
    """Return sentences on how sharply friction changes its sign."""
    found = [
        f"{w.effect} {w.value:.3g} (times or divided by {np.exp(min(1.96 * w.sigma, 7.0)):.3g})"
        for w in widths
        if w.status == "found"
    ]
    stated = [f"{w.effect} {w.value:.3g}" for w in widths if w.status == "stated"]
    notes = []
    if found:
        notes.append("rates at which friction changes its sign, found: " + ", ".join(found))
    if stated:
        notes.append("rates at which friction changes its sign, as described: " + ", ".join(stated))
    return notes


def _acts_on(effect: Effect, model: SpacecraftModel) -> list[tuple[int, float]]:
    joints = getattr(effect, "joints", None) or (str(getattr(effect, "joint", "")),)
    weights = getattr(effect, "weights", (1.0,))
    return [(joint_index(model, effect, n), float(w)) for n, w in zip(joints, weights, strict=True)]


def _found(
    effect: Effect, model: SpacecraftModel, motion: SmoothMotion, torques: JointTorques, default: float
) -> SignWidth:
    least, most = width_bounds(effect, model, motion)
    if not most > 2.0 * least:
        return SignWidth(effect.name, default, "unseen")
    parts = [_Equation(torques, k, weight, f"{effect.name}.coulomb") for k, weight in _acts_on(effect, model)]

    centre = float(np.log(usual_width(effect, model, motion)))
    first = sign_column(effect, float(np.exp(centre)), model, motion, torques.starts)
    if sum(p.gain(first) for p in parts) < TOLD:
        return SignWidth(effect.name, default, "unseen")
    lags = max(correlation_lags(p.after(first)[:, None]) for p in parts)  # errors alike count once

    def gain(log_width: float) -> float:
        column = sign_column(effect, float(np.exp(log_width)), model, motion, torques.starts)
        return (
            sum(p.gain(column) for p in parts) / max(lags, 1) - ((log_width - centre) / np.log(WITHIN)) ** 2
        )

    grid = np.linspace(np.log(least), np.log(most), STEPS)
    values = [gain(x) for x in grid]
    k = int(np.argmax(values))
    around = (grid[max(k - 1, 0)], grid[min(k + 1, STEPS - 1)])
    best = minimize_scalar(lambda x: -gain(x), bounds=around, method="bounded", options={"xatol": 1e-3})
    value = float(np.exp(best.x))
    column = sign_column(effect, value, model, motion, torques.starts)
    size = float(np.mean([p.size(column) for p in parts]))
    return SignWidth(effect.name, value, "found", size)


class _Equation:
    """The torque of one joint with all columns that act on it but one projected out, in units of its
    noise."""

    def __init__(self, torques: JointTorques, joint: int, weight: float, without: str) -> None:
        rows = torques.rows[:, joint]
        used = np.any(rows != 0.0, axis=0)
        used[[i for i, n in enumerate(torques.names) if n == without]] = False
        u, singular, _ = np.linalg.svd(
            rows[:, used] / np.maximum(np.linalg.norm(rows[:, used], axis=0), 1e-300), full_matrices=False
        )
        self.basis = u[:, singular > 1e-9 * singular.max(initial=1e-300)]
        self.left = torques.torque[:, joint] - self.basis @ (self.basis.T @ torques.torque[:, joint])
        self.freedom = max(len(self.left) - self.basis.shape[1] - 1, 1)
        self.weight = weight

    def gain(self, column: np.ndarray) -> float:
        """Return the fall of chi-squared that a column brings, by the noise left with it."""
        beyond = self._beyond(column)
        square = float(beyond @ beyond)
        if not square > 1e-10 * float(column @ column):
            return 0.0
        explained = float(beyond @ self.left) ** 2 / square
        total = float(self.left @ self.left)
        left = max(total - explained, 1e-12 * total) + 1e-300
        return self.freedom * float(np.log(max(total, 1e-300) / left))

    def size(self, column: np.ndarray) -> float:
        """Return the friction that fits best."""
        beyond = self._beyond(column)
        return float(beyond @ self.left) / max(float(beyond @ beyond), 1e-300) / self.weight

    def after(self, column: np.ndarray) -> np.ndarray:
        """Return what the column leaves (B,)."""
        beyond = self._beyond(column)
        return self.left - beyond * float(beyond @ self.left) / max(float(beyond @ beyond), 1e-300)

    def _beyond(self, column: np.ndarray) -> np.ndarray:
        return column - self.basis @ (self.basis.T @ column)
