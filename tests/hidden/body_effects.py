"""Hidden effects of bodies and of the space around them: errors, payload, leaks, forces, tides."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from . import bodies
from .effect import Hidden, after, plain
from .numbers import LINKS, TIPS, Numbers
from .plant import Change, Force, Plant

Array = np.ndarray
LEAK = (0.5, -0.6, 0.4)  # where mass is lost, bus frame [m]


def body_effects(n: Numbers) -> list[Hidden]:
    """Everything that may be hidden in the bodies of a world, and around them."""
    return [*_bodies(n), *(_outer(n) if n.free else [])]


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
            cap = bodies.reach(theta, moment, size * mass)
            found.append(_body(link, f"first_moment.{axis}", "kg m", 0.01 * mass, moment, cap))
        for axis, k in (("xx", 4), ("yy", 6), ("zz", 9)):
            about = float(np.diag(inertia)["xyz".index(axis[0])])
            cap = bodies.reach(theta, np.eye(10)[k], 0.1 * about)
            found.append(_body(link, f"inertia.{axis}", "kg m^2", 0.02 * theta[k], np.eye(10)[k], cap))
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
            cap=0.02, power=2.0, also=("spacecraft",),
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
                    beside=tuple(
                        lambda x, onset, rng, w=what, f=frame, d=axis: _wrench(w, f, x * d, onset)
                        for axis in np.eye(3)
                    ),
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
    """Tidal acceleration on every body about the centre of the whole; the nadir turns in the orbit's plane.

    It varies slowly and is held for 20 ms.
    """

    def make(plant: Plant) -> Callable[[float], None]:
        m, d = plant.model, plant.data
        mass = m.body_mass[1:, None]
        jacobian, turning = np.zeros((2, 3, m.nv))
        down = np.array([np.cos(0.8), np.sin(0.8), 0.3]) / np.sqrt(1.09)
        ahead = np.array([np.sin(0.8), -np.cos(0.8), 0.0])
        held = 0.0

        def hook(step: float) -> None:
            nonlocal held
            held -= step
            if held > 0.0:
                return
            held = 0.02 - 1e-9
            nadir = np.cos(rate * d.time) * down + np.sin(rate * d.time) * ahead
            place = d.xipos[1:]
            lever = place - (mass * place).sum(axis=0) / mass.sum()
            pull = rate**2 * mass * (3 * np.outer(lever @ nadir, nadir) - lever)
            d.qfrc_applied[:] = 0.0
            for b, f in enumerate(pull, start=1):
                mujoco.mj_jacBodyCom(m, d, jacobian, turning, b)
                axes = d.ximat[b].reshape(3, 3)
                inertia = axes @ np.diag(m.body_inertia[b]) @ axes.T
                turn = 3 * rate**2 * np.cross(nadir, inertia @ nadir)
                d.qfrc_applied += jacobian.T @ f + turning.T @ turn

        return hook

    return Change(hook=make) if rate else Change()
