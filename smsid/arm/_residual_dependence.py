"""What an identified arm leaves of its torques, in sentences: noise, or something that is missing."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

import numpy as np

from smsid.arm.columns import joint_angle
from smsid.arm.joint_torques import block_means
from smsid.arm.level import Level
from smsid.arm.regression import Projection, correlation_lags
from smsid.effects import BaseTilt
from smsid.effects.external import tilt_of
from smsid.effects.friction import frictions_of
from smsid.effects.friction_law import STRIBECK_SHARES, Law, fields_of, friction_columns, sliding_state

if TYPE_CHECKING:
    from smsid.arm.identify import ArmIdentification

PLAIN = 0.25
"""Share of the residual's squares that a plain cause must explain to be hinted at."""

NOISE = 3
"""Lags over which a residual may be correlated and still pass for noise."""

SHARP = 0.01
"""Width of a sign for the hint, as a share of the rate's rms."""

LAW = 0.05
"""Share of the residual's squares that a law of friction, or gravity's lean, must explain to be hinted at."""

CHANCE = 12.0
"""Fall of chi-squared per parameter of a law that chance does not make (five joints and laws looked at)."""


def leftover_sentences(found: ArmIdentification) -> list[str]:
    """Return the verdict on the residual, and a hint where something plain is missing."""
    residual = found.residual()
    measured = found.torques.torque
    share = float(np.linalg.norm(residual) / max(float(np.linalg.norm(measured)), 1e-300))
    span = found.regression.lags * found.torques.length * found.motion.step
    if found.regression.lags <= NOISE:
        first = f"residual: {100 * share:.3g} % of the torque is left, and it is noise."
    else:
        first = (
            f"residual: {100 * share:.3g} % of the torque is left, correlated over {span:.3g} s: something "
            "is missing that the model does not have. Intervals allow for how it scatters, not for what it "
            "shifts throughout. `smsid diagnose` looks for causes."
        )
    joints = found.model.arm_joints
    places = [(int(k), n) for k, n in zip(joints.v, joints.names, strict=True)]
    hints = [_hint(found, residual, k, n) or _friction_hint(found, residual, k, n) for k, n in places]
    hints = [h for h in hints if h]
    return [first, *hints, *_level_hint(found, residual, PLAIN if hints else LAW)]


def _hint(found: ArmIdentification, residual: np.ndarray, k: int, name: str) -> str:
    v = found.motion.v[:, k]
    width = SHARP * max(float(np.sqrt(np.mean(v**2))), 1e-12)
    starts = found.torques.starts
    causes = {
        "friction (joint_friction)": (v, np.tanh(v / width)),
        "the inertia of its motor (motor_inertia)": (found.motion.a[:, k],),
        "a constant torque (torque_offset)": (np.ones_like(v),),
    }
    total = float(np.sum(residual[:, k] ** 2))
    shares = {}
    for what, columns in causes.items():
        design = np.column_stack([block_means(c, starts) for c in columns])
        left = residual[:, k] - design @ np.linalg.lstsq(design, residual[:, k], rcond=None)[0]
        shares[what] = 1.0 - float(left @ left) / max(total, 1e-300)
    what = max(shares, key=lambda w: shares[w])
    if total == 0.0 or shares[what] < PLAIN:
        return ""
    share = f"{100 * shares[what]:.0f} %"
    return f"hint: {share} of what is left at '{name}' goes with {what}, which is not described."


def _level_hint(found: ArmIdentification, residual: np.ndarray, least: float) -> list[str]:
    """Say by how much gravity leans, if that explains the share ``least`` of what is left: a score test over
    all joints at once.
    """
    description = found.model.description
    if tilt_of(description.effect) is not None or not np.any(description.gravity):
        return []
    level = Level.of(found.model, found.motion, found.torques, BaseTilt(name="level"))
    columns = level.columns(found.base, found.regression.x, level.own)
    if found.torques.used is not None:
        columns = columns * found.torques.used[:, :, None]
    rows = np.concatenate([found.torques.rows[:, :, found.base.independent], columns], axis=2)
    rows = (rows / found.regression.noise[:, None]).reshape(residual.size, -1)
    left = (residual / found.regression.noise).ravel()
    slopes = Projection(rows[:, :-2]).left(rows[:, -2:])
    lean = np.linalg.lstsq(slopes, left, rcond=1e-6)[0]
    share = float(np.sum((slopes @ lean) ** 2)) / max(float(left @ left), 1e-300)
    fall = len(left) / max(found.regression.lags, 1) * share / max(1.0 - share, 1e-6)
    if share < least or fall < CHANCE * len(lean):
        return []
    return [
        f"hint: {100 * share:.0f} % of what is left goes with gravity that leans by about "
        f"{np.degrees(np.linalg.norm(lean)):.2g} degrees: is the base level? --level finds its direction."
    ]


def _friction_hint(found: ArmIdentification, residual: np.ndarray, k: int, name: str) -> str:
    """Say which law of friction, beside those identified, the residual of a joint asks for most."""
    own = frictions_of(found.model.description.effect).get(name)
    total = float(np.sum(residual[:, k] ** 2))
    if own is None or total == 0.0:
        return ""
    motion, torques = found.motion, found.torques
    rows = torques.rows[:, :, found.base.independent]
    fitted, driving = Projection(rows[:, k]), (rows @ found.regression.x)[:, k]
    load = np.repeat(driving, np.diff(np.append(torques.starts, len(motion.time))))
    v = motion.v[:, k]
    width = next(s.value for s in found.shapes if s.effect == own.name and s.field == "smoothing")
    rms = float(np.sqrt(np.mean(v**2)))
    temperature = None if motion.temperature is None else motion.temperature[:, k]
    angle = joint_angle(found.model, name, motion.q)
    lags = max(correlation_lags(residual[:, k : k + 1]), 1)
    best, most = "", 0.0
    for law in get_args(Law):
        fields = [f for f in fields_of(law) if f not in own.asked()]
        if not fields or (law == "temperature" and temperature is None):
            continue
        for slow in STRIBECK_SHARES if law == "stribeck" else STRIBECK_SHARES[:1]:
            curved = own.model_copy(update={"stribeck_rate": slow * rms, "stribeck_exponent": 2.0})
            at = sliding_state(curved, v, angle=angle, load=load, temperature=temperature, smoothing=width)
            columns = np.column_stack(
                [block_means(c, torques.starts) for c in friction_columns(curved, fields, at).values()]
            )
            new = fitted.beyond(columns, 1e-3)
            share, rank = float(np.sum((new.T @ residual[:, k]) ** 2)) / total, new.shape[1]
            fall = len(residual) / lags * share / max(1.0 - share, 1e-6)
            if rank and share >= LAW and fall > CHANCE * rank and share > most:
                best, most = law, share
    if not best:
        return ""
    share = f"{100 * most:.0f} %"
    law = f"friction by the law '{best}': --friction {best}={name}"
    return f"hint: {share} of what is left at '{name}' goes with {law}."
