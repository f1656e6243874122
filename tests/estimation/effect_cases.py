"""Flights of MuJoCo worlds that hide one listed effect each, and what the description says of it.

The truth is that of `tests.hidden`, or a law in a few lines here; nothing of smsid moves anything.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from smsid.description import load_description
from smsid.description.schema import Description
from smsid.effects.base import parse_effect
from smsid.estimation.identify_flights import FlightEstimate, identify_flights
from smsid.recording import Recording
from tests.hidden.body_effects import LEAK
from tests.hidden.catalogue import nameable_effects
from tests.hidden.description import write_description
from tests.hidden.experiment import commands
from tests.hidden.flight import recording
from tests.hidden.joint_effects import ROUGH_STEP
from tests.hidden.numbers import WORLDS, draw, nominal
from tests.hidden.plant import Change, Force, Plant

LENGTH = 40.0  # [s] of a flight
SMOOTH = 0.005  # [rad/s] of the catalogue's Coulomb torque
WIDE = 3.0  # times the hidden value: the prior's standard deviation


@dataclass(frozen=True)
class EffectCase:
    """One effect in one world.

    ``change`` gives what is hidden, at a sign; ``table`` is the ``[[effect]]`` before the flight, without
    priors, ``truth`` the hidden values by parameter (at the sign plus), ``prior`` standard deviations of what
    has another one than `WIDE` times its hidden value. Signs are drawn where ``signed``.
    """

    kind: str
    change: Callable[[float], Change]
    table: Mapping[str, Any]
    truth: Mapping[str, float]
    prior: Mapping[str, float] = field(default_factory=dict)
    world: str = "rigid"
    signed: bool = False
    label: str = ""

    @property
    def name(self) -> str:
        """Unique: kind, and what tells it from others of its kind."""
        return f"{self.kind}{f' {self.label}' if self.label else ''}"


@dataclass(frozen=True)
class HiddenFlight:
    """A description that lists the effect, the recording, priors of bodies, and the truth by name."""

    description: Description
    recording: Recording
    cad: dict[str, tuple[float, float]]
    truth: dict[str, float]


def fly(case: EffectCase, seed: int, folder: Path, *, priors: bool = True) -> HiddenFlight:
    """Draw the world's numbers, fly it with the effect, and describe it with the effect listed."""
    n, rng = WORLDS[case.world], np.random.default_rng([seed, 51])
    true = draw(n, rng)
    sign = float(rng.choice([-1.0, 1.0])) if case.signed else 1.0
    made = recording(true, commands(case.world, 0, LENGTH), rng, [case.change(sign)], name=case.kind)
    folder.mkdir(parents=True, exist_ok=True)
    description = load_description(write_description(n, folder))
    stated = {p.name: p for p in nominal(n)}
    prior = {k: WIDE * abs(v) for k, v in case.truth.items() if v} | dict(case.prior)
    table = {"kind": case.kind, "name": "cause", **case.table}
    listed = parse_effect({**table, "prior": prior} if priors else table)
    effects = [_with_priors(e, stated) for e in description.effect]
    description = description.model_copy(update={"effect": (*effects, listed)})
    cad = {k: (p.value, p.sigma) for k, p in stated.items() if k.split(".")[0] in n.body}
    truth = {f"cause.{k}": sign * v for k, v in case.truth.items()}
    return HiddenFlight(Description.model_validate(dict(description)), made, cad, truth)


def identified(flight: HiddenFlight) -> FlightEstimate:
    """Return what the flight tells."""
    return identify_flights(flight.description, [flight.recording], cad=flight.cad)


def deviations(flight: HiddenFlight, found: FlightEstimate) -> dict[str, float]:
    """Return by how many standard deviations each of the effect's parameters is off, by name."""
    return {
        n: (found.estimate[n].value - v) / max(found.estimate[n].sigma, 1e-300)
        for n, v in flight.truth.items()
    }


def _with_priors(effect, stated):
    own = {p.name.removeprefix(f"{effect.name}."): stated.get(p.name) for p in effect.parameters()}
    return effect.model_copy(update={"prior": {k: p.sigma for k, p in own.items() if p is not None}})


def _hidden(world: str, name: str, value: float) -> Callable[[float], Change]:
    effect = nameable_effects(world)[name]
    return lambda sign: effect.make(sign * value, None, np.random.default_rng(0))


def _torque(joint: str, law: Callable[[float, float, float], float]) -> Callable[[float], Change]:
    """Return a torque ``law(angle, rate, motor torque)`` at a joint or wheel."""

    def make(plant: Plant) -> Force:
        iq, iv, out = plant.q_of(joint), plant.v_of(joint), plant.passive
        motor = plant.ctrl_of[iv]

        def force() -> None:
            out[iv] += law(plant.qpos[iq], plant.qvel[iv], plant.ctrl[motor])

        return force

    return lambda sign: Change(force=make, step=ROUGH_STEP)


def _coupled(viscous: float, coulomb: float) -> Callable[[float], Change]:
    def make(plant: Plant) -> Force:
        a, b = (plant.v_of(j) for j in ("joint2", "joint3"))
        out = plant.passive

        def force() -> None:
            rate = plant.qvel[a] + plant.qvel[b]
            torque = viscous * rate + coulomb * np.tanh(rate / SMOOTH)
            out[a] -= torque
            out[b] -= torque

        return force

    return lambda sign: Change(force=make, step=ROUGH_STEP)


def _wall(tank: str, gap: float, stiffness: float) -> Callable[[float], Change]:
    """Return a tank in whose wall the slosh mass sinks as into a spring, beyond ``gap`` from its rest."""

    def make(plant: Plant) -> Force:
        iq, iv = plant.q_of(f"{tank}.x"), plant.v_of(f"{tank}.x")

        def force() -> None:
            x = plant.qpos[iq : iq + 3]
            far = np.linalg.norm(x)
            plant.passive[iv : iv + 3] -= stiffness * max(far - gap, 0.0) * x / max(far, 1e-12)

        return force

    return lambda sign: Change(force=make)


def _bent_scale(channel: str, column: int, slope: float) -> Callable[[float], Change]:
    """Return a rate that is read larger the faster it is: ``1 + slope |x|`` times."""

    def read(t: np.ndarray, x: np.ndarray) -> np.ndarray:
        x = np.array(x)
        x[:, column] *= 1.0 + slope * np.abs(x[:, column])
        return x

    return lambda sign: Change(ideal=((channel, read),))


def _encoder_zero(angle: float) -> Callable[[float], Change]:
    off = np.array([0.0, angle, 0.0])
    return lambda sign: Change(ideal=(("encoder.joint_position", lambda t, x: x - sign * off),))


def _xyz(name: str, axis: str, value: float) -> dict[str, float]:
    return {f"{name}.{a}": value if a == axis else 0.0 for a in "xyz"}


def _vector(name: str, values) -> dict[str, float]:
    return {f"{name}.{a}": float(v) for a, v in zip("xyz", values, strict=True)}


def _even(name: str, sigma: float) -> dict[str, float]:
    return {f"{name}.{a}": sigma for a in "xyz"}


def _friction(joint: str, label: str, law, truth, prior=None) -> EffectCase:
    given: dict[str, Any] = {"joint": joint, "smoothing": SMOOTH}
    shape = ("stribeck_rate", "stribeck_exponent")
    given["known"] = tuple(k for k in shape if k not in truth)
    return EffectCase(
        "joint_friction", _torque(joint, law), given, truth, prior or {}, label=f"{label} {joint}"
    )


DOWN = np.array([np.cos(0.8), np.sin(0.8), 0.3]) / np.sqrt(1.09)
AHEAD = np.array([np.sin(0.8), -np.cos(0.8), 0.0])
FORCE, TORQUE = np.array([0.6, -0.5, 0.62]), np.array([-0.4, 0.7, 0.59])
GYRO = {"sensor": "imu", "quantity": "angular_rate"}


def cases() -> list[EffectCase]:
    """Return one case or more for every kind of effect that a spacecraft may have and a flight can show."""
    c = EffectCase
    beam = {"appendage": "panel"}
    return [
        c("actuator_delay", _hidden("rigid", "actuator_delay:delay@thruster", 2e-3), {}, {"delay": 2e-3}),
        c("actuator_delay", _hidden("rigid", "actuator_delay:delay@wheel_z", 1e-3),
          {"actuator": "wheel_z"}, {"delay": 1e-3}, label="wheel"),
        c("torque_gain", _hidden("rigid", "torque_gain:error@joint2", 1e-3), {"joint": "joint2"},
          {"error": 1e-3}, signed=True),
        c("torque_gain", _hidden("rigid", "torque_gain:error@wheel_z", 1e-3), {"joint": "wheel_z"},
          {"error": 1e-3}, signed=True, label="wheel"),
        c("thruster_gain", _hidden("rigid", "thruster_gain:gain.x@thruster", 0.03), {},
          _xyz("gain", "x", 0.03), _even("gain", 0.05), signed=True),
        c("thruster_misalignment", _hidden("rigid", "thruster_misalignment:angles.y@thruster", 0.03), {},
          _xyz("angles", "y", 0.03), _even("angles", 0.05), signed=True),
        c("external_wrench", _hidden("rigid", "external_wrench:force@bus_body", 0.05), {},
          _vector("force", 0.05 * FORCE) | _vector("torque", np.zeros(3)),
          _even("force", 0.1) | _even("torque", 0.1), label="body"),
        c("external_wrench", _hidden("rigid", "external_wrench:torque@bus_inertial", 0.02),
          {"frame": "inertial"}, _vector("torque", 0.02 * TORQUE) | _vector("force", np.zeros(3)),
          _even("force", 0.1) | _even("torque", 0.1), label="inertial"),
        c("gravity_gradient", _hidden("rigid", "gravity_gradient:rate@bus", 2e-3),
          {"gradient": 0.0, "nadir": tuple(DOWN), "normal": tuple(np.cross(DOWN, AHEAD)), "known": ("turn",)},
          {"gradient": 4e-6}),
        _friction("joint2", "viscous and Coulomb", lambda q, v, u: -0.05 * v - 0.01 * np.tanh(v / SMOOTH),
                  {"viscous": 0.05, "coulomb": 0.01, "stribeck": 0.0, "load": 0.0, "position_cos": 0.0,
                   "position_sin": 0.0},
                  {"stribeck": 0.01, "load": 0.01, "position_cos": 0.01, "position_sin": 0.01}),
        _friction("joint2", "Stribeck",
                  lambda q, v, u: -(0.02 + 0.03 * np.exp(-((v / 0.03) ** 2))) * np.tanh(v / SMOOTH),
                  {"viscous": 0.0, "coulomb": 0.02, "stribeck": 0.03, "stribeck_rate": 0.03},
                  {"viscous": 0.05, "stribeck_rate": 0.02}),
        _friction("joint2", "load", lambda q, v, u: -0.01 * abs(u) * np.tanh(v / SMOOTH), {"load": 0.01},
                  {"viscous": 0.05}),
        _friction("joint2", "by angle", lambda q, v, u: -0.02 * np.cos(q - 0.5) * np.tanh(v / SMOOTH),
                  {"position_cos": 0.02 * np.cos(0.5), "position_sin": 0.02 * np.sin(0.5)}),
        _friction("joint2", "quadratic", lambda q, v, u: -0.5 * v * abs(v), {"quadratic": 0.5}),
        _friction("joint2", "by direction",
                  lambda q, v, u: -0.05 * abs(v) - 0.01 * np.tanh(abs(v) / SMOOTH),
                  {"viscous_direction": 0.05, "coulomb_direction": 0.01}),
        _friction("wheel_z", "viscous and Coulomb", lambda q, v, u: -2e-4 * v - 1e-3 * np.tanh(v / SMOOTH),
                  {"viscous": 2e-4, "coulomb": 1e-3}),
        c("motor_inertia", _hidden("rigid", "motor_inertia:inertia@joint2", 0.5),
          {"joint": "joint2", "inertia": 0.0}, {"inertia": 0.5}),
        _friction("wheel_z", "stiction",
                  lambda q, v, u: -0.05 * np.exp(-((v / 0.5) ** 2)) * np.tanh(v / SMOOTH),
                  {"stribeck": 0.05, "stribeck_rate": 0.5}, {"coulomb": 0.05, "viscous": 1e-3}),
        c("motor_coupling", _coupled(0.05, 0.01), {"joints": ("joint2", "joint3")},
          {"viscous": 0.05, "coulomb": 0.01, "inertia": 0.0}, {"inertia": 0.1}),
        c("torque_offset", _torque("joint2", lambda q, v, u: -0.02), {"joint": "joint2"}, {"torque": 0.02}),
        c("joint_cable", _torque("joint2", lambda q, v, u: -0.5 * (q - 0.2)), {"joint": "joint2"},
          {"stiffness": 0.5, "rest": 0.2}, {"rest": 0.5}),
        c("joint_offset", _encoder_zero(2e-3), {"joint": "joint2", "angle": 0.0}, {"angle": 2e-3},
          signed=True),
        c("wheel_imbalance", _hidden("rigid", "wheel_imbalance:static@wheel_z", 5e-3), {"wheel": "wheel_z"},
          {"static": 5e-3}, {"dynamic": 1e-3, "phase": 1.0}),
        c("payload", _hidden("rigid", "payload:mass@tool", 2.0), {"frame": "tool", "mass": 0.0},
          {"mass": 2.0, "com.x": 0.05, "com.y": 0.08, "com.z": -0.06}, _even("com", 0.1)),
        c("body_error", _hidden("rigid", "body_error:inertia.yy@link3", 1.0), {"body": "link3"},
          {"inertia.yy": 1.0}, signed=True),
        c("mass_loss", _hidden("rigid", "mass_loss:rate@bus", 0.05), {"rate": 0.0, "position": tuple(LEAK)},
          {"rate": 0.05}, _even("position", 0.1)),
        c("sensor_bias", _hidden("rigid", "sensor_bias:bias.x@imu.angular_rate", 2e-4), GYRO,
          _xyz("bias", "x", 2e-4), _even("bias", 1e-3), signed=True),
        c("sensor_bias", _hidden("rigid", "sensor_bias:bias@tachometer.wheel_rate[wheel_x]", 0.5),
          {"sensor": "tachometer", "quantity": "wheel_rate", "component": "wheel_x", "bias": 0.0},
          {"bias": 0.5}, signed=True, label="wheel"),
        c("sensor_scale", _hidden("rigid", "sensor_scale:scale.y@imu.angular_rate", 0.01), GYRO,
          _xyz("error", "y", 0.01), _even("error", 0.03), signed=True),
        c("sensor_scale", _hidden("rigid", "sensor_scale:scale@tachometer.wheel_rate[wheel_x]", 0.01),
          {"sensor": "tachometer", "quantity": "wheel_rate", "component": "wheel_x", "error": 0.0},
          {"error": 0.01}, signed=True, label="wheel"),
        c("scale_by_rate", _bent_scale("tachometer.wheel_rate", 0, 1e-4),
          {"sensor": "tachometer", "quantity": "wheel_rate", "component": "wheel_x", "slope": 0.0},
          {"slope": 1e-4}),
        c("sensor_misalignment", _hidden("rigid", "sensor_misalignment:angles.z@imu.angular_rate", 0.01),
          GYRO, _xyz("angles", "z", 0.01), _even("angles", 0.03), signed=True),
        c("sensor_delay", _hidden("rigid", "sensor_delay:delay@imu.angular_rate", 5e-3), GYRO,
          {"delay": 5e-3}),
        c("time_offset", _hidden("rigid", "time_offset:offset@pose", 0.01), {"sensor": "pose"},
          {"offset": 0.01}, signed=True),
        c("lever_arm", _hidden("rigid", "lever_arm:offset.y@imu", 0.03), {"sensor": "imu"},
          _xyz("offset", "y", 0.03), _even("offset", 0.1), signed=True),
        c("slosh_nonlinearity", _hidden("sms", "slosh_nonlinearity:cubic@tank", 8.0),
          {"tank": "tank", "law": "per_axis"}, {"cubic": 8.0, "quadratic_damping": 0.0},
          {"quadratic_damping": 20.0}, world="sms"),
        c("slosh_nonlinearity", _hidden("sms", "slosh_nonlinearity:quadratic_damping@tank", 20.0),
          {"tank": "tank", "law": "per_axis"}, {"quadratic_damping": 20.0, "cubic": 0.0}, {"cubic": 20.0},
          world="sms", label="damping"),
        c("slosh_wall", _wall("tank", 0.15, 5.0), {"tank": "tank", "gap": 0.14},
          {"gap": 0.15, "stiffness": 5.0}, world="sms"),
        c("geometric_stiffness", _hidden("panel", "geometric_stiffness:factor@panel", 1.0),
          {**beam, "factor": 0.0}, {"factor": 1.0}, world="panel"),
        c("frequency_drift", _hidden("panel", "frequency_drift:rate@panel", 5e-4), beam, {"rate": 5e-4},
          world="panel"),
    ]  # fmt: skip


def by_name() -> dict[str, EffectCase]:
    """Return all cases by name."""
    return {c.name: c for c in cases()}
