"""Hidden effects of joints and wheels: friction, drivetrain, and three that no catalogue has.

Shapes differ on purpose from the catalogue's: the sign is smoothed by a root, Stribeck friction falls as a
Lorentz curve.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .effect import Hidden, after, plain
from .mjcf import WHEEL_MASS
from .numbers import JOINTS, ROTOR, WHEELS, Drivetrain, Numbers
from .plant import Change, Force, Plant

ROUGH = 0.003  # rate at which the smoothed sign turns [rad/s]
ROUGH_STEP = 2.5e-3  # [s]
SHAPES = {
    "viscous": ("viscous",),
    "coulomb": ("coulomb",),
    "stribeck": ("stribeck",),
    "load": ("load-dependent",),
    "position_cos": ("position-dependent",),
}
STIFF = 1.2e-3  # [s] of rotor and spring: below it the spring has no dynamics of its own


def joint_effects(n: Numbers) -> list[Hidden]:
    """Everything that may be hidden at the joints and wheels of a world."""
    found: list[Hidden] = []
    for joint in JOINTS:
        found += [
            _friction(joint, "viscous", "N m s/rad", 6e-4, viscous, cap=8.0),
            _friction(joint, "coulomb", "N m", 7e-5, coulomb, cap=2.0),
            _friction(joint, "stribeck", "N m", 5e-5, stribeck, cap=2.0, beside=(coulomb,)),
            _friction(joint, "load", "1", 3e-6, load, cap=0.2),
            _friction(
                joint, "position_cos", "N m", 7e-5, position, cap=2.0, signed=True, beside=(quarter_on,)
            ),
            Hidden(
                "motor_inertia",
                ("drivetrain",),
                joint,
                "inertia",
                "kg m^2",
                plain(lambda x, j=joint: Change(numbers=lambda n: _armature(n, j, x))),
                0.02,
                cap=20.0,
            ),
            Hidden(
                "backlash",
                ("drivetrain",),
                joint,
                "gap",
                "rad",
                plain(lambda x, j=joint: _backlash(j, x)),
                4e-6,
                cap=0.02,
            ),
            _outside(joint, "torque_ripple", 5e-5, _ripple, ("friction", "drivetrain", "actuator")),
            _outside(joint, "dahl", 6e-5, None, ("friction", "drivetrain")),
        ]
        if joint != "joint1":  # whose link is too light to spare a rotor
            found.append(
                Hidden(
                    "gear_compliance",
                    ("drivetrain",),
                    joint,
                    "compliance",
                    "rad/(N m)",
                    plain(lambda x, j=joint: _gear(j, x)),
                    5e-8,
                    cap=1e-3,
                )
            )
    if n.wheel_inertia is not None:
        for wheel in WHEELS:
            found += [
                _friction(wheel, "viscous", "N m s/rad", 1e-5, viscous, cap=0.01),
                _friction(wheel, "coulomb", "N m", 1e-4, coulomb, cap=0.05),
                Hidden(
                    "wheel_imbalance",
                    ("actuator", "inertia"),
                    wheel,
                    "static",
                    "kg m",
                    plain(lambda x, w=wheel: Change(numbers=lambda n: _imbalance(n, w, x))),
                    1e-3,
                    cap=_reach(n, wheel),
                ),
            ]
    return found


def _reach(n: Numbers, wheel: str) -> float:
    """Largest imbalance [kg m] that a wheel, a thin disc, can have and still be a body; a fifth kept back."""
    assert n.wheel_inertia is not None
    return 0.8 * (0.5 * n.wheel_inertia[WHEELS.index(wheel)] * WHEEL_MASS) ** 0.5


def _sign(v: float, rough: float = ROUGH) -> float:
    return v / (v * v + rough * rough) ** 0.5


def viscous(plant: Plant, iq: int, iv: int, size: float) -> float:
    """Torque per rate."""
    return -size * plant.qvel[iv]


def coulomb(plant: Plant, iq: int, iv: int, size: float) -> float:
    """Torque against the motion, whatever the rate."""
    return -size * _sign(plant.qvel[iv])


def stribeck(plant: Plant, iq: int, iv: int, size: float) -> float:
    """Coulomb friction of the same size, and as much again at low rates: the curve of Hess and Soom, ASME J.
    Tribology 112 (1990) 147.
    """
    v = plant.qvel[iv]
    return -size * _sign(v) * (1.0 + 1.0 / (1.0 + (v / 0.05) ** 2))


def load(plant: Plant, iq: int, iv: int, size: float) -> float:
    """Torque against the motion in proportion to the motor's."""
    torque = plant.ctrl[plant.ctrl_of[iv]]
    return -size * (torque * torque + 0.04) ** 0.5 * _sign(plant.qvel[iv])


def position(plant: Plant, iq: int, iv: int, size: float) -> float:
    """Coulomb friction that varies with the angle."""
    return -size * np.cos(plant.qpos[iq]) * _sign(plant.qvel[iv])


def quarter_on(plant: Plant, iq: int, iv: int, size: float) -> float:
    """The same, a quarter of a turn on."""
    return -size * np.sin(plant.qpos[iq]) * _sign(plant.qvel[iv])


def _ripple(plant: Plant, iq: int, iv: int, size: float) -> float:
    q = plant.qpos[iq]
    return size * (np.sin(8 * q + 0.7) + 0.5 * np.sin(12 * q + 2.0))


def _force(joint: str, law: Callable[[Plant, int, int, float], float], size: float, onset: float | None):
    def make(plant: Plant) -> Force:
        iq, iv, out, data = plant.q_of(joint), plant.v_of(joint), plant.passive, plant.data

        def force() -> None:
            if onset is None or data.time >= onset:
                out[iv] += law(plant, iq, iv, size)

        return force

    return Change(force=make, step=ROUGH_STEP) if size else Change()


def _friction(
    joint: str,
    parameter: str,
    unit: str,
    guess: float,
    law: Callable,
    *,
    cap: float,
    signed: bool = False,
    beside: tuple[Callable, ...] = (),
) -> Hidden:
    return Hidden(
        "joint_friction",
        ("friction",),
        joint,
        parameter,
        unit,
        lambda x, onset, rng: _force(joint, law, x, onset),
        guess,
        cap=cap,
        signed=signed,
        onset=True,
        shapes=SHAPES[parameter],
        beside=tuple(lambda x, onset, rng, law=law: _force(joint, law, x, onset) for law in beside),
    )


def _outside(joint: str, name: str, guess: float, law: Callable | None, family: tuple[str, ...]) -> Hidden:
    def make(x: float, onset: float | None, rng: np.random.Generator) -> Change:
        return _force(joint, law, x, onset) if law else _dahl(joint, x, onset)

    return Hidden(None, family, joint, "size", "N m", make, guess, cap=20.0, onset=True, label=name)


def _dahl(joint: str, size: float, onset: float | None) -> Change:
    """Dahl's friction: a spring of 0.02 rad that slips at `size`."""
    if not size:
        return Change()

    def make(plant: Plant) -> Callable[[float], None]:
        iv, z = plant.v_of(joint), 0.0
        stiffness = size / 0.02

        def hook(step: float) -> None:
            nonlocal z
            v = plant.qvel[iv]
            if after(onset, plant.time):
                # exact for a rate held over the step
                slip = np.exp(-stiffness * abs(v) * step / size)
                z = np.sign(v) * size + (z - np.sign(v) * size) * slip if v else z
            plant.data.qfrc_applied[iv] = -z

        return hook

    return Change(hook=make, step=ROUGH_STEP)


def _armature(n: Numbers, joint: str, inertia: float) -> Numbers:
    values = list(n.armature)
    values[JOINTS.index(joint)] += inertia
    return replace(n, armature=tuple(values))


def _gear(joint: str, compliance: float) -> Change:
    """A spring between motor and link. One too stiff to ring within a step follows the torque at once."""
    if not compliance:
        return Change()
    period = (compliance * ROTOR) ** 0.5
    if period < STIFF:
        return _ahead(joint, lambda torque: compliance * torque)
    drive = Drivetrain(compliance, ROTOR)
    return Change(
        numbers=lambda n: replace(n, drivetrain={**n.drivetrain, joint: drive}),
        step=min(2.5e-3, 0.8 * period),
    )


def _backlash(joint: str, gap: float) -> Change:
    """Play between encoder and link: the encoder is ahead by half the gap, on the side the motor pushes.

    The rotor crosses the gap within a millisecond or two, so that only its place counts.
    """
    if not gap:
        return Change()
    return _ahead(joint, lambda torque: 0.5 * gap * np.tanh(2.0 * torque))


def _ahead(joint: str, angle: Callable[[np.ndarray], np.ndarray]) -> Change:
    """The encoder is ahead of the link by an angle that depends on the torque held until the sample.

    What was commanded before the first sample nobody knows: it is taken to be what is commanded from there.
    """
    torque = np.zeros(0)

    def note(t: np.ndarray, values: np.ndarray, columns: tuple[str, ...]) -> np.ndarray:
        nonlocal torque
        own = values[:, columns.index(joint)]
        torque = np.append(own[0], own[:-1])
        return values

    def shifted(t: np.ndarray, x: np.ndarray) -> np.ndarray:
        x = x.copy()
        x[:, JOINTS.index(joint)] += angle(torque)
        return x

    return Change(command=note, ideal=(("encoder.joint_position", shifted),))


def _imbalance(n: Numbers, wheel: str, size: float) -> Numbers:
    values = list(n.wheel_static)
    values[WHEELS.index(wheel)] += size
    return replace(n, wheel_static=tuple(values))
