"""An arm on the ground as MuJoCo has it: measured angles and torques, with something hidden in them.

Friction and the rest are not the catalogue's: hard signs, other curves, delays by interpolation. Noise is
coloured and larger while the arm moves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from scipy.signal import lfilter

from smsid.description import Description
from smsid.recording import Recording

JOINTS = ("joint1", "joint2", "joint3")
RATE = 200.0
NOISE = 1.0  # [N m] of the torque signal
ENCODER = 2.0 * np.pi / 2**20  # [rad]
FORCE = 100.0  # [N m] typical

Hidden = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Torques (N, 3) that the motors give beyond the links', from angles, rates, accelerations and the links'."""


def described() -> Description:
    folder = Path(__file__).parents[2] / "urdf"
    return Description(name="arm", urdf="arm3.urdf", folder=folder, root="fixed", gravity=(0.0, 3.0, -9.0))


def motion(seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Times (N,), angles, rates and accelerations (N, 3)."""
    t = np.arange(0.0, seconds, 1.0 / RATE)
    omega = 2 * np.pi * np.array([0.11, 0.23, 0.41, 0.67, 0.97])
    phase, size = rng.uniform(0, 2 * np.pi, (3, 5, 1)), rng.uniform(0.15, 0.5, (3, 5, 1))
    arg = omega[:, None] * t + phase
    q = np.sum(size * np.sin(arg), axis=1).T
    v = np.sum(size * omega[:, None] * np.cos(arg), axis=1).T
    a = -np.sum(size * omega[:, None] ** 2 * np.sin(arg), axis=1).T
    return t, q, v, a


def recorded(
    hidden: Hidden | None = None,
    *,
    seed: int = 0,
    seconds: float = 20.0,
    payload: float = 0.0,
    turned: tuple[int, float] | None = None,
    late: float = 0.0,
    gain: tuple[int, float] | None = None,
    noise: float = NOISE,
    gravity: Sequence[float] | np.ndarray | None = None,
    name: str = "arm",
    role: str = "estimation",
) -> Recording:
    """Return a recording of an arm that is not quite as described.

    Args:
        hidden: torques beyond the links'.
        seed: of motion and noise.
        seconds: how long.
        payload: mass at the tool [kg].
        turned: a joint and by how much its encoder's zero is off [rad].
        late: by how much the torque signal lags the angles [s].
        gain: a joint and the factor of its torque signal.
        noise: standard deviation of the torque signal [N m].
        gravity: (3,) in the axes of its base [m/s^2]; by default as described.
        name: of the recording.
        role: of the recording.
    """
    rng = np.random.default_rng(seed)
    arm = described()
    spec = mujoco.MjSpec.from_file(str(arm.folder / arm.urdf))
    spec.option.gravity = list(arm.gravity if gravity is None else gravity)
    if payload:
        held = spec.bodies[-1].add_body(name="held", pos=[0.0, 0.0, 0.0])
        held.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], mass=payload)
    model = spec.compile()
    t, q, v, a = motion(seconds, rng)
    torque, data = np.empty_like(q), mujoco.MjData(model)
    for k in range(len(t)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse
    if hidden is not None:
        torque = torque + hidden(q, v, a, torque)
    if gain is not None:
        torque[:, gain[0]] *= gain[1]
    if late:
        torque = np.column_stack([np.interp(t - late, t, x) for x in torque.T])
    white = rng.normal(size=torque.shape)
    coloured = lfilter([np.sqrt(1 - 0.8**2)], [1.0, -0.8], white, axis=0)
    moving = 0.5 + np.abs(v) / np.sqrt(np.mean(v**2, axis=0))
    torque = torque + noise * moving * coloured
    angles = q.copy()
    if turned is not None:
        angles[:, turned[0]] -= turned[1]
    angles = np.round(angles / ENCODER) * ENCODER
    return Recording.from_arrays(
        t,
        {"encoder.joint_position": angles, "encoder.joint_torque": torque},
        labels={"joint": JOINTS},
        name=name,
        role=role,
    )


def on(joint: int, torque: Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]) -> Hidden:
    """Return what acts on one joint only, from its own angle, rate, acceleration and the links' torque."""

    def hidden(q: np.ndarray, v: np.ndarray, a: np.ndarray, links: np.ndarray) -> np.ndarray:
        out = np.zeros_like(q)
        out[:, joint] = torque(q[:, joint], v[:, joint], a[:, joint], links[:, joint])
        return out

    return hidden


def coupled(first: int, second: int, viscous: float, coulomb: float) -> Hidden:
    """Return a motor that turns with the sum of two joints."""

    def hidden(q: np.ndarray, v: np.ndarray, a: np.ndarray, links: np.ndarray) -> np.ndarray:
        rate = v[:, first] + v[:, second]
        both = viscous * rate + coulomb * np.sign(rate)
        out = np.zeros_like(q)
        out[:, first] = out[:, second] = both
        return out

    return hidden


def dahl(joint: int, size: float, stiffness: float) -> Hidden:
    """Return Dahl's hysteresis on one joint: outside the catalogue."""

    def hidden(q: np.ndarray, v: np.ndarray, a: np.ndarray, links: np.ndarray) -> np.ndarray:
        out = np.zeros_like(q)
        z = 0.0
        for k, rate in enumerate(v[:, joint]):
            z += stiffness * rate * (1.0 - np.sign(rate) * z / size) / RATE
            out[k, joint] = z
        return out

    return hidden


def _stribeck(v: np.ndarray) -> np.ndarray:
    return (5.0 + 10.0 / (1.0 + (v / 0.08) ** 2)) * np.sign(v)


@dataclass(frozen=True)
class Case:
    """One hidden effect and what names are right: ``(effect, location)``; none outside the catalogue.

    ``family`` may be named where the effect is outside the catalogue; ``known`` asks for an estimate made
    before, without which links take the effect up. ``parameter`` is the name's ending and its true value.
    """

    make: Callable[[float, int], Recording]
    effect: str | None
    location: str = ""
    family: str = ""
    parameter: tuple[str, float] | None = None
    known: bool = False


def _hides(hidden: Callable[[float], Hidden]) -> Callable[[float, int], Recording]:
    return lambda size, seed: recorded(hidden(size), seed=seed)


CASES: dict[str, Case] = {
    "viscous": Case(
        _hides(lambda s: on(1, lambda q, v, a, load: 5.0 * s * v)),
        "joint_friction", "joint2", parameter=("viscous", 5.0),
    ),
    "coulomb": Case(
        _hides(lambda s: on(2, lambda q, v, a, load: 5.0 * s * np.sign(v))),
        "joint_friction", "joint3", parameter=("coulomb", 5.0),
    ),
    "rotor": Case(
        _hides(lambda s: on(2, lambda q, v, a, load: 3.0 * s * a)),
        "motor_inertia", "joint3", parameter=("inertia", 3.0),
    ),
    "bias": Case(
        _hides(lambda s: on(1, lambda q, v, a, load: 5.0 * s + 0.0 * q)),
        "torque_offset", "joint2", parameter=("torque", 5.0),
    ),
    "cable": Case(  # at rest in the middle of the motion: elsewhere it is one with a constant torque
        _hides(lambda s: on(1, lambda q, v, a, load: 5.0 * s * (q - q.mean()))),
        "joint_cable", "joint2", parameter=("stiffness", 5.0),
    ),
    "load": Case(
        _hides(lambda s: on(1, lambda q, v, a, load: 0.02 * s * np.abs(load) * np.sign(v))),
        "joint_friction", "joint2", parameter=("load", 0.02),
    ),
    "position": Case(
        _hides(lambda s: on(1, lambda q, v, a, load: 5.0 * s * np.sin(q) * np.sign(v))),
        "joint_friction", "joint2", parameter=("position_sin", 5.0),
    ),
    "stribeck": Case(
        _hides(lambda s: on(1, lambda q, v, a, load: s * _stribeck(v))),
        "joint_friction", "joint2",
    ),
    "coupling": Case(
        _hides(lambda s: coupled(1, 2, 5.0 * s, 4.0 * s)),
        "motor_coupling", "joint2 + joint3", parameter=("viscous", 5.0),
    ),
    "late torques": Case(
        lambda s, seed: recorded(seed=seed, late=0.004 * s),
        "time_offset", "encoder", parameter=("offset", -0.004),
    ),
    "zero": Case(
        lambda s, seed: recorded(seed=seed, turned=(1, 0.01 * s)),
        "joint_offset", "joint2", parameter=("angle", 0.01),
    ),
    "gain": Case(
        lambda s, seed: recorded(seed=seed, gain=(1, 1.0 / (1.0 - 0.01 * s))),
        "torque_gain", "joint2", parameter=("error", -0.01), known=True,
    ),
    "payload": Case(
        lambda s, seed: recorded(seed=seed, payload=1.0 * s),
        "payload", "tool", parameter=("mass", 1.0), known=True,
    ),
    "ripple": Case(_hides(lambda s: on(1, lambda q, v, a, load: 10.0 * s * np.sin(7 * q))), None, "joint2"),
    "hysteresis": Case(
        lambda s, seed: recorded(dahl(2, 15.0 * s, 150.0 * s), seed=seed), None, "joint3", "friction"
    ),
    "drag": Case(
        _hides(lambda s: on(1, lambda q, v, a, load: 10.0 * s * v * np.abs(v))),
        "joint_friction", "joint2", parameter=("quadratic", 10.0),
    ),
    "cubic drag": Case(
        _hides(lambda s: on(1, lambda q, v, a, load: 10.0 * s * v**3)),
        "joint_friction", "joint2", parameter=("cubic", 10.0),
    ),
    "direction": Case(
        _hides(lambda s: on(1, lambda q, v, a, load: 8.0 * s * np.abs(v))),
        "joint_friction", "joint2", parameter=("viscous_direction", 8.0),
    ),
}  # fmt: skip
"""What can be hidden, by name; made from a size (about 1) and a seed."""
