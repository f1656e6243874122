"""Effects a welded arm may have, with what each adds to its joint torques."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from smsid.arm.motion import measured_states
from smsid.arm.readings import measured_channel
from smsid.arm.units import joint_unit, slides
from smsid.diagnose._described_effects import free_name
from smsid.diagnose.score_test import linear_torques
from smsid.diagnose.torque._equations import TorqueEquations
from smsid.effects import (
    ActuatorDelay,
    BaseTilt,
    BodyError,
    Effect,
    JointCable,
    JointFriction,
    JointOffset,
    MotorCoupling,
    MotorInertia,
    Payload,
    TimeOffset,
    TorqueGain,
    TorqueOffset,
    catalogue,
)
from smsid.effects.base import AXES
from smsid.effects.external import tilt_of
from smsid.effects.friction_law import LAW_OF_SHAPE, SIMPLER, STRIBECK_RATES, fields_of
from smsid.effects.payload import point_parameters
from smsid.errors import SmsidError
from smsid.model.regressor import INERTIAL_NAMES, Regressor
from smsid.recording import Recording

WITHIN_MOTION = 0.5
"""Share of a joint's largest rate (95 of 100 instants are below that) which such a rate is below: a curve as
wide as the motion is none of breaking loose."""

DRAGS = ("quadratic", "cubic")
"""Friction that would push where it is negative: no cause, whatever it fits."""

SIMPLE = ("viscous", "coulomb", "motor inertia", "constant torque")
"""Shapes a joint is tried with first; all others must explain more than these would."""

Moves = Literal["", "zero", "clock", "tilt"]
Columns = Callable[[TorqueEquations, np.ndarray], np.ndarray]
"""From the equations and the torque (N, joints) that the model predicts on the motion's instants to torques
(N, joints, d) per unit of each parameter."""


@dataclass(frozen=True)
class TorqueCandidate:
    """One effect at one place, with the parameters ``names`` it frees and their torque columns.

    ``lower`` are their bounds, ``grid`` counts variants searched (for the correction), ``needs`` is the place
    of the parameter without which it is nothing of its own. ``moves`` says what the equations have to be made
    again with: a joint's ``zero``, the ``clock`` of the angles or the base's ``tilt``.
    """

    kind: str
    location: str
    family: str
    shape: str
    effect: Effect | None
    names: tuple[str, ...]
    units: tuple[str, ...]
    lower: tuple[float, ...]
    columns: Columns
    grid: int = 1
    needs: int | None = None
    moves: Moves = ""

    @property
    def simpler(self) -> tuple[str, ...]:
        """Shapes at its place that come first: what one of them explains as well is not its own."""
        return SIMPLER.get(self.shape, ())

    @property
    def key(self) -> tuple[str, str, str]:
        """What makes it itself: kind, location, shape."""
        return self.kind, self.location, self.shape

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints whose equations it is about."""
        return tuple(self.location.split(" + "))


def torque_candidates(
    equations: TorqueEquations, recording: Recording, *, known: bool
) -> tuple[TorqueCandidate, ...]:
    """Return every candidate for an arm.

    ``known``: something is known of its links beforehand. Only then can a payload, a wrong link or the gain
    of a torque signal be told from links that are identified along with them.

    Effect classes of users take part by a class method ``candidates(model)`` like those of spacecraft, and
    their method `torque_columns`.
    """
    description = equations.description
    found: list[TorqueCandidate] = []
    for j, joint in enumerate(equations.names):
        found += _friction(equations, joint, j)
        found += _drivetrain(equations, joint, j, known=known)
    for pair in combinations(equations.names, 2):
        found += _couplings(equations, pair)
    source = measured_channel(recording, "joint_position").partition(".")[0]
    clock = TimeOffset(name=_name("time_offset", source), sensor=source)
    found.append(_one(equations, source, "time offset", clock, ["offset"], _slope, moves="clock"))
    found += _tilts(equations)
    if known:
        found += _bodies(equations)
    found += _users(equations)
    return tuple(c for c in found if not _is_described(c, description.effect))


def instance(candidate: TorqueCandidate, effects: Sequence[Effect]) -> Effect:
    """Return its effect as listed already, perhaps with other parameters freed, else its own."""
    assert candidate.effect is not None
    return next((e for e in effects if e.name == candidate.effect.name), candidate.effect)


def _is_described(candidate: TorqueCandidate, effects: Sequence[Effect]) -> bool:
    """Whether the description has its columns, so that its parameters are fitted anyway."""

    def place(effect: Effect | None) -> Any:
        return getattr(effect, "joint", None) or getattr(effect, "joints", None)

    own = candidate.effect
    if own is None or candidate.moves or place(own) is None:
        return False
    has = {f for e in effects if (e.kind, place(e)) == (own.kind, place(own)) for f in e.asked()}
    return {n.partition(".")[2] for n in candidate.names} <= has


def _name(kind: str, location: str) -> str:
    return re.sub(r"\W+", "_", f"{kind}_{location}").strip("_")


def _one(
    equations: TorqueEquations,
    location: str,
    shape: str,
    effect: Effect,
    fields: Sequence[str],
    columns: Columns | None = None,
    **more: Any,
) -> TorqueCandidate:
    """Return a candidate that frees fields of an effect, with its own columns where none are given."""
    known, names = {p.name: p for p in effect.parameters()}, tuple(f"{effect.name}.{x}" for x in fields)
    joints = [j for j in location.split(" + ") if j in equations.names]
    units = tuple(joint_unit(known[n].unit, equations.model, *joints) for n in names)
    lower = tuple(0.0 if f in DRAGS else known[n].lower for f, n in zip(fields, names, strict=True))
    own = partial(_columns_of, effect, fields) if columns is None else columns
    return TorqueCandidate(
        effect.kind, location, effect.family, shape, effect, names, units, **{"lower": lower, **more},
        columns=own,
    )  # fmt: skip


def _columns_of(
    effect: Effect, fields: Sequence[str], equations: TorqueEquations, load: np.ndarray
) -> np.ndarray:
    states = replace(measured_states(equations.motion), load=load)
    found = linear_torques(effect, fields, equations.model, states)
    return np.stack([found[f"{effect.name}.{x}"] for x in fields], axis=2)


def _on(j: int, column: Callable[[TorqueEquations, np.ndarray], np.ndarray]) -> Columns:
    """Return of columns of all joints what acts on joint ``j`` alone."""

    def columns(e: TorqueEquations, load: np.ndarray) -> np.ndarray:
        out = np.zeros((*load.shape, 1))
        out[:, j] = column(e, load)[:, j]
        return out

    return columns


def _slope(e: TorqueEquations, load: np.ndarray) -> np.ndarray:
    return np.gradient(load, e.motion.time, axis=0)[:, :, None]


def _friction(equations: TorqueEquations, joint: str, j: int) -> Iterator[TorqueCandidate]:
    effect = JointFriction(name=_name("joint_friction", joint), joint=joint)
    for shape in ("viscous", "coulomb"):
        yield _one(equations, joint, shape, effect, [shape])
    for shape, law in LAW_OF_SHAPE.items():
        if law == "position" and slides(equations.model, joint):
            continue  # a place has no cosine
        yield _one(equations, joint, shape, effect, fields_of(law))
    largest = float(np.quantile(np.abs(equations.motion.v[:, j]), 0.95))
    for rate in (x for x in STRIBECK_RATES if x < WITHIN_MOTION * largest):
        curve = effect.model_copy(update={"stribeck_rate": rate, "stribeck_exponent": 2.0})
        fields = ("coulomb", "stribeck")
        yield _one(equations, joint, "stribeck", curve, fields, grid=len(STRIBECK_RATES), needs=1)


def _drivetrain(equations: TorqueEquations, joint: str, j: int, *, known: bool) -> Iterator[TorqueCandidate]:
    one, pin_model = partial(_one, equations, joint), equations.model.pin

    def named(cls: type[Effect], **fields: Any) -> Effect:
        kind = str(cls.model_fields["kind"].default)
        return cls.model_validate({"name": _name(kind, joint), **fields})

    yield one("motor inertia", named(MotorInertia, joint=joint, inertia=0.0), ["inertia"])
    yield one("constant torque", named(TorqueOffset, joint=joint), ["torque"])
    if pin_model.joints[pin_model.getJointId(joint)].nq == 1:
        middle = float(np.mean(equations.angles[:, j]))  # what it pulls there is a constant torque
        yield one("cable", named(JointCable, joint=joint, rest=middle), ["stiffness"])
    yield one("delay", named(ActuatorDelay, actuator=joint), ["delay"], _on(j, _slope))
    zero = named(JointOffset, joint=joint, angle=0.0)
    described = (e for e in equations.description.effect if e.kind == zero.kind)
    zero = next((e for e in described if getattr(e, "joint", "") == joint), zero)
    yield one("zero of the joint", zero, ["angle"], _zero_columns(j), moves="zero")
    if known:
        gain = named(TorqueGain, joint=joint)
        less = _on(j, lambda e, load: -load[:, :, None])
        yield one("torque constant", gain, ["error"], less, lower=(-1.0,))


def _zero_columns(j: int) -> Columns:
    """The derivative of the torques by the zero of joint ``j``, of the model that predicts ``load``."""

    def columns(e: TorqueEquations, load: np.ndarray) -> np.ndarray:
        beta = np.linalg.lstsq(e.fine.reshape(-1, e.fine.shape[2]), load.ravel(), rcond=1e-9)[0]
        return (e.slope(j) @ beta)[:, :, None]

    return columns


def _tilts(equations: TorqueEquations) -> Iterator[TorqueCandidate]:
    """Gravity that leans in the base's axes: of the links that torques tell, the others as described."""
    description = equations.description
    if not np.any(description.gravity):
        return
    links = Regressor(equations.model).parameters
    described = np.append(links, np.zeros(equations.base.matrix.shape[1] - len(links)))

    def columns(e: TorqueEquations, load: np.ndarray) -> np.ndarray:
        beta = np.linalg.lstsq(e.fine.reshape(-1, e.fine.shape[2]), load.ravel(), rcond=1e-9)[0]
        theta = described + np.linalg.pinv(e.base.matrix) @ (beta - e.base.matrix @ described)
        return np.einsum("njla,l->nja", e.lean, theta[: len(links)])

    there = {e.name for e in description.effect}
    tilt = tilt_of(description.effect) or BaseTilt(name=free_name("base_tilt", there))
    bodies = (f.name for f in equations.model.pin.frames if f.type == pin.FrameType.BODY)
    root = next(bodies, "universe")
    yield _one(equations, root, "gravity that leans", tilt, ["x", "y"], columns, moves="tilt")


def _couplings(equations: TorqueEquations, joints: tuple[str, str]) -> Iterator[TorqueCandidate]:
    if len({slides(equations.model, j) for j in joints}) > 1:
        return
    location = " + ".join(joints)
    for ratio, shape in ((1.0, "turns with the sum"), (-1.0, "turns with the difference")):
        label = "motor_coupling" if ratio > 0.0 else "motor_coupling_minus"
        effect = MotorCoupling(name=_name(label, location), joints=joints, ratios=(1.0, ratio))
        yield _one(equations, location, shape, effect, ("viscous", "coulomb", "inertia"), grid=2)


def _bodies(equations: TorqueEquations) -> Iterator[TorqueCandidate]:
    model = equations.model
    groups = {
        "mass": (slice(0, 1), ["mass"]),
        "centre of mass": (slice(1, 4), [f"first_moment.{x}" for x in AXES[3]]),
        "inertia": (slice(4, 10), [f"inertia.{x.removeprefix('I')}" for x in INERTIAL_NAMES[4:]]),
    }

    def of(body: int, weights: np.ndarray) -> Columns:
        def columns(e: TorqueEquations, load: np.ndarray) -> np.ndarray:
            every = Regressor(e.model).torque(e.motion.q, e.motion.v, e.motion.a)
            return every[:, :, 10 * body : 10 * body + 10] @ weights

        return columns

    there = {e.name for e in equations.description.effect}
    for k, body in enumerate(Regressor(model).bodies):
        effect = BodyError(name=free_name(_name("body_error", body), there), body=body)
        for shape, (part, fields) in groups.items():
            yield _one(equations, body, shape, effect, fields, of(k, np.eye(10)[:, part]))
    for arm in model.arms.values():
        last = int(arm.joints[-1])
        links = [f for f in model.pin.frames if f.parentJoint == last and f.type == pin.FrameType.BODY]
        if links:
            frame = links[-1]
            name = free_name(_name("payload", frame.name), there)
            held = Payload(name=name, frame=frame.name, mass=0.0)
            place = point_parameters(1.0, np.asarray(frame.placement.translation))
            yield _one(equations, frame.name, "payload", held, ["mass"], of(last - 1, place[:, None]))


def _users(equations: TorqueEquations) -> Iterator[TorqueCandidate]:
    """Candidates of users' effects that enter torques linearly."""
    for cls in catalogue().values():
        own = getattr(cls, "candidates", None)
        for c in () if own is None else own(equations.model):
            fields = [name.removeprefix(f"{c.effect.name}.") for name in c.free]
            one = _one(equations, c.location, c.shape, c.effect, fields, grid=c.grid)
            try:
                one.columns(equations, equations.motion.torque)
            except (SmsidError, KeyError):
                continue
            yield one
