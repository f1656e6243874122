"""What an experiment must not do: limits the description states, and tighter or further ones of the user."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial.transform import Rotation

from smsid.effects.appendage import Appendage
from smsid.effects.assembly import AppendageJoints
from smsid.effects.mode import Cantilever
from smsid.errors import ExperimentError
from smsid.experiments import Experiment
from smsid.experiments.excitation import DRAFT
from smsid.experiments.fly import LimitUse, limit_use
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate import simulate
from smsid.simulate.trajectory import States


@dataclass(frozen=True)
class Limits:
    """Limits of an experiment beside those the description states; ``None``: none.

    ``stroke`` of a slosh mass from its rest [m]; ``tip``: deflection of an appendage's tip, or of the station
    that moves most [m]; ``root_moment``: elastic moment at an appendage's root [N m]; ``force`` of the
    thrust per axis [N]; ``swing`` of a joint about home [rad], ``joint_rate`` [rad/s], ``joint_torque``
    [N m]; ``wheel_rate`` [rad/s], ``wheel_torque`` [N m]; ``pointing``: how far the bus turns [rad].
    ``margin`` is the share of every limit, the description's too, that a design leaves unused.
    """

    stroke: float | None = None
    tip: float | None = None
    root_moment: float | None = None
    force: float | None = None
    swing: float | None = None
    joint_rate: float | None = None
    joint_torque: float | None = None
    wheel_rate: float | None = None
    wheel_torque: float | None = None
    pointing: float | None = None
    margin: float = 0.02

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if value is not None and not (np.isfinite(value) and value >= 0.0):
                raise ExperimentError(f"The limit `{f.name}` is {value}.", advice="Limits are positive.")
            if value == 0.0 and f.name != "margin":
                raise ExperimentError(
                    f"The limit `{f.name}` is zero: nothing may move.", advice="Limits are positive."
                )
        if self.margin >= 1.0:
            raise ExperimentError("A margin of 1 leaves nothing.", advice="Use a share such as 0.02.")

    @property
    def usable_share(self) -> float:
        """The share of a limit that a design may use."""
        return 1.0 - self.margin

    def use(self, model: SpacecraftModel, states: States, hold_attitude: bool) -> tuple[LimitUse, ...]:
        """Return how far a motion goes towards every limit."""
        own = {
            "thrust per axis": self.force,
            "stroke": self.stroke,
            "torque of wheel": self.wheel_torque,
            "rate of wheel": self.wheel_rate,
            "torque of joint": self.joint_torque,
            "rate of joint": self.joint_rate,
        }
        found = []
        for u in limit_use(model, states, hold_attitude):
            limit = own.get(_kind(u.quantity, model))
            found.append(u if limit is None else replace(u, limit=least(u.limit, limit)))
        if len(model.arm_joints) and self.swing is not None:
            home = model.joint_angles(model.home)
            swing = np.abs(model.joint_angles(states.q) - home).max(axis=0)
            for name, value in zip(model.arm_joints.names, swing, strict=True):
                found.append(LimitUse(f"swing of {name} about home", float(value), self.swing, "rad"))
        for joints in model.appendages:
            found += self._appendage(model, joints, states.q)
        if model.free and not hold_attitude:
            turn = Rotation.from_quat(states.q[:, 3:7])
            angle = (turn[0].inv() * turn).magnitude().max()
            found.append(LimitUse("turn of the bus", float(angle), self.pointing, "rad"))
        return tuple(found)

    def _appendage(self, model: SpacecraftModel, joints: AppendageJoints, q: np.ndarray) -> list[LimitUse]:
        if not len(joints.joints):
            return []
        name = joints.appendage.name
        place = [model.pin.joints[j].idx_q for j in joints.joints]
        delta = q[:, place] * joints.scale
        tip = np.linalg.norm(np.einsum("nk,ski->nsi", delta, tip_shapes(joints.appendage)), axis=-1)
        moment = np.linalg.norm(delta @ root_moments(joints.appendage), axis=-1)
        return [
            LimitUse(f"tip of {name}", float(tip.max(initial=0.0)), self.tip, "m"),
            LimitUse(f"root moment of {name}", float(moment.max(initial=0.0)), self.root_moment, "N m"),
        ]

    def violations(self, uses: Sequence[LimitUse]) -> tuple[LimitUse, ...]:
        """Return the limits that are passed, the margin counted."""
        return tuple(u for u in uses if self.share(u) > 1.0 + 1e-6)

    def share(self, use: LimitUse) -> float:
        """Return how much of what may be used of a limit is used: 1 is all of it, 0 when there is none."""
        return 0.0 if use.limit is None else use.value / (self.usable_share * use.limit)


def experiment_use(model: SpacecraftModel, experiment: Experiment, limits: Limits) -> tuple[LimitUse, ...]:
    """Return what the simulated motion of an experiment uses of every limit."""
    duration = experiment.duration
    motion = simulate(model, experiment.inputs(), duration, q0=experiment.start(model), tolerance=DRAFT)
    states = motion.states(np.linspace(0.0, duration, int(8 * duration) + 1))
    return limits.use(model, states, experiment.hold_attitude)


def least(*limits: float | None) -> float | None:
    """Return the least of limits, ``None`` standing for none."""
    return min((x for x in limits if x is not None), default=None)


def tip_shapes(appendage: Appendage) -> np.ndarray:
    """Return the displacement per modal coordinate (points, modes, 3), of a beam's tip or of all stations."""
    length = getattr(appendage, "length", None)
    if length is not None:
        modes = appendage.modal_data()
        shape = Cantilever.with_modes(length, len(modes)).shape(np.array([length]))
        values = np.asarray(shape).reshape(len(modes)) / np.sqrt(appendage.mass)  # type: ignore[attr-defined]
        return (values[:, None] * np.array([0.0, 0.0, 1.0]))[None]
    return np.array([m.shape for m in appendage.modal_data()], dtype=float).swapaxes(0, 1)


def root_moments(appendage: Appendage) -> np.ndarray:
    """Return the elastic moment at the root per modal coordinate (modes, 3): omega^2 L_r.

    With all modes of the appendage it is the whole moment, the rigid part included: a mode answers an
    acceleration a with ``delta'' = -omega^2 delta - L_t a``, and ``sum L_r L_t`` is the first moment.
    """
    return np.array(
        [(2.0 * np.pi * m.frequency) ** 2 * np.asarray(m.rotation) for m in appendage.modal_data()]
    ).reshape(-1, 3)


def _kind(quantity: str, model: SpacecraftModel) -> str:
    """Return which of the user's limits a quantity is subject to."""
    what, _, name = quantity.partition(" of ")
    if name in model.wheels.names:
        return f"{what} of wheel"
    return f"{what} of joint" if name in model.arm_joints.names else what
