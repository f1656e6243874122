"""Joint friction as MuJoCo has it: a damper and dry friction, the closest to any other law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.effects import JointFriction
from smsid.effects.friction_law import TERMS, friction_columns, sliding_state
from smsid.errors import DescriptionError
from smsid.model.spacecraft import SpacecraftModel

EXACT = ("viscous", "coulomb")
RATE = 1.0
"""Rate up to which laws are compared where a joint states no limit [rad/s | m/s]."""

POINTS = 200


@dataclass(frozen=True)
class DryFriction:
    """``dry`` friction of a degree of freedom [N m | N], ``damping`` to add to its damper, and a note."""

    dry: float
    damping: float = 0.0
    note: str = ""


def dry_friction(model: SpacecraftModel) -> dict[int, DryFriction]:
    """Return the friction of every degree of freedom that has some, by its index in v.

    Terms beyond viscous and Coulomb friction become the damper and the dry friction that come closest over
    all rates up to the joint's limit: least squares, both directions alike, the angle's mean. What depends on
    the load is left out. The note says what was done, and how far off it is.

    Raises:
        DescriptionError: friction that begins midway.
    """
    found: dict[int, DryFriction] = {}
    for effect in model.description.effect:
        if not isinstance(effect, JointFriction):
            continue
        if effect.start is not None and any(getattr(effect, k) for k in effect.strength):
            raise DescriptionError(
                f"The friction '{effect.name}' begins midway (start): no counterpart in MuJoCo.",
                advice="Export without the MuJoCo XML (--no-mujoco), or a description without this effect.",
                kinds=[effect.kind],
            )
        index = int(model.pin.joints[model.pin.getJointId(effect.joint)].idx_v)
        own = _closest(effect, float(model.pin.velocityLimit[index]))
        before = found.get(index, DryFriction(0.0))
        if own.dry or own.note:
            found[index] = DryFriction(
                before.dry + own.dry,
                before.damping + own.damping,
                " ".join(x for x in (before.note, own.note) if x),
            )
    return found


def _closest(effect: JointFriction, limit: float) -> DryFriction:
    other = [t.field for t in TERMS if getattr(effect, t.field) and t.field not in EXACT]
    if not other:
        return DryFriction(effect.coulomb)
    top = limit if np.isfinite(limit) and 0.0 < limit < 1e3 else RATE
    rates = np.linspace(-top, top, POINTS + 1)[:, None]
    angles = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    whole = [t.field for t in TERMS if getattr(effect, t.field) and t.field not in ("viscous", "load")]
    at = sliding_state(effect, rates, angle=angles, smoothing=1e-9 * top)
    columns = friction_columns(effect, whole, at)
    torque = sum(getattr(effect, f) * (c + 0.0 * angles) for f, c in columns.items())
    torque = np.mean(np.broadcast_to(torque, (POINTS + 1, angles.size)), axis=1)
    rate = rates[:, 0]
    dry, damping = _least_squares(rate, torque)
    error = float(np.abs(torque - dry * np.sign(rate) - damping * rate).max())
    dropped = ", without its part by load" if effect.load else ""
    note = (
        f"friction '{effect.name}' has {', '.join(other)}, which MuJoCo has not: dry friction {dry:.4g} and "
        f"damping {effect.viscous + damping:.4g} come closest up to a rate of {top:g}, within "
        f"{error:.3g}{dropped}."
    )
    return DryFriction(dry, damping, note)


def _least_squares(rate: np.ndarray, torque: np.ndarray) -> tuple[float, float]:
    """Return dry friction, not negative, and damping that come closest to a torque."""
    both = np.column_stack([np.sign(rate), rate])
    dry, damping = np.linalg.lstsq(both, torque, rcond=None)[0]
    if dry < 0.0:
        return 0.0, float(rate @ torque / (rate @ rate))
    return float(dry), float(damping)
