"""Hidden states of motions that follow each other, in memory that does not grow.

The slosh is carried from one motion to the next exactly, the modal states by the filter, smoothed with the
motion after as what is still to come.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from smsid.identify.paper.hidden_states import LEAST_NOISE, HiddenStates
from smsid.identify.paper.modal_state import ModalState, smooth_modes
from smsid.identify.paper.motion import MeasuredMotion
from smsid.identify.paper.slosh_state import estimate_slosh
from smsid.identify.robust import white_sigma
from smsid.model.spacecraft import SpacecraftModel

Chunk = tuple[MeasuredMotion, HiddenStates]


class HiddenStateCarrier:
    """Hidden states of motions that follow each other; a piece comes out when the one after it is there."""

    def __init__(self, model: SpacecraftModel) -> None:
        self.model = model
        self._carry, self._carry_again = Carry({}, {}), Carry({}, {})
        self._noises: tuple[dict[str, float], dict[str, float]] | None = None
        self._before: MeasuredMotion | None = None
        self._previous: MeasuredMotion | None = None

    def push(self, motion: MeasuredMotion | None) -> Chunk | None:
        """Take in the next motion, or ``None`` at the end; return the one before with its hidden states."""
        previous, out = self._previous, None
        if previous is not None:
            self._noises = self._noises or _noises(self.model, previous)
            hidden = _carry_hidden_states(
                self.model, self._before, previous, motion, self._carry, self._noises[0]
            )
            if previous.again is not None:
                more = [m.again if m is not None else None for m in (self._before, previous, motion)]
                assert more[1] is not None
                other = _carry_hidden_states(
                    self.model, more[0], more[1], more[2], self._carry_again, self._noises[1]
                )
                hidden = replace(hidden, again=other)
            out = previous, hidden
        self._before, self._previous = previous, motion
        return out


@dataclass
class Carry:
    """Where hidden states are at the end of a piece: slosh (rho, rho'), the filter of every panel."""

    slosh: dict[str, tuple[np.ndarray, np.ndarray]]
    modes: dict[str, tuple[np.ndarray, np.ndarray]]


def _carry_hidden_states(
    model: SpacecraftModel,
    before: MeasuredMotion | None,
    motion: MeasuredMotion,
    after: MeasuredMotion | None,
    carry: Carry,
    noise: dict[str, float],
) -> HiddenStates:
    """Hidden states of a piece, with the last sample of the one before and the one after as what comes."""
    joined, skip = motion, 0
    if before is not None:
        joined, skip = before.only(slice(-1, None)).followed_by(motion), 1
    kept = slice(skip, skip + len(motion))
    slosh, modes = {}, {}
    for joint in model.slosh:
        tank, name = joint.tank, joint.name
        springs = np.array(tank.stiffness), np.array(tank.damping)
        start = carry.slosh.get(name)
        rho, rate = estimate_slosh(joined, joint.position, tank.mass, *springs, start=start)
        carry.slosh[name] = rho[-1], rate[-1]
        slosh[name] = rho[kept], rate[kept]
    longer = joined if after is None else joined.followed_by(after)
    for panel in model.appendages:
        name = panel.appendage.name
        own = smooth_modes(
            longer,
            panel,
            accelerometer=noise.get(name, noise["imu"]),
            imu=noise["imu"],
            start=carry.modes.get(name),
            going_on=True,
        )
        assert own.forward is not None
        last = skip + len(motion) - 1
        carry.modes[name] = own.forward[0][last], own.forward[1][last]
        modes[name] = ModalState(own.position[kept], own.velocity[kept])
    return HiddenStates(slosh, modes)


def _noises(model: SpacecraftModel, motion: MeasuredMotion) -> tuple[dict[str, float], dict[str, float]]:
    """Noise of the prepared accelerations, read from the first piece, without and with noise once more."""

    def of(motion: MeasuredMotion) -> dict[str, float]:
        values = {"imu": motion.acceleration, **motion.panels}
        return {k: max(float(np.sqrt(np.mean(white_sigma(x) ** 2))), LEAST_NOISE) for k, x in values.items()}

    return of(motion), of(motion.again if motion.again is not None else motion)
