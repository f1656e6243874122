"""Effects a welded arm may have, with what each adds to its joint torques."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from smsid.arm.columns import JointStates, effect_columns
from smsid.arm.motion import measured_channel
from smsid.arm.units import joint_unit, slides
from smsid.diagnose.torque.equations import TorqueEquations
from smsid.effects import (
    ActuatorDelay,
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
from smsid.effects.friction_law import BY_FIELD, LAW_OF_SHAPE, SIMPLER, fields_of, sliding_state
from smsid.errors import SmsidError
from smsid.model.regressor import INERTIAL_NAMES, Regressor
from smsid.recording import Recording

STRIBECK_RATES = (0.02, 0.05, 0.1, 0.2)
"""Rates tried for Stribeck's curve [rad/s | m/s]; it sticks out of Coulomb's below that."""

SLOW = 0.5
"""Share of a joint's largest rate (95 of 100 instants are below that) which such a rate is below: a curve as
wide as the motion is none of breaking loose."""

SHAPES: Mapping[str, tuple[str, ...]] = {
    "viscous": ("viscous",),
    "coulomb": ("coulomb",),
    **{shape: fields_of(law) for shape, law in LAW_OF_SHAPE.items()},
}
"""Parameters of friction that a cause frees, by its name."""

Moves = Literal["", "zero", "clock"]
Columns = Callable[[TorqueEquations, np.ndarray], np.ndarray]
"""From the equations and the torque (N, joints) that the model predicts on the motion's instants to torques
(N, joints, d) per unit of each parameter."""


@dataclass(frozen=True)
class TorqueCandidate:
    """One effect at one place, with the parameters ``names`` it frees and their torque columns.

    ``lower`` are their bounds, ``grid`` counts variants searched (for the correction), ``needs`` is the place
    of the parameter without which it is nothing of its own. ``moves`` says what the
    equations have to be made again with: a joint's ``zero`` or the ``clock`` of the angles.
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
        found += _drivetrain(equations, joint, j)
        if known:
            found.append(_gain(joint, j))
    for pair in combinations(range(len(equations.names)), 2):
        found += _couplings(equations.names, pair)
    found.append(_clock(measured_channel(recording, "joint_position").partition(".")[0]))
    if known:
        found += _bodies(equations)
    found += _users(equations)
    found = [_in_own_units(c, equations) for c in found]
    taken = {(e.kind, getattr(e, "joint", None) or getattr(e, "joints", None)) for e in description.effect}
    return tuple(c for c in found if not _listed(c, taken))


def _in_own_units(candidate: TorqueCandidate, equations: TorqueEquations) -> TorqueCandidate:
    """Return a candidate at joints that slide in metres and newtons."""
    joints = [j for j in candidate.joints if j in equations.names]
    if not joints or len({slides(equations.model, j) for j in joints}) > 1:
        return candidate
    return replace(candidate, units=tuple(joint_unit(u, equations.model, *joints) for u in candidate.units))


def instance(candidate: TorqueCandidate, effects: Sequence[Effect]) -> Effect:
    """Return its effect as listed already, perhaps with other parameters freed, else its own."""
    assert candidate.effect is not None
    return next((e for e in effects if e.name == candidate.effect.name), candidate.effect)


def _listed(candidate: TorqueCandidate, taken: set[tuple[str, Any]]) -> bool:
    """Whether the description has the effect, so that its parameters are fitted anyway."""
    effect = candidate.effect
    place = getattr(effect, "joint", None) or getattr(effect, "joints", None)
    if candidate.kind == "joint_friction" and candidate.shape not in ("viscous", "coulomb"):
        return False  # those the rows of a listed friction do not have
    return not candidate.moves and place is not None and (candidate.kind, place) in taken


def _name(kind: str, location: str) -> str:
    return re.sub(r"\W+", "_", f"{kind}_{location}").strip("_")


def _at(j: int, *parts: Callable[[TorqueEquations, np.ndarray], np.ndarray]) -> Columns:
    """Columns that act on joint ``j`` alone, each part (N,) from the equations and the predicted torque."""

    def columns(e: TorqueEquations, load: np.ndarray) -> np.ndarray:
        out = np.zeros((*load.shape, len(parts)))
        for i, part in enumerate(parts):
            out[:, j, i] = part(e, load)
        return out

    return columns


def _friction(equations: TorqueEquations, joint: str, j: int) -> Iterator[TorqueCandidate]:
    effect = JointFriction(name=_name("joint_friction", joint), joint=joint)
    units = {p.name.partition(".")[2]: p.unit for p in effect.parameters()}
    lower = {p.name.partition(".")[2]: p.lower for p in effect.parameters()}
    lower |= {"quadratic": 0.0, "cubic": 0.0}  # a drag that pushes is no cause, whatever it fits

    def columns(*own: str, of: JointFriction = effect) -> tuple[Callable[..., np.ndarray], ...]:
        def part(e: TorqueEquations, load: np.ndarray, name: str) -> np.ndarray:
            at = sliding_state(of, e.motion.v[:, j], angle=e.angles[:, j], load=load[:, j])
            return BY_FIELD[name].column(at)

        return tuple(partial(part, name=name) for name in own)

    def make(
        shape: str,
        fields: tuple[str, ...],
        *parts,
        with_: Effect = effect,
        grid: int = 1,
        needs: int | None = None,
    ) -> TorqueCandidate:
        names = tuple(f"{effect.name}.{x}" for x in fields)
        return TorqueCandidate(
            "joint_friction", joint, "friction", shape, with_, names,
            tuple(units[x] for x in fields), tuple(lower[x] for x in fields), _at(j, *parts), grid, needs,
        )  # fmt: skip

    slide = slides(equations.model, joint)
    for shape, own in SHAPES.items():
        if slide and shape == "position-dependent":
            continue  # a place has no cosine
        yield make(shape, own, *columns(*own))
    largest = float(np.quantile(np.abs(equations.motion.v[:, j]), 0.95))
    for rate in (x for x in STRIBECK_RATES if x < SLOW * largest):
        curve = effect.model_copy(update={"stribeck_rate": rate, "stribeck_exponent": 2.0})
        own = ("coulomb", "stribeck")
        yield make("stribeck", own, *columns(*own, of=curve), with_=curve, grid=len(STRIBECK_RATES), needs=1)


def _drivetrain(equations: TorqueEquations, joint: str, j: int) -> Iterator[TorqueCandidate]:
    def one(
        effect: Effect, shape: str, field: str, columns: Columns, family: str, lower: float, moves: Moves = ""
    ):
        unit = next(p.unit for p in effect.parameters() if p.name == f"{effect.name}.{field}")
        names = (f"{effect.name}.{field}",)
        return TorqueCandidate(
            effect.kind, joint, family, shape, effect, names, (unit,), (lower,), columns, moves=moves
        )

    rotor = MotorInertia(name=_name("motor_inertia", joint), joint=joint, inertia=0.0)
    bias = TorqueOffset(name=_name("torque_offset", joint), joint=joint)
    late = ActuatorDelay(name=_name("actuator_delay", joint), actuator=joint)
    listed = [e for e in equations.description.effect if isinstance(e, JointOffset) and e.joint == joint]
    zero = listed[0] if listed else JointOffset(name=_name("joint_offset", joint), joint=joint, angle=0.0)
    middle = float(np.mean(equations.angles[:, j]))  # what it pulls there is a constant torque
    cable = JointCable(name=_name("joint_cable", joint), joint=joint, rest=middle)
    pull = _at(j, lambda e, load: e.angles[:, j] - middle)
    inertia = _at(j, lambda e, load: e.motion.a[:, j])
    constant = _at(j, lambda e, load: np.ones(len(load)))
    slope = _at(j, lambda e, load: np.gradient(load[:, j], e.motion.time))
    yield one(rotor, "motor inertia", "inertia", inertia, "drivetrain", 0.0)
    yield one(bias, "constant torque", "torque", constant, "drivetrain", -np.inf)
    if equations.model.pin.joints[equations.model.pin.getJointId(joint)].nq == 1:
        yield one(cable, "cable", "stiffness", pull, "drivetrain", 0.0)
    yield one(late, "delay", "delay", slope, "actuator", 0.0)
    yield one(zero, "zero of the joint", "angle", _turned(j), "drivetrain", -np.inf, "zero")


def _turned(j: int) -> Columns:
    """The derivative of the torques by the zero of joint ``j``, of the model that predicts ``load``."""

    def columns(e: TorqueEquations, load: np.ndarray) -> np.ndarray:
        beta = np.linalg.lstsq(e.fine.reshape(-1, e.fine.shape[2]), load.ravel(), rcond=1e-9)[0]
        return (e.slope(j) @ beta)[:, :, None]

    return columns


def _gain(joint: str, j: int) -> TorqueCandidate:
    effect = TorqueGain(name=_name("torque_gain", joint), joint=joint)
    return TorqueCandidate(
        "torque_gain", joint, "actuator", "torque constant", effect, (f"{effect.name}.error",), ("1",),
        (-1.0,), _at(j, lambda e, load: -load[:, j]),
    )  # fmt: skip


def _couplings(names: Sequence[str], pair: tuple[int, int]) -> Iterator[TorqueCandidate]:
    for ratio, shape in ((1.0, "turns with the sum"), (-1.0, "turns with the difference")):
        joints = names[pair[0]], names[pair[1]]
        location = " + ".join(joints)
        label = "motor_coupling" if ratio > 0.0 else "motor_coupling_minus"
        effect = MotorCoupling(name=_name(label, location), joints=joints, ratios=(1.0, ratio))

        def columns(e: TorqueEquations, load: np.ndarray, effect: MotorCoupling = effect) -> np.ndarray:
            found = effect_columns(effect, e.model, JointStates(e.motion.q, e.motion.v, e.motion.a, load))
            by_name = {c.name.partition(".")[2]: c.values for c in found}
            return np.stack([by_name[k] for k in ("viscous", "coulomb", "inertia")], axis=2)

        fields = {"viscous": "N m s/rad", "coulomb": "N m", "inertia": "kg m^2"}
        yield TorqueCandidate(
            "motor_coupling", location, "drivetrain", shape, effect,
            tuple(f"{effect.name}.{x}" for x in fields), tuple(fields.values()), (0.0,) * 3, columns, 2,
        )  # fmt: skip


def _clock(source: str) -> TorqueCandidate:
    effect = TimeOffset(name=_name("time_offset", source), sensor=source)

    def columns(e: TorqueEquations, load: np.ndarray) -> np.ndarray:
        return np.gradient(load, e.motion.time, axis=0)[:, :, None]

    return TorqueCandidate(
        "time_offset", source, "sensor", "time offset", effect, (f"{effect.name}.offset",), ("s",),
        (-np.inf,), columns, moves="clock",
    )  # fmt: skip


def _bodies(equations: TorqueEquations) -> Iterator[TorqueCandidate]:
    model = equations.model
    regressor = Regressor(model)
    units = {0: ("kg",), 1: ("kg m",) * 3, 2: ("kg m^2",) * 6}
    fields = {0: ("mass",), 1: tuple(f"first_moment.{x}" for x in AXES[3]), 2: _inertia_fields()}
    shapes = {0: "mass", 1: "centre of mass", 2: "inertia"}
    slices = {0: slice(0, 1), 1: slice(1, 4), 2: slice(4, 10)}

    def of(start: int, part: slice) -> Columns:
        def columns(e: TorqueEquations, load: np.ndarray) -> np.ndarray:
            every = Regressor(e.model).torque(e.motion.q, e.motion.v, e.motion.a)
            return every[:, :, start : start + 10][:, :, part]

        return columns

    for k, body in enumerate(regressor.bodies):
        effect = BodyError(name=_name("body_error", body), body=body)
        for which, shape in shapes.items():
            names = tuple(f"{effect.name}.{x}" for x in fields[which])
            yield TorqueCandidate(
                "body_error", body, "inertia", shape, effect, names, units[which],
                (-np.inf,) * len(names), of(10 * k, slices[which]),
            )  # fmt: skip
    for arm in model.arms.values():
        last = int(arm.joints[-1])
        links = [f for f in model.pin.frames if f.parentJoint == last and f.type == pin.FrameType.BODY]
        if not links:
            continue
        frame = links[-1]
        effect = Payload(name=_name("payload", frame.name), frame=frame.name, mass=0.0)
        place = np.asarray(frame.placement.translation)

        def held(
            e: TorqueEquations, load: np.ndarray, last: int = last, place: np.ndarray = place
        ) -> np.ndarray:
            from smsid.effects.payload import point_parameters

            every = Regressor(e.model).torque(e.motion.q, e.motion.v, e.motion.a)
            own = every[:, :, 10 * (last - 1) : 10 * last]
            return (own @ point_parameters(1.0, place))[:, :, None]

        yield TorqueCandidate(
            "payload", frame.name, "inertia", "payload", effect, (f"{effect.name}.mass",), ("kg",), (0.0,),
            held,
        )  # fmt: skip


def _inertia_fields() -> tuple[str, ...]:
    return tuple(f"inertia.{x.removeprefix('I')}" for x in INERTIAL_NAMES[4:])


def _users(equations: TorqueEquations) -> Iterator[TorqueCandidate]:
    """Candidates of effects whose columns someone registered."""
    for cls in catalogue().values():
        own = getattr(cls, "candidates", None)
        if own is None or cls.torque_columns is Effect.torque_columns:
            continue
        for c in own(equations.model):
            parameters = {p.name: p for p in c.effect.parameters()}

            def columns(e: TorqueEquations, load: np.ndarray, c=c) -> np.ndarray:
                states = JointStates(e.motion.q, e.motion.v, e.motion.a, load)
                found = {x.name: x.values for x in effect_columns(c.effect, e.model, states)}
                return np.stack([found[name] for name in c.free], axis=2)

            try:
                columns(equations, equations.motion.torque)
            except (SmsidError, KeyError):
                continue
            yield TorqueCandidate(
                c.kind, c.location, c.family, c.shape, c.effect, c.free,
                tuple(parameters[n].unit for n in c.free), tuple(parameters[n].lower for n in c.free),
                columns, c.grid,
            )  # fmt: skip
