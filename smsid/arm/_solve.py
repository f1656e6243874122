"""Solving the torque equations of an arm with what they are not linear in.

Shapes of friction, the base's tilt and the lateness of angles are found with all else, so that the intervals
of all include theirs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid._statistics import NORMAL95
from smsid.arm._friction_shape import (
    WITHIN,
    FrictionShape,
    friction_shapes,
    shape_bounds,
    usual_shape,
    with_shape_columns,
)
from smsid.arm._smooth_motion import SmoothMotion
from smsid.arm.joint_torques import JointTorques, acts_on, blocks_near_rest
from smsid.arm.level import Level
from smsid.arm.regression import JointRegression, solve_joints
from smsid.description import Description
from smsid.effects import Effect
from smsid.effects.friction import depends_on_load
from smsid.model.identifiable import BaseParameters
from smsid.model.spacecraft import SpacecraftModel

ROUNDS = 6
"""Rounds in which all that is not linear is fitted with all else."""

FIRST = 0.02
"""Tilt to begin with beside the described one: in a level base some links do not show [rad]."""

LEAN = 0.3
"""Largest change of the base's tilt in a round [rad]."""

SETTLED = 0.05
"""Standard deviations by which nothing moves any more at the end."""

LOADS = 12
"""Rounds in which the load that friction depends on follows from the torques it takes part in."""


@short_repr
@dataclass(frozen=True)
class SolvedEquations:
    """``torques`` are the equations at the shapes, the tilt (2,) or (0,) [rad] and the delay that were found.

    Behind the base parameters (b,) of ``regression`` stand the last changes of the tilt.
    """

    shapes: tuple[FrictionShape, ...]
    torques: JointTorques
    regression: JointRegression
    tilt: np.ndarray
    delay: AngleDelay


def solve_equations(
    model: SpacecraftModel,
    motion: SmoothMotion,
    torques: JointTorques,
    base: BaseParameters,
    level: Level | None = None,
    gain_sigma: np.ndarray | None = None,
    *,
    equal_errors: bool = False,
) -> SolvedEquations:
    """Solve with the shapes of friction, the base's tilt and the lateness of angles free in the covariance.

    ``gain_sigma`` (nv,) are relative standard deviations of the gains that torques were found with. The load
    that friction depends on is what is predicted: what is measured has noise. ``equal_errors``: as large near
    rest as elsewhere.
    """
    load, described = torques.torque, torques
    tilt, late = level.own + FIRST if level else np.zeros(0), IN_STEP
    if level:
        torques = level.equations_at_tilt(described, tilt)
    shapes = friction_shapes(model, motion, torques, load)
    effects = {e.name: e for e in model.description.effect}
    leaning, count = len(base) + tilt.size, len(base) + tilt.size + 1
    places = {torques.names[i]: k for k, i in enumerate(base.independent.tolist())}
    loaded = depends_on_load(model.description.effect)
    near = None if equal_errors else blocks_near_rest(motion, torques.starts)
    sizes: dict[str, float] = {}
    x = np.zeros(len(base))
    for k in range(ROUNDS):
        if level:
            torques = level.equations_at_tilt(described, tilt)
        if late.value:
            aligned = torque_means(motion, torques.starts, late.value)
            torques = replace(torques, torque=aligned if described.used is None else aligned * described.used)
        torques, slopes = with_shape_columns(torques, shapes, model, motion, load)
        rows = torques.rows[:, :, base.independent]
        if not k:  # sizes of friction, for the slopes
            x = solve_joints(rows, torques.torque, near=near, rough=True).x
            sizes = {n: float(x[i]) for n, i in places.items()}
        columns = [rows, level.columns(base, x, tilt) if level else np.zeros((*torques.torque.shape, 0))]
        columns.append(delay_column(motion, torques.starts, rows @ x)[:, :, None])
        for (name, _), of in slopes.items():
            column = np.zeros((*torques.torque.shape, 1))
            own = [i for i, _ in acts_on(effects[name], model)]
            column[:, own, 0] = sum(sizes.get(n, 0.0) * slope for n, slope in of.items())
            columns.append(column)
        mean, sigma = _shape_prior(shapes, effects, model, motion, count)
        mean[leaning], sigma[leaning] = -late.value, EXPECTED
        every = np.concatenate(columns, axis=2)
        if described.used is not None:
            every *= described.used[:, :, None]
        solved = solve_joints(every, torques.torque, (mean, sigma), near=near, rough=True)
        moved = np.max(np.abs(solved.x[len(base) :]) / np.maximum(solved.sigma[len(base) :], 1e-12))
        settled = k == ROUNDS - 1 or (moved < SETTLED and (k > 0 or not loaded))
        if settled:
            solved = solve_joints(every, torques.torque, (mean, sigma), near=near, gain_sigma=gain_sigma)
        sizes = {n: float(solved.x[i]) for n, i in places.items()}
        x = solved.x[: len(base)]
        new = []
        tilt = tilt + np.clip(solved.x[len(base) : leaning], -LEAN, LEAN)
        step = float(np.clip(solved.x[leaning], -EXPECTED, EXPECTED))
        late = AngleDelay(late.value + step, float(solved.sigma[leaning]))
        shifts = iter(zip(solved.x[count:].tolist(), solved.sigma[count:].tolist(), strict=True))
        for s in shapes:
            if s.status != "found":
                new.append(s)
                continue
            shift, spread = next(shifts)
            low, high = shape_bounds(effects[s.effect], s.field, model, motion)
            value = float(np.clip(s.value * np.exp(np.clip(shift, -0.5, 0.5)), low, high))
            new.append(replace(s, value=value, sigma=spread))
        shapes = tuple(new)
        if settled:
            break
        if loaded:
            load = rows @ x
    kept = replace(solved, x=solved.x[:leaning], covariance=solved.covariance[:leaning, :leaning])
    return SolvedEquations(shapes, torques, kept, tilt, late)


def settled_load(
    description: Description, predicted: Callable[[np.ndarray], np.ndarray], load: np.ndarray
) -> np.ndarray:
    """Return the torques (N, nv) [N m | N] that follow from themselves, where friction depends on the load.

    ``predicted`` takes loads (N, nv) and returns torques (N, nv); ``load`` is what to begin with.
    """
    out = predicted(load)
    if depends_on_load(description.effect):
        for _ in range(LOADS):
            before, out = out, predicted(out)
            if np.abs(out - before).max() <= 1e-4 * np.abs(out).max():
                break
    return out


def _shape_prior(
    shapes: Sequence[FrictionShape],
    effects: Mapping[str, Effect],
    model: SpacecraftModel,
    motion: SmoothMotion,
    count: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard deviations of the changes of the shapes' logarithms, behind ``count`` others."""
    found = [s for s in shapes if s.status == "found"]
    mean = [float(np.log(usual_shape(effects[s.effect], s.field, model, motion) / s.value)) for s in found]
    return np.concatenate([np.zeros(count), mean]), np.repeat([np.inf, np.log(WITHIN)], [count, len(found)])


EXPECTED = 0.01
"""Standard deviation of the lateness before the torques are looked at [s]."""


@dataclass(frozen=True)
class AngleDelay:
    """``value`` by which angles are late against torques, and its standard deviation ``sigma`` [s]."""

    value: float
    sigma: float


IN_STEP = AngleDelay(0.0, 0.0)


def torque_means(motion: SmoothMotion, starts: np.ndarray, late: float) -> np.ndarray:
    """Return the mean torques (B, nv) [N m | N] of the motion of blocks, which begin at ``starts`` (B,).

    A sample stands for the step around it; a window that is ``late`` [s] earlier holds shares of its first
    and last one. Beyond either end of a stretch its outermost samples stand.
    """
    ends = np.append(starts[1:], len(motion.time))
    out = np.empty((len(starts), motion.torque.shape[1]))
    for first, last in motion.bounds:
        own = (starts >= first) & (starts < last)
        torque = motion.torque[first:last]
        shift = late / motion.step
        more = int(np.ceil(abs(shift))) + 1
        torque = np.concatenate([np.repeat(torque[:1], more, 0), torque, np.repeat(torque[-1:], more, 0)])
        total = np.vstack([np.zeros((1, torque.shape[1])), np.cumsum(torque, axis=0)])
        places = np.arange(len(total)) - more + first
        begin, end = starts[own] - shift, ends[own] - shift
        for k in range(torque.shape[1]):
            area = np.interp(end, places, total[:, k]) - np.interp(begin, places, total[:, k])
            out[own, k] = area / (end - begin)
    return out


def delay_column(motion: SmoothMotion, starts: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """Return what a torque signal (B, nv) changes by per second that the angles are later [N m/s | N/s].

    ``predicted`` (B, nv) are the torques of the blocks that begin at ``starts`` (B,): what is measured has
    noise.
    """
    at = np.asarray(motion.time)[starts]
    out = np.zeros_like(predicted)
    for first, last in motion.bounds:
        own = np.flatnonzero((starts >= first) & (starts < last))
        if own.size > 1:
            out[own] = np.gradient(predicted[own], at[own], axis=0)
    return out


def delay_note(delay: AngleDelay) -> list[str]:
    """Return a sentence on the lateness, if there is any."""
    if not abs(delay.value) > 3.0 * delay.sigma:
        return []
    ms = f"{1e3 * abs(delay.value):.3g} +- {1e3 * NORMAL95 * delay.sigma:.2g} ms"
    ahead = "ahead of" if delay.value > 0.0 else "behind"
    return [f"the torque signal is {ms} {ahead} the motion: found, and taken into account"]
