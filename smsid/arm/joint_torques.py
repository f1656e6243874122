"""The torque equations of a recording: columns and torques, averaged over the same short blocks of time."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid.arm._smooth_motion import SmoothMotion
from smsid.arm.columns import JointStates, effect_columns, joint_index
from smsid.arm.near_rest import near_rest
from smsid.effects import Effect
from smsid.errors import RecordingError
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel

BLOCKS = (600, 4000)
"""Least and most blocks that a recording is averaged into, if it has the samples."""

PER_PERIOD = 2.5
"""Blocks per period of the cutoff."""

FOLLOWED = 0.5
"""Share of the frequency a joint's motion is followed to, up to which joints without motors are compared:
what is wrong with their equations is all in the motion, whose joints are not followed equally far."""

CHUNK = 400  # of rows that stay in a processor's cache
SIGN_FIELD = "smoothing"

Shapes = Mapping[str, Mapping[str, float]]
"""Values of what friction is not linear in, by effect and field."""


@short_repr
@dataclass(frozen=True)
class JointTorques:
    """Torque equations ``rows @ x = torque`` of blocks of time.

    ``time`` (B,) [s], ``rows`` (B, nv, n), ``torque`` (B, nv) [N m | N], ``names`` and ``units`` (n,) of x,
    ``starts`` (B,) where the blocks begin in the motion, ``used`` (B, nv) which count (`None`: all).
    What a block leaves out is missing on both sides of the equations: its length changes how much is known,
    and nothing else.
    """

    time: np.ndarray
    rows: np.ndarray
    torque: np.ndarray
    names: tuple[str, ...]
    units: tuple[str, ...]
    starts: np.ndarray
    length: int
    used: np.ndarray | None = None

    def only(self, used: np.ndarray) -> JointTorques:
        """Return the equations with those (B, nv) left out that are not ``used``: both sides are zero."""
        rows, torque = self.rows * used[:, :, None], self.torque * used
        return replace(self, rows=rows, torque=torque, used=used)


def block_length(motion: SmoothMotion, cutoff: float | None = None) -> int:
    """Return the samples of a block.

    As many as a cutoff [Hz] asks for; by default that of the joint whose motion is followed least far:
    above it, torques cannot be predicted. See `FOLLOWED` for joints without motors.

    Raises:
        RecordingError: a cutoff above that.
    """
    least, fewest = min(j.cutoff for j in motion.joints), BLOCKS[0]
    if not motion.torque.any(axis=0).all():
        least, fewest = FOLLOWED * least, 1
        if cutoff is not None and cutoff > least:
            raise RecordingError(
                f"Joints without motors cannot be compared up to {cutoff:g} Hz: their motion is followed to "
                f"{least / FOLLOWED:.3g} Hz.",
                advice=f"Give a cutoff of at most {least:.3g} Hz, or leave it out.",
                largest=least,
            )
    if cutoff is not None:
        return max(1, round(1.0 / (PER_PERIOD * cutoff * motion.step)))
    duration = len(motion.time) * motion.step
    count = np.clip(PER_PERIOD * least * duration, fewest, BLOCKS[1])
    return max(1, int(len(motion.time) / count))


def joint_torques(
    model: SpacecraftModel,
    motion: SmoothMotion,
    length: int,
    shapes: Shapes | None = None,
    load: np.ndarray | None = None,
) -> JointTorques:
    """Return the equations of a motion: B blocks, rows (B, nv, n).

    Args:
        model: a welded arm.
        motion: of it.
        length: samples of a block.
        shapes: widths of friction's sign and the like, see `with_shapes`.
        load: torques (B, nv) that drive the joints [N m | N]; by default those measured.
    """
    links = Regressor(model)
    starts = motion.blocks(length)
    effects = [
        with_shapes(e, (shapes or {}).get(e.name, {}), model, motion) for e in model.description.effect
    ]
    states = joint_states(motion, starts, block_means(motion.torque, starts) if load is None else load)
    averages = []
    count = np.diff(np.append(starts, len(motion.time)))
    edges = [0, *range(max(CHUNK // length, 1), len(starts), max(CHUNK // length, 1)), len(starts)]
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    for a, b in itertools.pairwise(edges):
        within = slice(int(starts[a]), int(starts[b]) if b < len(starts) else len(motion.time))
        q, v, acc = motion.q[within], motion.v[within], motion.a[within]
        extra = [c for e in effects for c in effect_columns(e, model, states.instants(within))]
        names, units = tuple(c.name for c in extra), tuple(c.unit for c in extra)
        rows = np.concatenate([links.torque(q, v, acc), *(c.values[:, :, None] for c in extra)], axis=2)
        averages.append(np.add.reduceat(rows, starts[a:b] - within.start, axis=0))
    return JointTorques(
        block_means(motion.time, starts),
        np.concatenate(averages) / count[:, None, None],
        block_means(motion.torque, starts),
        links.names + names,
        links.units + units,
        starts,
        length,
    )


def block_means(values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return the means of values (N, ...) over blocks that begin at ``starts`` (B,): (B, ...)."""
    count = np.diff(np.append(starts, len(values)))
    return np.add.reduceat(values, starts, axis=0) / count.reshape(-1, *(1,) * (values.ndim - 1))


def blocks_near_rest(motion: SmoothMotion, starts: np.ndarray) -> np.ndarray:
    """Return whether joints are near rest in blocks that begin at ``starts`` (B,), or within a period of what
    blocks leave: (B, nv).
    """
    out = np.zeros((len(starts), motion.v.shape[1]), dtype=bool)
    reach = PER_PERIOD * motion.step * float(np.median(np.diff(np.append(starts, len(motion.time)))))
    at = block_means(motion.time, starts)
    for first, last in motion.bounds:
        own = (starts >= first) & (starts < last)
        out[own] = near_rest(motion.time[first:last], motion.v[first:last], at[own], reach)
    return out


def joint_states(motion: SmoothMotion, starts: np.ndarray, load: np.ndarray) -> JointStates:
    """Return what torques depend on at the instants of a motion, with the loads (B, nv) [N m | N] of its
    blocks, which begin at ``starts`` (B,).
    """
    count = np.diff(np.append(starts, len(motion.time)))
    return JointStates(motion.q, motion.v, motion.a, np.repeat(load, count, axis=0), motion.temperature)


def with_shapes(
    effect: Effect, shapes: Mapping[str, float], model: SpacecraftModel, motion: SmoothMotion
) -> Effect:
    """Return an effect with what its friction is not linear in, by field, and its sign averaged over what is
    unknown of the rate.

    The mean of ``tanh(v / w)`` over a normal v with standard deviation s is ``tanh(v / sqrt(w^2 + pi s^2 /
    2))`` but for 2 % (exact for the error function in place of tanh).
    """
    if SIGN_FIELD not in effect.torque_shapes():
        return effect
    own = shapes.get(SIGN_FIELD, getattr(effect, SIGN_FIELD))
    wide = float(np.sqrt(own**2 + 0.5 * np.pi * rate_spread(effect, model, motion) ** 2))
    return effect.model_copy(update={**shapes, SIGN_FIELD: wide})


def sign_rate(effect: Effect, model: SpacecraftModel, v: np.ndarray) -> np.ndarray:
    """Return the rate (N,) whose sign an effect takes, from rates (N, nv)."""
    return sum(w * v[:, k] for k, w in acts_on(effect, model))  # type: ignore[return-value]


def rate_spread(effect: Effect, model: SpacecraftModel, motion: SmoothMotion) -> float:
    """Return the standard deviation of the rate whose sign an effect takes."""
    return float(np.sqrt(sum((w * motion.rate_sigma[k]) ** 2 for k, w in acts_on(effect, model))))


def acts_on(effect: Effect, model: SpacecraftModel) -> list[tuple[int, float]]:
    """Return the degrees of freedom an effect acts on, and their weights."""
    return [(joint_index(model, joint), w) for joint, w in effect.joint_weights().items()]
