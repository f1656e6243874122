"""What friction is not linear in, found from the torques: how sharply it changes sign, Stribeck's rate.

Friction ``F tanh(v / w)`` has the width w. What a description states is kept; what it leaves open is found
here with its uncertainty, which the intervals of friction then include.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.arm._smooth_motion import SmoothMotion
from smsid.arm.columns import JointStates, effect_columns
from smsid.arm.joint_torques import (
    SIGN_FIELD,
    JointTorques,
    Shapes,
    acts_on,
    block_means,
    joint_states,
    rate_spread,
    sign_rate,
    with_shapes,
)
from smsid.arm.regression import Projection, correlation_lags
from smsid.description import Description
from smsid.effects import Effect
from smsid.model.spacecraft import SpacecraftModel

SHARPEST = 1e-4
"""Least width tried, as a share of the largest rate."""

WIDEST = 0.5
"""Largest width tried, as a share of the rate's rms: beyond, friction is viscous."""

USUAL = {SIGN_FIELD: 0.01, "stribeck_rate": 0.1}
"""Expected before the torques are looked at, as a share of the rate's rms, within a factor `WITHIN`."""

WITHIN = 4.0

STEPS = {SIGN_FIELD: 13, "stribeck_rate": 7}
DIFFERENCE = 0.05
SENTENCES = {
    SIGN_FIELD: "rates at which friction changes its sign",
    "stribeck_rate": "rates at which Stribeck's friction has fallen to 37 %",
}


@dataclass(frozen=True)
class FrictionShape:
    """A parameter of an effect's friction that torques are not linear in: ``value`` [rad/s | m/s].

    ``field`` is ``smoothing`` or ``stribeck_rate``. ``status``: ``found``, ``stated`` by the description, or
    ``unseen`` (no torque that is used depends on it). ``sigma`` is the standard deviation of its logarithm.
    """

    effect: str
    field: str
    value: float
    status: str
    sigma: float = 0.0


def friction_shapes(
    model: SpacecraftModel, motion: SmoothMotion, torques: JointTorques, load: np.ndarray
) -> tuple[FrictionShape, ...]:
    """Return what every effect's friction is not linear in.

    Each is found from the equations of its own joints, all else that acts on them free. ``load`` (B, nv) are
    the torques that drive the joints.
    """
    out: list[FrictionShape] = []
    for effect in model.description.effect:
        own = effect.torque_shapes()
        stated = [f for f in own if getattr(effect, f) != type(effect).model_fields[f].default]
        out += [FrictionShape(effect.name, f, float(getattr(effect, f)), "stated") for f in stated]
        if free := [f for f in own if f not in stated]:
            found = _likeliest(effect, free, model, motion, torques, load)
            status = "unseen" if found is None else "found"
            values = found or {f: float(getattr(effect, f)) for f in free}
            out += [FrictionShape(effect.name, f, values[f], status) for f in free]
    return tuple(out)


def shape_values(shapes: Sequence[FrictionShape]) -> Shapes:
    """Return the values by effect and field."""
    out: dict[str, dict[str, float]] = {}
    for s in shapes:
        out.setdefault(s.effect, {})[s.field] = s.value
    return out


def shaped_columns(
    effect: Effect,
    shapes: Mapping[str, float],
    model: SpacecraftModel,
    motion: SmoothMotion,
    torques: JointTorques,
    states: JointStates,
) -> dict[str, np.ndarray]:
    """Return the mean columns (B, joints of the effect) of an effect over blocks, by parameter; ``states``
    are `joint_states` of the motion.
    """
    own = [k for k, _ in acts_on(effect, model)]
    found = effect_columns(with_shapes(effect, shapes, model, motion), model, states)
    used = 1.0 if torques.used is None else torques.used[:, own]
    return {c.name: used * block_means(c.values[:, own], torques.starts) for c in found}


def with_shape_columns(
    torques: JointTorques,
    shapes: Sequence[FrictionShape],
    model: SpacecraftModel,
    motion: SmoothMotion,
    load: np.ndarray,
) -> tuple[JointTorques, dict[tuple[str, str], dict[str, np.ndarray]]]:
    """Return the equations with the columns of friction of these shapes, and the slopes of the columns.

    Slopes (B, joints of the effect) are by effect and field that were found, per unit of the logarithm, as
    `shaped_columns`; ``load`` is (B, nv) [N m | N].
    """
    values = shape_values(shapes)
    rows, states = np.array(torques.rows), joint_states(motion, torques.starts, load)
    slopes: dict[tuple[str, str], dict[str, np.ndarray]] = {}
    for effect in model.description.effect:
        own = values.get(effect.name)
        if own is None:
            continue
        index = [k for k, _ in acts_on(effect, model)]
        for name, column in shaped_columns(effect, own, model, motion, torques, states).items():
            rows[:, index, torques.names.index(name)] = column
        for s in shapes:
            if s.effect == effect.name and s.status == "found":
                above, below = (
                    shaped_columns(
                        effect, {**own, s.field: s.value * np.exp(d)}, model, motion, torques, states
                    )
                    for d in (DIFFERENCE, -DIFFERENCE)
                )
                slopes[s.effect, s.field] = {n: (above[n] - below[n]) / (2.0 * DIFFERENCE) for n in above}
    return replace(torques, rows=rows), slopes


def shape_bounds(
    effect: Effect, field: str, model: SpacecraftModel, motion: SmoothMotion
) -> tuple[float, float]:
    """Return the least and the largest value of a shape that a motion could tell."""
    rate = sign_rate(effect, model, motion.v)
    least = max(SHARPEST * float(np.abs(rate).max()), rate_spread(effect, model, motion))
    return least, WIDEST * float(np.sqrt(np.mean(rate**2)))


def usual_shape(effect: Effect, field: str, model: SpacecraftModel, motion: SmoothMotion) -> float:
    """Return the prior mean of a shape: a usual share of the rate's root mean square."""
    low, high = shape_bounds(effect, field, model, motion)
    usual = USUAL[field] * float(np.sqrt(np.mean(sign_rate(effect, model, motion.v) ** 2)))
    return float(np.clip(usual, low, high))


def with_found_shapes(description: Description, shapes: Sequence[FrictionShape]) -> Description:
    """Return the description whose effects have the shapes that were found."""
    found = shape_values([s for s in shapes if s.status == "found"])
    effects = [e.model_copy(update=found[e.name]) if e.name in found else e for e in description.effect]
    return description.with_effects(*effects)


def shape_notes(shapes: Sequence[FrictionShape]) -> list[str]:
    """Return sentences on how sharply friction changes its sign, and on Stribeck's rates."""
    notes = []
    for field, what in SENTENCES.items():
        own = [s for s in shapes if s.field == field]
        found = [
            f"{s.effect} {s.value:.3g} (times or divided by {np.exp(min(1.96 * s.sigma, 7.0)):.3g})"
            for s in own
            if s.status == "found"
        ]
        stated = [f"{s.effect} {s.value:.3g}" for s in own if s.status == "stated"]
        if found:
            notes.append(f"{what}, found: " + ", ".join(found))
        if stated:
            notes.append(f"{what}, as described: " + ", ".join(stated))
    return notes


def _likeliest(
    effect: Effect,
    free: Sequence[str],
    model: SpacecraftModel,
    motion: SmoothMotion,
    torques: JointTorques,
    load: np.ndarray,
) -> dict[str, float] | None:
    """Return the likeliest shapes of an effect's friction on a grid, where Gauss-Newton's rounds begin."""
    bounds = [shape_bounds(effect, f, model, motion) for f in free]
    if any(not high > 2.0 * low for low, high in bounds):
        return None
    states = joint_states(motion, torques.starts, load)

    def columns(logs: np.ndarray) -> dict[str, np.ndarray]:
        shapes = dict(zip(free, np.exp(logs).tolist(), strict=True))
        return shaped_columns(effect, shapes, model, motion, torques, states)

    centre = np.log([usual_shape(effect, f, model, motion) for f in free])
    first, other = columns(centre), columns(centre + 0.5)
    shaped = [n for n in first if not np.allclose(first[n], other[n], rtol=1e-9, atol=0.0)]
    if not shaped:  # of joints whose torques are not used
        return None
    parts = [_Equation(torques, k, shaped) for k, _ in acts_on(effect, model)]

    def parted(logs: np.ndarray) -> list[tuple[_Equation, np.ndarray]]:
        made = columns(logs)
        return [(p, np.column_stack([made[n][:, i] for n in shaped])) for i, p in enumerate(parts)]

    grids = [
        np.linspace(np.log(own[0]), np.log(own[1]), STEPS[f]) for f, own in zip(free, bounds, strict=True)
    ]
    points = np.array(list(itertools.product(*grids)))
    falls = np.array([sum(p.gain(c) for p, c in parted(x)) for x in points])
    lags = max(correlation_lags(p.after(c)[:, None]) for p, c in parted(points[falls.argmax()]))
    far = np.sum(((points - centre) / np.log(WITHIN)) ** 2, axis=1)
    best = points[np.argmax(falls / max(lags, 1) - far)]  # errors alike count once
    return dict(zip(free, np.exp(best).tolist(), strict=True))


class _Equation:
    """The torque of one joint with all columns that act on it but some projected out, in units of its
    noise."""

    def __init__(self, torques: JointTorques, joint: int, without: Sequence[str]) -> None:
        rows = torques.rows[:, joint]
        used = np.any(rows != 0.0, axis=0)
        used[[i for i, n in enumerate(torques.names) if n in without]] = False
        self.fitted = Projection(rows[:, used])
        self.left = self.fitted.left(torques.torque[:, joint])
        self.freedom = max(len(self.left) - self.fitted.basis.shape[1] - 1, 1)

    def gain(self, columns: np.ndarray) -> float:
        """Return the fall of chi-squared that columns (B, m) bring, by the noise left with them."""
        total = float(self.left @ self.left)
        after = self.after(columns)
        left = max(float(after @ after), 1e-12 * total) + 1e-300
        return self.freedom * float(np.log(max(total, 1e-300) / left))

    def after(self, columns: np.ndarray) -> np.ndarray:
        """Return what columns (B, m) leave (B,)."""
        u = self.fitted.beyond(columns, 1e-5)
        return self.left - u @ (u.T @ self.left)
