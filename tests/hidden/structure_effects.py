"""Hidden effects of fuel and panel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from . import bodies
from .effect import Hidden, plain
from .numbers import Mode, Numbers, Tank
from .plant import Change, Force, Plant

SECOND_TANK = (-0.4, 0.3, 0.2)


def structure_effects(n: Numbers) -> list[Hidden]:
    """Everything that may be hidden in the fuel and the panel of a world."""
    found = [effect for tank in n.tanks for effect in _slosh(tank)]
    return found + (_panel(n) if n.plate is not None else [])


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
                if min(values) <= 0.0:
                    raise ValueError(f"{field} of {tank.name} must be positive")
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
            shapes=("cubic spring", "cubic spring per axis"),
        ),
        Hidden(
            "slosh_nonlinearity", ("slosh",), tank.name, "quadratic_damping", "N s^2/m^2",
            plain(lambda x: _spring(tank.name, 0.0, x)), 5.0, cap=1e3,
            shapes=("quadratic damping", "quadratic damping per axis"),
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
    assert n.plate is not None

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

    def higher(x: float) -> Change:
        """The plate's next mode, 2 % slower than the plate's; x is its modal mass over the plate's."""

        def change(m: Numbers) -> Numbers:
            assert m.plate is not None
            plate, root = replace(m.plate, modes=m.plate.modes + 1), m.plate_root
            along, about = float(plate.translation[-1]), float(plate.rotation[-1])
            at = (root[0] + about / along, root[1], root[2])
            seen = np.sqrt(x) * plate.shape(np.array(m.stations))[:, -1]
            more = Mode(
                at, x * along**2, 0.98 * float(plate.omega[-1]), plate.damping_ratio, seen=tuple(seen)
            )
            less = -bodies.point(more.mass, np.array(at))  # was counted as rigid
            return replace(m.with_body("bus", less), modes=(*m.plate_modes(), more))

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
            "beam_mode",
            family,
            "panel",
            "factor",
            "1",
            plain(higher),
            0.1,
            cap=1.0,
            shapes=(f"mode {n.plate.modes + 1}",),
        ),
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
                shapes=(f"frequency of mode {k + 1}", "stiffness"), others=("mode_error",),
            ),
            Hidden(
                kind, family, "panel", f"mode{k + 1}.damping", "1",
                plain(lambda x, k=k: mode(k, damping=x)), 0.5, cap=20.0,
                shapes=(f"damping of mode {k + 1}", "damping"), others=("mode_error",),
            ),
        ]  # fmt: skip
    return found
