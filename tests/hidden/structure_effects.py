"""Hidden effects of bodies, fuel and panel, and of the space around them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np

from . import bodies
from .effect import Hidden, after, plain
from .numbers import LINKS, TIPS, Mode, Numbers, Tank
from .plant import Change, Force, Plant

Array = np.ndarray
SECOND_TANK = (-0.4, 0.3, 0.2)
LEAK = (0.5, -0.6, 0.4)  # where mass is lost, bus frame [m]


def structure_effects(n: Numbers) -> list[Hidden]:
    """Everything that may be hidden in the structure of a world."""
    found = [*_bodies(n)]
    if n.free:
        found += _outer(n)
    for tank in n.tanks:
        found += _slosh(tank)
    if n.plate is not None:
        found += _panel(n)
    return found


def _body(body: str, parameter: str, unit: str, guess: float, change: Array, cap: float) -> Hidden:
    def make(x: float) -> Change:
        return Change(numbers=lambda n: n.with_body(body, x * change)) if x else Change()

    shape = {"mass": "mass", "first_moment": "centre of mass", "inertia": "inertia"}[parameter.split(".")[0]]
    return Hidden(
        "body_error",
        ("inertia",),
        body,
        parameter,
        unit,
        plain(make),
        guess,
        cap,
        signed=True,
        shapes=(shape,),
    )


def _bodies(n: Numbers) -> list[Hidden]:
    at = np.add(TIPS["link3"], (0.05, 0.08, -0.06))
    found = [
        Hidden(
            "payload",
            ("inertia",),
            "tool",
            "mass",
            "kg",
            plain(
                lambda x: (
                    Change(numbers=lambda m: m.with_body("link3", bodies.point(x, at))) if x else Change()
                )
            ),
            0.5,
            cap=40.0,
            also=("link3", "joint3"),
        )
    ]
    for link in LINKS if not n.free else ("bus", *LINKS):
        theta = n.body[link]
        mass, _, inertia = bodies.split(theta)
        found.append(_body(link, "mass", "kg", 0.02 * mass, theta / mass, cap=0.3 * mass))
        size = 0.3 * float(np.sqrt(np.trace(inertia) / (2 * mass)))
        for axis, unit in zip("xyz", np.eye(3), strict=True):
            moment = np.concatenate([[0], unit, np.zeros(6)])
            found.append(_body(link, f"first_moment.{axis}", "kg m", 0.01 * mass, moment, cap=size * mass))
        for axis, k in (("xx", 4), ("yy", 6), ("zz", 9)):
            about = float(np.diag(inertia)["xyz".index(axis[0])])
            found.append(
                _body(link, f"inertia.{axis}", "kg m^2", 0.02 * theta[k], np.eye(10)[k], cap=0.1 * about)
            )
    return found


def _outer(n: Numbers) -> list[Hidden]:
    def leak(x: float, onset: float | None, rng: np.random.Generator) -> Change:
        begin = onset or 0.0
        if not x:
            return Change()
        return Change(mass=lambda t: {"bus": -bodies.point(x * max(t - begin, 0.0), np.array(LEAK))})

    found = [
        Hidden(
            "mass_loss", ("inertia",), "bus", "rate", "kg/s", leak, 0.05, cap=4.0, onset=True,
        ),
        Hidden(
            "gravity_gradient", ("external",), "bus", "rate", "rad/s", plain(_gradient), 1e-3,
            cap=0.02, power=2.0,
        ),
    ]  # fmt: skip
    directions = (np.array([0.6, -0.5, 0.62]), np.array([-0.4, 0.7, 0.59]))
    for what, unit, guess, direction in (
        ("force", "N", 0.02, directions[0]),
        ("torque", "N m", 0.02, directions[1]),
    ):
        for frame in ("body", "inertial"):
            found.append(
                Hidden(
                    "external_wrench",
                    ("external",),
                    f"bus_{frame}",
                    what,
                    unit,
                    lambda x, onset, rng, w=what, f=frame, d=direction: _wrench(w, f, x * d, onset),
                    guess,
                    cap=5.0,
                    onset=True,
                    shapes=(f"{what}, {frame}",),
                    also=("bus",),
                )
            )
    return found


def _wrench(what: str, frame: str, size: Array, onset: float | None) -> Change:
    def make(plant: Plant) -> Force:
        out, data = plant.passive, plant.data
        columns = slice(0, 3) if what == "force" else slice(3, 6)
        turned = (what == "force") != (frame == "inertial")  # MuJoCo: force in inertial, torque in body axes

        def force() -> None:
            if after(onset, data.time):
                r = data.xmat[1].reshape(3, 3) if turned else np.eye(3)
                out[columns] += (r if what == "force" else r.T) @ size

        return force

    return Change(force=make) if size.any() else Change()


def _gradient(rate: float) -> Change:
    """Tidal acceleration on every body about the centre of the whole; the nadir turns about z.

    It varies slowly and is held for 20 ms.
    """

    def make(plant: Plant) -> Callable[[float], None]:
        m, d = plant.model, plant.data
        mass = m.body_mass[1:, None]
        jacobian = np.zeros((3, m.nv))
        held = 0.0

        def hook(step: float) -> None:
            nonlocal held
            held -= step
            if held > 0.0:
                return
            held = 0.02 - 1e-9
            angle = 0.8 - rate * d.time
            nadir = np.array([np.cos(angle), np.sin(angle), 0.3]) / np.sqrt(1.09)
            place = d.xipos[1:]
            lever = place - (mass * place).sum(axis=0) / mass.sum()
            pull = rate**2 * mass * (3 * np.outer(lever @ nadir, nadir) - lever)
            d.qfrc_applied[:] = 0.0
            for b, f in enumerate(pull, start=1):
                mujoco.mj_jacBodyCom(m, d, jacobian, None, b)
                d.qfrc_applied += jacobian.T @ f
            # the bus is long enough for its own inertia to count; other bodies are near points
            axes = d.ximat[1].reshape(3, 3)
            inertia = axes @ np.diag(m.body_inertia[1]) @ axes.T
            turn = 3 * rate**2 * np.cross(nadir, inertia @ nadir)
            d.qfrc_applied[3:6] += d.xmat[1].reshape(3, 3).T @ turn

        return hook

    return Change(hook=make) if rate else Change()


def _slosh(tank: Tank) -> list[Hidden]:
    def second(x: float) -> Change:
        if not x:
            return Change()
        more = Tank("tank2", SECOND_TANK, x, (0.35 * x, 0.3 * x, 0.4 * x), (0.03 * x, 0.03 * x, 0.03 * x))
        less = -bodies.point(x, np.array(SECOND_TANK))  # was counted as part of the bus
        return Change(numbers=lambda n: n.with_body("bus", less).with_tank(more))

    def scaled(field: str) -> Callable[[float], Change]:
        def make(x: float) -> Change:
            def change(n: Numbers) -> Numbers:
                own = n.tank(tank.name)
                values = tuple(
                    v + x * w for v, w in zip(getattr(own, field), getattr(tank, field), strict=True)
                )
                return n.with_tank(replace(own, **{field: values}))

            return Change(numbers=change) if x else Change()

        return make

    def wrong(parameter: str, guess: float, cap: float) -> Hidden:
        return Hidden(
            "slosh",
            ("slosh",),
            tank.name,
            parameter,
            "1",
            plain(scaled(parameter)),
            guess,
            cap=cap,
            signed=True,
            shapes=({"stiffness": "frequency", "damping": "damping"}[parameter],),
            label=f"wrong {parameter}",
        )

    return [
        Hidden(
            "slosh", ("slosh",), "tank2", "mass", "kg", plain(second), 2.0, cap=100.0, label="second",
            also=("tank", "bus"),
        ),
        wrong("stiffness", 0.05, 0.6),
        wrong("damping", 0.3, 0.9),
        Hidden(
            "slosh_nonlinearity", ("slosh",), tank.name, "cubic", "N/m^3",
            plain(lambda x: _spring(tank.name, x, 0.0)), 10.0, cap=1e4,
            shapes=("cubic spring",),
        ),
        Hidden(
            "slosh_nonlinearity", ("slosh",), tank.name, "quadratic_damping", "N s^2/m^2",
            plain(lambda x: _spring(tank.name, 0.0, x)), 5.0, cap=1e3,
            shapes=("quadratic damping",),
        ),
    ]  # fmt: skip


def _spring(tank: str, cubic: float, quadratic: float) -> Change:
    """Each axis for itself: -cubic x^3 - quadratic |v| v."""

    def make(plant: Plant) -> Force:
        iq, iv = plant.q_of(f"{tank}.x"), plant.v_of(f"{tank}.x")

        def force() -> None:
            x, v = plant.qpos[iq : iq + 3], plant.qvel[iv : iv + 3]
            plant.passive[iv : iv + 3] -= cubic * x**3 + quadratic * np.abs(v) * v

        return force

    return Change(force=make) if cubic or quadratic else Change()


def _panel(n: Numbers) -> list[Hidden]:
    def mode(k: int, **factors: float) -> Change:
        def change(m: Numbers) -> Numbers:
            modes = list(m.plate_modes())
            old = modes[k]
            modes[k] = replace(old, **{key: getattr(old, key) * (1 + x) for key, x in factors.items()})
            return replace(m, modes=tuple(modes))

        return Change(numbers=change) if any(factors.values()) else Change()

    def another(x: float) -> Change:
        at = (n.plate_root[0] + 3.5, 0.6, 0.0)
        more = Mode(at, x, 2 * np.pi * 0.5, 0.01)

        def change(m: Numbers) -> Numbers:
            modes = m.plate_modes()
            return replace(m.with_body("bus", -bodies.point(x, np.array(at))), modes=(*modes, more))

        return Change(numbers=change) if x else Change()

    def drift(x: float, onset: float | None, rng: np.random.Generator) -> Change:
        def make(plant: Plant) -> Force:
            iq, iv = plant.q_of("mode1"), plant.v_of("mode1")
            first = plant.numbers.plate_modes()[0]
            k = first.mass * first.omega**2

            def force() -> None:
                elapsed = plant.time - (onset or 0.0)
                if elapsed > 0.0:
                    plant.passive[iv] -= k * ((1 + x * elapsed) ** 2 - 1) * plant.qpos[iq]

            return force

        return Change(force=make) if x else Change()

    def bend(x: float) -> Change:
        return Change(numbers=lambda m: replace(m, bend=x)) if x else Change()

    kind, family = "beam_appendage", ("appendage",)
    found = [
        Hidden("geometric_stiffness", family, "panel", "factor", "1", plain(bend), 0.1, cap=3.0),
        Hidden("extra_mode", family, "panel", "mass", "kg", plain(another), 0.2, cap=15.0, also=("bus",)),
        Hidden(
            "frequency_drift",
            family,
            "panel",
            "rate",
            "1/s",
            drift,
            1e-4,
            cap=5e-3,
            signed=True,
            onset=True,
            shapes=("drift of mode 1",),
        ),
    ]
    for k, (cap_f, guess) in enumerate(((0.3, 0.005), (0.3, 0.02))):
        found += [
            Hidden(
                kind, family, "panel", f"mode{k + 1}.frequency", "1",
                plain(lambda x, k=k: mode(k, omega=x)), guess, cap=cap_f, signed=True,
                shapes=(f"frequency of mode {k + 1}", "stiffness"),
            ),
            Hidden(
                kind, family, "panel", f"mode{k + 1}.damping", "1",
                plain(lambda x, k=k: mode(k, damping=x)), 0.5, cap=20.0,
                shapes=(f"damping of mode {k + 1}", "damping"),
            ),
        ]  # fmt: skip
    return found
