"""Generic tests of what an arm's torques leave: does any joint's equation still depend on anything?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.stats import chi2

from smsid.arm.joint_torques import SIGN_FIELD, acts_on, sign_rate
from smsid.diagnose.specification_tests import SpecificationTest
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.diagnose.torque._fit import TorqueFit
from smsid.diagnose.torque.whitening import robust_p_value
from smsid.effects.friction_law import SMOOTHING
from smsid.effects.gear import gears_of

TIME_TERMS = 6
RIPPLE = range(3, 9)
DELAY = "a delay"

CURVES = (5e-4, 2e-2)
"""Other such rates, sharper and blunter; how friction turns over there is nobody's finding."""

DEPENDENT = 1e-6


def dependences(found: TorqueFit) -> list[SpecificationTest]:
    """Return all generic tests on a fit, the most significant first.

    The torque of every joint against its own rate, load, acceleration, angle, ripple over the angle of joint
    and motor, time and its own slope (a delay), and against rate and acceleration of every other joint. The
    p-values allow for noise that is coloured or uneven: ``ratio`` is the chi-squared of the same p-value.
    How sharply Coulomb friction, described or found, turns over at a reversal is free to differ.
    """
    out = []
    curves = _curves(found)
    for j, joint in enumerate(found.equations.names):
        rows = found.rows_of((joint,))
        for name, parts in _terms(found, j):
            values = np.zeros((*found.load.shape, len(parts)))
            values[:, j] = np.stack(parts, axis=1)
            white = found.whitened(found.equations.filtered(values))
            basis = _beyond(found, white, curves)
            freedom = basis.shape[1]
            if freedom == 0 or (name == DELAY and _is_below_stamps(found, white, basis)):
                continue
            after = found.left - basis @ (basis.T @ found.left)
            level = max(1.0, float(np.mean(after[rows] ** 2)))
            ratio = float(np.sum((basis.T @ found.left) ** 2)) / level
            scaled = after[: found.rows] / np.sqrt(level)
            p = robust_p_value(basis[: found.rows], scaled, ratio, found.samples)
            ratio = float(chi2.isf(p, freedom))
            out.append(SpecificationTest(f"torque of {joint}", name, ratio, freedom, location=joint))
    return sorted(out, key=lambda b: b.p_value)


def _curves(found: TorqueFit) -> np.ndarray:
    """Orthonormal directions in which the turning over of fitted Coulomb friction may differ (rows, k)."""
    parts = []
    for j, rate, fitted in _coulomb_frictions(found):
        for width in CURVES:
            values = np.zeros((*found.load.shape, 1))
            values[:, j, 0] = np.tanh(rate / width) - np.tanh(rate / fitted)
            parts.append(found.whitened(found.equations.filtered(values)))
    none = np.zeros((len(found.left), 0))
    return _beyond(found, np.hstack([none, *parts]), none)


def _coulomb_frictions(found: TorqueFit) -> Iterator[tuple[int, np.ndarray, float]]:
    """Yield joint, rate (N,) and width of its sign of all Coulomb friction, described or found."""
    equations = found.equations
    for effect in equations.description.effect:
        if SIGN_FIELD in effect.torque_shapes():
            rate = sign_rate(effect, equations.model, equations.motion.v)
            for j, _ in acts_on(effect, equations.model):
                yield j, rate, float(getattr(effect, SIGN_FIELD))
    rubs = ("coulomb", "stribeck", "load", "position_cos")
    shared = {t.candidate.joints for t in found.terms if any(n.endswith(rubs) for n in t.names)}
    for joints in sorted(shared):
        own = [equations.names.index(k) for k in joints]
        for j in own:
            yield j, equations.motion.v[:, own].sum(axis=1), SMOOTHING


def _beyond(found: TorqueFit, white: np.ndarray, curves: np.ndarray) -> np.ndarray:
    """Orthonormal directions of whitened columns beside what is fitted and the freedom of friction curves."""
    size = np.linalg.norm(white, axis=0)
    left = white - found.basis @ (found.basis.T @ white)
    left = left - curves @ (curves.T @ left)
    left = left[:, size > 0.0] / size[size > 0.0]
    if left.shape[1] == 0:
        return left
    u, singular, _ = np.linalg.svd(left, full_matrices=False)
    return u[:, singular**2 > DEPENDENT]


def _is_below_stamps(found: TorqueFit, white: np.ndarray, basis: np.ndarray) -> bool:
    """Whether a delay is shorter than time stamps are to be believed: no cause would be made of it either."""
    delay = float(found.left @ basis[:, 0]) / float(white[:, 0] @ basis[:, 0])
    return abs(delay) < THRESHOLDS.stamps * found.equations.interval


def _terms(found: TorqueFit, j: int) -> Iterator[tuple[str, list[np.ndarray]]]:
    motion, names = found.equations.motion, found.equations.names
    angle, rate, load = found.equations.angles[:, j], motion.v[:, j], found.load[:, j]
    sign = np.tanh(rate / SMOOTHING)
    x = (motion.time - motion.time[0]) / (motion.time[-1] - motion.time[0])
    yield "rate", [rate, sign, rate * np.abs(rate), np.sqrt(np.abs(rate)) * sign]
    yield "load", [load, np.abs(load) * sign]
    yield "acceleration", [motion.a[:, j]]
    yield "time", [np.cos(np.pi * k * x) for k in range(TIME_TERMS)]
    yield "angle", [f(k * angle) for k in (1, 2) for f in (np.cos, np.sin)]
    yield "ripple over the angle", [f(k * angle) for k in RIPPLE for f in (np.cos, np.sin)]
    yield DELAY, [np.gradient(load, motion.time)]
    for gear in gears_of(found.equations.description.effect):
        if gear.joint == names[j]:
            turned = gear.ratio * angle + sum(
                ratio * found.equations.angles[:, names.index(n)]
                for n, ratio in gear.also.items()
                if n in names
            )
            yield "ripple over the motor's angle", [f(k * turned) for k in (1, 2) for f in (np.cos, np.sin)]
    for i, other in enumerate(names):
        if i != j:
            yield f"rate of {other}", [motion.v[:, i], np.tanh(motion.v[:, i] / SMOOTHING)]
            yield f"acceleration of {other}", [motion.a[:, i]]
