"""Which effects could be where: the catalogue laid over a spacecraft and the channels of a recording."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
from pydantic import ValidationError

from smsid.diagnose._added_oscillator import AddedOscillatorHypothesis, OscillatorHypothesis
from smsid.diagnose._described_effects import from_described
from smsid.diagnose._gravity_gradient_hypothesis import GravityGradientHypothesis
from smsid.diagnose._profiled_hypothesis import Imbalance, LeakHypothesis
from smsid.diagnose._threshold_hypothesis import ThresholdHypothesis
from smsid.diagnose._truncated_mode import HigherMode
from smsid.diagnose.score_test import Candidate, recast
from smsid.effects.appendage import Appendage
from smsid.effects.base import Effect, catalogue, known_effect
from smsid.effects.friction_law import LAW_OF_SHAPE, SIMPLER, fields_of
from smsid.effects.sensor import VECTORS
from smsid.effects.spatial import turns
from smsid.errors import SmsidError
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Problem, recordings_of
from smsid.model.regressor import INERTIAL_NAMES, body_names

LOGGER = logging.getLogger(__name__)
AXES = ("x", "y", "z")
SINGLE = ("command.thruster", "command.thruster_force")  # a column a thruster
COM = ("com.x", "com.y", "com.z")
ROTOR = 0.05  # share of a joint's inertia that its rotor may have: standard deviation
CARRIED = 0.5  # how far its rotor turns with the link before it, none to fully: standard deviation
CROSSED = (0.7, 0.2, 0.06, 0.015, 0.003)  # of a joint's torque: with more, play is as a soft gear
STICKS = (0.3, 0.1, 0.03, 0.01)  # of a wheel's rate, below which it may stick: above, Coulomb's is as good
ROOM = (0.6, 1.0, 1.4, 1.8, 2.2)  # of how far a slosh mass moves (rms): where the wall of its tank may be
ABOUT = 1.0  # [m] how far a sensor may be from where it is said to be: standard deviation


def propose(point: Point, problem: Problem, nominal: Sequence[Unknown]) -> list[Candidate]:
    """Return every candidate for a spacecraft: the catalogue's, those of user effects, and shifts of nominal
    parameters beyond their priors.

    An effect class of the user takes part by a class method ``candidates(model)`` that yields candidates.
    """
    found: dict[tuple[str, str, str], Candidate] = {}
    for candidate in (
        *_joints(point, problem),
        *_bodies(point, nominal),
        *_fuel(point, nominal),
        *more_slosh(point, problem),
        *_panels(point, nominal),
        *_further_modes(point, nominal),
        *more_modes(point, problem),
        *higher_modes(point, problem),
        *_outside(point, problem),
        *_sensors(point, problem),
        *_users(point),
    ):
        found.setdefault(candidate.key, from_described(candidate, point))
    return list(found.values())


def _instance(kind: str, name: str, **fields: Any) -> Effect | None:
    cls = known_effect(kind)
    if cls is None:
        return None
    try:
        return cls.model_validate({"kind": kind, "name": name, **fields})
    except (ValidationError, SmsidError) as error:
        LOGGER.info("no candidate %s: %s", name, error)
        return None


def _one(
    kind: str,
    location: str,
    shape: str,
    fields: dict[str, Any],
    free: dict[str, float],
    also: Sequence[str] = (),
    part: str = "",
    simpler: Sequence[str] = (),
) -> Iterator[Candidate]:
    """Yield a candidate; ``free`` gives the step of each parameter, vectors as ``key.x``. ``part`` tells
    effects of a kind apart that may stand at one location together; ``simpler`` as in `Candidate`.
    """
    name = re.sub(r"\W+", "_", f"{kind}_{location}_{part}").strip("_")
    effect = _instance(kind, name, **fields)
    if effect is None:
        return
    known = {p.name for p in effect.parameters()}
    names = tuple(f"{name}.{key}" for key in free)
    if not set(names) <= known:
        LOGGER.info("no candidate %s: it has %s", name, sorted(known))
        return
    more = tuple(f"{name}.{key}" for key in also if f"{name}.{key}" in known)
    steps = tuple(free.values())
    own = type(effect).family
    yield Candidate(kind, location, own, shape, effect, names, steps, more, simpler=tuple(simpler))


def _threshold_hypothesis(
    c: Candidate, field: str, shares: Sequence[float], motion: str, first: int, width: int = 1
) -> Candidate:
    span = {"motion": motion, "first": first, "last": first + width}
    return recast(ThresholdHypothesis, c, span | {"field": field, "shares": tuple(shares)})


def _vector(key: str, step: float) -> dict[str, float]:
    return {f"{key}.{axis}": step for axis in AXES}


def _joints(point: Point, problem: Problem) -> Iterator[Candidate]:
    model = point.base
    held = set(problem.locked.tolist())
    mass = np.diag(pin.crba(model.pin, model.pin.createData(), model.home))
    for group, wheel in ((model.arm_joints, False), (model.wheels, True)):
        for name, v in zip(group.names, group.v, strict=True):
            if int(v) in held:
                continue
            at: dict[str, Any] = {"joint": name}
            turning = turns(model.pin, model.pin.getJointId(name))
            rubs, width = partial(_one, "joint_friction", name), ["smoothing"]
            yield from rubs("viscous", at, {"viscous": 1e-3})
            yield from rubs("coulomb", at, {"coulomb": 1e-3}, width)
            for shape, simpler in SIMPLER.items():
                free = dict.fromkeys(fields_of(LAW_OF_SHAPE[shape]), 1e-3)
                yield from rubs(shape, at, free, simpler=simpler)
            curve = ["stribeck_rate", "stribeck_exponent"]
            yield from rubs("stribeck", at, {"coulomb": 1e-3, "stribeck": 1e-3}, curve)
            yield from _one("torque_gain", name, "torque constant", at, {"error": 1e-3})
            yield from _one("actuator_delay", name, "delay", {"actuator": name}, {"delay": 1e-3})
            if wheel:
                for c in rubs("stiction", at, {"stribeck": 1e-3}, curve, simpler=["coulomb"]):
                    yield _threshold_hypothesis(c, "stribeck_rate", STICKS, "v", int(v))
                for size in ("static", "dynamic"):
                    free = {size: 1e-4, "phase": 1e-2}
                    for c in _one("wheel_imbalance", name, f"{size} imbalance", {"wheel": name}, free):
                        yield recast(Imbalance, c, {"joint": model.pin.getJointId(name)})
                continue
            yield from rubs("load-dependent", at, {"load": 1e-3}, width)
            if turning:  # a place has no cosine
                by_place = {"position_cos": 1e-3, "position_sin": 1e-3}
                yield from rubs("position-dependent", at, by_place, width)
            yield from _one("joint_cable", name, "cable", at, {"stiffness": 1e-3}, ["rest"])
            none = at | {"inertia": 0.0}
            yield from _one("motor_inertia", name, "motor inertia", none, {"inertia": 1e-3})
            rotor = ROTOR * float(mass[v])
            prior, springy = {"motor_inertia": rotor}, {"compliance": 1e-8, "motor_inertia": 0.1 * rotor}
            if turning:  # else no link carries the rotor round
                prior["carried"], springy["carried"] = CARRIED, 0.1
            gear = at | {"quasistatic": True, "inertia_in_link": True, "prior": prior}
            yield from _one("gear_compliance", name, "compliance", gear, springy, ["damping"])
            crossing = ["turn_torque", "sharpness"]
            for c in _one("backlash", name, "backlash", gear, {"gap": 1e-6}, crossing):
                yield _threshold_hypothesis(c, "turn_torque", CROSSED, "tau", int(v))


def _bodies(point: Point, nominal: Sequence[Unknown]) -> Iterator[Candidate]:
    model = point.base
    by_body: dict[str, list[Unknown]] = {}
    for u in nominal:
        if u.kind == "inertial":
            by_body.setdefault(u.name.rpartition(".")[0], []).append(u)
    groups = (
        ("mass", INERTIAL_NAMES[:1]),
        ("centre of mass", INERTIAL_NAMES[1:4]),
        ("inertia", INERTIAL_NAMES[4:]),
    )
    for body, unknowns in by_body.items():
        for shape, labels in groups:
            if shape == "mass":  # of the whole body, as one that is denser than thought
                of = {"body": body, "density": 0.0}
                yield from _one("body_error", body, shape, of, {"density": 1e-3}, part="density")
                continue
            free = tuple(u.name for u in unknowns if u.name.rpartition(".")[2] in labels)
            steps = tuple(u.scale for u in unknowns if u.name in free)
            yield Candidate("body_error", body, "inertia", shape, None, free, steps)
    for arm in model.arms.values():
        last = int(arm.joints[-1])
        links = [f.name for f in model.pin.frames if f.parentJoint == last and f.type == pin.FrameType.BODY]
        frame = links[-1] if links else model.pin.names[last]  # the URDF's last link is the tool
        held = {"frame": frame, "mass": 0.0}
        yield from _one("payload", frame, "payload", held, {"mass": 1e-2}, COM)
    if model.free:
        bus = model.pin.frames[1].name if len(model.pin.frames) > 1 else "bus"
        where: dict[str, Any] = {"frame": next(iter(by_body), bus), "position": (0.0, 0.0, 0.0), "rate": 0.0}
        where["prior"] = {f"position.{axis}": 1.0 for axis in AXES}  # [m] about the bus frame
        free = {"rate": 1e-3, **_vector("position", 0.1)}
        for c in _one("mass_loss", where["frame"], "mass loss", where, free):
            yield recast(LeakHypothesis, c, {})


def _shift(
    kind: str, location: str, family: str, shape: str, names: Sequence[str], nominal: Sequence[Unknown]
) -> Iterator[Candidate]:
    by_name = {u.name: u for u in nominal}
    free = tuple(n for n in names if n in by_name)
    if free:
        yield Candidate(kind, location, family, shape, None, free, tuple(by_name[n].scale for n in free))


def _fuel(point: Point, nominal: Sequence[Unknown]) -> Iterator[Candidate]:
    for joints in point.base.slosh:
        effect = joints.tank
        n = effect.name
        springs = [f"{n}.stiffness.{a}" for a in AXES]
        dampers = [f"{n}.damping.{a}" for a in AXES]
        yield from _shift("slosh", n, "slosh", "frequency", springs, nominal)
        yield from _shift("slosh", n, "slosh", "damping", dampers, nominal)
        yield from _shift("slosh", n, "slosh", "mass", [f"{n}.mass"], nominal)
        hard = {"cubic": max(effect.stiffness)}
        drag = {"quadratic_damping": max(*effect.damping, 1e-3)}
        for law, suffix in (("radial", ""), ("per_axis", " per axis")):
            at = {"tank": n, "law": law}
            own = "" if law == "radial" else law  # an effect has one law
            for shape, free in ((f"cubic spring{suffix}", hard), (f"quadratic damping{suffix}", drag)):
                yield from _one("slosh_nonlinearity", n, shape, at, free, part=own)
        hard = {"stiffness": max(effect.stiffness)}
        for c in _one("slosh_wall", n, "wall", {"tank": n}, hard, ["gap"], "", ["cubic spring"]):
            yield _threshold_hypothesis(c, "gap", ROOM, "q", joints.q.start, 3)


def _panels(point: Point, nominal: Sequence[Unknown]) -> Iterator[Candidate]:
    for joints in point.base.appendages:
        part = joints.appendage
        modes = range(1, len(joints.joints) + 1)
        errors = [e for e in point.description.effect if e.in_modes and e.part_of() == part.name]
        known = {getattr(e, "mode", 0): e.name for e in errors}
        by_mode = {u.name for u in nominal if u.name.startswith(f"{part.name}.mode")}
        for k in modes:
            mode = {"appendage": part.name, "mode": k}
            for key in ("frequency", "damping"):
                shape = f"{key} of mode {k}"
                own = [f"{part.name}.mode{k}.{key}"]
                yield from _shift(part.kind, part.name, "appendage", shape, own, nominal)
                if k in known:
                    own = [f"{known[k]}.{key}"]
                    yield from _shift("mode_error", part.name, "appendage", shape, own, nominal)
                elif not by_mode:  # its own parameters move all modes together
                    yield from _one("mode_error", part.name, shape, mode, {key: 1e-3}, part=f"{k}")
            at = {**mode, "rate": 0.0}
            shape = f"drift of mode {k}"
            yield from _one("frequency_drift", part.name, shape, at, {"rate": 1e-4}, part=f"{k}")
        at = {"appendage": part.name}
        yield from _one("thermal_snap", part.name, "thermal snap", at, {"deflection": 1e-3})
        stiff = [f"{part.name}.youngs_modulus"]
        yield from _shift(part.kind, part.name, "appendage", "stiffness", stiff, nominal)
        yield from _shift(part.kind, part.name, "appendage", "damping", [f"{part.name}.damping"], nominal)
        at = {"appendage": part.name, "factor": 0.0}
        yield from _one("geometric_stiffness", part.name, "axial softening", at, {"factor": 1e-2})


def _further_modes(point: Point, nominal: Sequence[Unknown]) -> Iterator[Candidate]:
    """Modes that other effects add to appendages, not as described."""
    for effect in point.description.effect:
        if effect.nominal and len(effect.strength) == 1:
            for shape, key in (
                ("size", effect.strength[0]),
                ("frequency", "frequency"),
                ("damping", "damping"),
            ):
                names = [f"{effect.name}.{key}"]
                yield from _shift(effect.kind, effect.name, "appendage", shape, names, nominal)


def _outside(point: Point, problem: Problem) -> Iterator[Candidate]:
    model = point.base
    if not model.free:
        return
    flown = [p.recording for p in recordings_of(problem)]
    if any("command.force" in r and np.asarray(r["command.force"]).any() for r in flown):
        yield from _one("thruster_gain", "thruster", "gain", {}, _vector("gain", 1e-3))
        yield from _one("thruster_misalignment", "thruster", "misalignment", {}, _vector("angles", 1e-3))
        late = {"actuator": "thruster"}
        yield from _one("actuator_delay", "thruster", "delay", late, {"delay": 1e-3})
    for k, thruster in enumerate(point.description.thruster):
        if any(np.asarray(r[c])[:, k].any() for c in SINGLE for r in flown if c in r):
            name, own = thruster.name, {"thruster": thruster.name}
            along = int(np.argmax(np.abs(thruster.direction)))  # turned about itself, it pushes as before
            across = {f"angles.{a}": 1e-3 for i, a in enumerate(AXES) if i != along}
            yield from _one("thruster_gain", name, "gain", own, {"gain": 1e-3})
            yield from _one("thruster_misalignment", name, "misalignment", own, across)
            yield from _one("actuator_delay", name, "delay", {"actuator": name}, {"delay": 1e-3})
    for frame in ("body", "inertial"):
        at = {"frame": frame}
        for what in ("force", "torque"):
            shape, free = f"{what}, {frame}", _vector(what, 1e-4)
            yield from _one("external_wrench", "bus", shape, at, free, part=frame)
    orbit: dict[str, Any] = {"gradient": 0.0, "prior": {f"turn.{axis}": 1.0 for axis in AXES}}
    free = {"gradient": 1e-8, **_vector("turn", 1e-2)}
    for c in _one("gravity_gradient", "spacecraft", "gravity gradient", orbit, free):
        yield recast(GravityGradientHypothesis, c, {})


def _sensors(point: Point, problem: Problem) -> Iterator[Candidate]:
    names = {b.channel: b for b in problem.data.blocks}
    for sensor in point.description.sensor:
        here = [q for q in sensor.quantities if f"{sensor.name}.{q}" in names]
        if not here:
            continue
        for q in here:
            at: dict[str, Any] = {"sensor": sensor.name, "quantity": q}
            where = f"{sensor.name}.{q}"
            sigma = float(np.max(problem.data.sigma[names[where].rows]))
            if q in VECTORS:
                yield from _one("sensor_bias", where, "bias", at, _vector("bias", sigma))
            if q in VECTORS and q != "attitude":  # turned axes of which are, to first order, such a bias
                yield from _one("sensor_scale", where, "scale", at, _vector("error", 1e-3))
                yield from _one("sensor_misalignment", where, "misalignment", at, _vector("angles", 1e-3))
            if q == "angular_rate":
                bent = _vector("slope", 1e-3)
                yield from _one("scale_by_rate", where, "scale by rate", at, bent, simpler=["scale"])
            group = point.base.wheels if q == "wheel_rate" else point.base.arm_joints
            for label in () if q in VECTORS else group.names:
                own, place = at | {"component": label}, f"{where}[{label}]"
                yield from _one("sensor_bias", place, "bias", own | {"bias": 0.0}, {"bias": sigma})
                yield from _one("sensor_scale", place, "scale", own | {"error": 0.0}, {"error": 1e-4})
                if q != "joint_position":
                    own = own | {"slope": 0.0}
                    bent = {"slope": 1e-4}
                    yield from _one("scale_by_rate", place, "scale by rate", own, bent, simpler=["scale"])
            if len(here) > 1:
                yield from _one("sensor_delay", where, "delay", at, {"delay": 1e-3})
        # of a sensor with one channel a delay is the same, but for its sign
        own = {"sensor": sensor.name}
        yield from _one("time_offset", sensor.name, "time offset", own, {"offset": 1e-3})
        if sensor.kind in ("pose", "imu") and point.base.free:
            own = own | {"prior": {f"offset.{a}": ABOUT for a in "xyz"}}
            yield from _one("lever_arm", sensor.name, "lever arm", own, _vector("offset", 1e-3))


def _users(point: Point) -> Iterator[Candidate]:
    for cls in catalogue().values():
        own = getattr(cls, "candidates", None)
        if own is not None:
            yield from own(point.base)


SLOSH = (0.03, 1.0)  # [Hz] between which a tank's frequency is looked for
MODE = (0.08, 3.0)  # [Hz] the same of a bending mode
RATIO = 1.13  # of neighbours in the grid
CYCLES = 1.5  # least number of them in a recording
CENTRE = 0.7265  # of a uniform cantilever's first mode: where its moving mass sits, in lengths
MOST_MODES = 20  # of a beam
FURTHER = 2  # of them that are looked for
PER_CYCLE = 5.0  # least number of samples


def more_slosh(point: Point, problem: Problem) -> Iterator[OscillatorHypothesis]:
    """Yield the candidate of one more slosh mass in the bus."""
    model = point.base
    if not model.free:
        return
    springs = AddedOscillatorHypothesis(np.zeros(3), np.eye(3), np.eye(3))
    name = _unused_name(point, "slosh_more")
    grid = _grid(problem, SLOSH)
    yield OscillatorHypothesis(
        "slosh", body_names(model.pin)[0], "slosh", "another slosh mass", None, (), (),
        name=name, springs=springs, frequencies=grid,
    )  # fmt: skip


def more_modes(point: Point, problem: Problem) -> Iterator[OscillatorHypothesis]:
    """Yield the candidate of one more mode of every appendage of the bus, that bends as its first does."""
    model = point.base
    for joints in model.appendages:
        part: Appendage = joints.appendage
        if not model.free or joints.parent != 1:
            continue
        bending = [m for m in part.modal_data() if np.linalg.norm(m.translation) > 0.0]
        if not bending:
            continue
        along = np.asarray(bending[0].translation)
        size = float(np.linalg.norm(along))
        # anywhere along it: half its length, give or take a uniform distribution's standard deviation
        whole = np.cross(along, np.asarray(bending[0].rotation)) / size**2 / CENTRE
        rest = 0.5 * whole
        turn, root = joints.placement.rotation, joints.placement.translation
        across = [k for k in range(3) if k != int(np.argmax(np.abs(along)))]
        springs = AddedOscillatorHypothesis(
            root + turn @ rest,
            (turn @ along / size)[None],
            np.array([turn[:, k] for k in across]),
            spread=max(float(np.linalg.norm(whole)), 0.1) / np.sqrt(12.0),
        )
        yield OscillatorHypothesis(
            "extra_mode", part.name, "appendage", "another mode", None, (), (),
            name=_unused_name(point, f"{part.name}_more"), springs=springs, frequencies=_grid(problem, MODE),
            appendage=part.name, turn=turn.T, root=root,
        )  # fmt: skip


def higher_modes(point: Point, problem: Problem) -> Iterator[HigherMode]:
    """Yield the candidates of every beam's next modes, where accelerometers on it would see them."""
    model = point.base
    seen = {s.appendage for s in point.description.effective_sensors() if s.kind == "accelerometers"}
    rate = 1.0 / float(np.median(np.diff(problem.data.times)))
    for joints in model.appendages:
        beam: Appendage = joints.appendage
        if not (beam.name in seen and model.free and joints.parent == 1):
            continue
        further = (e for e in point.description.effect if e.needs_beam and e.part_of() == beam.name)
        has = {getattr(e, "mode", 0) for e in further}
        missing = [n for n in range(len(joints.joints) + 1, MOST_MODES + 1) if n not in has]
        for number in missing[:FURTHER]:
            mode = beam.higher_mode(number)
            if mode is None:
                break
            name = _unused_name(point, f"beam_mode_{beam.name}_{number}")
            candidate = HigherMode.of(beam.name, mode, joints.placement, number, name)
            if candidate.highest * PER_CYCLE < rate:
                yield candidate


def _unused_name(point: Point, name: str) -> str:
    taken = {e.name for e in point.description.effect}
    return next(n for n in (name, *(f"{name}{k}" for k in range(2, 99))) if n not in taken)


def _grid(problem: Problem, band: tuple[float, float]) -> tuple[float, ...]:
    """Return frequencies [Hz] of a band that the recording is long and dense enough for."""
    times = problem.data.times
    low = max(band[0], CYCLES / float(times[-1] - times[0]))
    high = min(band[1], 1.0 / (PER_CYCLE * float(np.median(np.diff(times)))))
    count = max(2, int(np.ceil(np.log(max(high / low, 1.01)) / np.log(RATIO))))
    return tuple(float(f) for f in np.geomspace(low, max(high, 1.01 * low), count))
