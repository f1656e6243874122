"""What an identified arm leaves of its torques, in sentences: noise, or something that is missing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from smsid.arm.joint_torques import block_means

if TYPE_CHECKING:
    from smsid.arm.identify import ArmIdentification

PLAIN = 0.25
"""Share of the residual's squares that a plain cause must explain to be hinted at."""

NOISE = 3
"""Lags over which a residual may be correlated and still pass for noise."""

SHARP = 0.01
"""Width of a sign for the hint, as a share of the rate's rms."""


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
            "is missing that the model does not have, and intervals allow for it. `smsid diagnose` looks for "
            "causes."
        )
    hints = [h for k, n in _places(found) if (h := _hint(found, residual, k, n))]
    return [first, *hints]


def _places(found: ArmIdentification) -> list[tuple[int, str]]:
    joints = found.model.arm_joints
    return [(int(v), n) for v, n in zip(joints.v.tolist(), joints.names, strict=True)]


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
