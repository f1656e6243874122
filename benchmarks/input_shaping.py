"""Trapezoid, minimum jerk and shaped trapezoids on the complete nonlinear spacecraft: what keeps vibrating.

    python benchmarks/input_shaping.py

Same joints' travel, same time (60 s; 120 s where slosh is shaped too, whose half period is 34 s), PD with the
gains of case D and a controller that knows the inertias, exact measurements. The shaped ones are trapezoids
that are over earlier by the shaper's length, convolved with it. Their frequencies are those of the loop's
named poles (panel and slosh swing with the base held by the controller); once more with these frequencies
10 % off. What is left at the panel's and at the slosh's frequency is told apart by least squares.
"""

from __future__ import annotations

import os

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402
from _common import ROOT, environment, write_result  # noqa: E402

from smsid.control._robust import flexible_plant, named_poles  # noqa: E402
from smsid.control.closed_loop import track  # noqa: E402
from smsid.control.gains import gains  # noqa: E402
from smsid.control.identified_model import inertia_at  # noqa: E402
from smsid.control.pd import ModelBasedController  # noqa: E402
from smsid.control.reduced import ReducedDynamics  # noqa: E402
from smsid.control.trajectory import (  # noqa: E402
    Motion,
    Reference,
    ShapedMotion,
    check_joints,
    minimum_jerk,
    shaper,
    trapezoid,
)
from smsid.description import load_description  # noqa: E402
from smsid.model import build_model  # noqa: E402

TRAVEL = 0.8  # [rad], the paper's: 0.001 rad/s^2 for 20 s, 20 s coasting, 20 s braking
TIMES = (60.0, 120.0)  # [s]
AFTER = 120.0  # [s] in which the residual vibration is looked for
RATE = 20.0


def motions(
    start: np.ndarray, over: float, panel: tuple[float, float], tank: tuple[float, float]
) -> dict[str, Motion]:
    """Motions by name; ``panel`` and ``tank`` are (frequency [Hz], damping ratio)."""
    found: dict[str, Motion] = {
        "trapezoid": _trapezoid(start, over),
        "minimum jerk": minimum_jerk(start, start + TRAVEL, over),
    }
    shapers = [("zv", [panel]), ("zvd", [panel]), ("ei", [panel])]
    if over > TIMES[0]:
        shapers = [("zv", [panel]), ("zv", [tank]), ("zv", [panel, tank])]
    for off in (1.0, 1.1):
        for kind, modes in shapers:
            made = shaper(kind, [off * f for f, _ in modes], [z for _, z in modes])  # type: ignore[arg-type]
            what = " and ".join("panel" if m is panel else "slosh" for m in modes)
            label = f"{kind.upper()} for {what}" + (", frequencies 10 % off" if off != 1.0 else "")
            found[label] = ShapedMotion(_trapezoid(start, over - float(made.times[-1])), made)
    return found


def left(time: np.ndarray, signal: np.ndarray, poles: list[complex], wanted: complex) -> float:
    """Return the amplitude of the wanted pole's swinging at the first time, fitted beside the other poles."""
    t = time - time[0]
    columns = [np.ones_like(t)]
    for p in poles:
        decay = np.exp(p.real * t)
        columns += [decay * np.cos(p.imag * t), decay * np.sin(p.imag * t)]
    fitted = np.linalg.lstsq(np.column_stack(columns), signal, rcond=None)[0]
    k = 1 + 2 * poles.index(wanted)
    return float(np.hypot(fitted[k], fitted[k + 1]).max())


def _trapezoid(start: np.ndarray, duration: float) -> Motion:
    third = duration / 3.0
    return trapezoid(start, TRAVEL / (2.0 * third**2), (third, third, third, 0.0))


def main() -> None:
    model = build_model(load_description(ROOT / "urdf" / "paper_sms.toml"))
    dynamics, k = ReducedDynamics(model), gains(6, 4.0, 4.0)
    home = model.joint_angles(model.home)
    poles = named_poles(flexible_plant(model, home), inertia_at(dynamics, home), k)
    panel = next(p for p in poles if p.name == "panel.mode1")
    tank = next(p for p in poles if p.name.startswith("tank"))
    start = model.joint_angles(model.home) - 0.5 * TRAVEL
    swinging = [panel.value, tank.value]
    rows: dict[str, dict] = {}
    for over in TIMES:
        modes = ((abs(p.value) / (2.0 * np.pi), p.damping) for p in (panel, tank))
        for label, motion in motions(start, over, *modes).items():
            name = f"{over:.0f} s, {label}"
            check_joints(motion, model)
            law = ModelBasedController(dynamics, k, Reference(motion))
            run = track(model, law, duration=over + AFTER, rate=RATE)
            rest = run.time > over + 5.0  # faster modes are gone
            bending, slosh = run.q[rest][:, model.modes.q[0]], run.q[rest][:, model.slosh[0].q]
            rows[name] = {
                "panel_left_mm": 1e3 * left(run.time[rest], bending[:, None], swinging, panel.value),
                "slosh_left_mm": 1e3 * left(run.time[rest], slosh, swinging, tank.value),
                "e_b_left_rad": float(np.abs(run.error[rest, :3]).max()),
                "e_b_rad": run.base,
                "e_i_rad": run.joints,
                "largest_wheel_torque_Nm": float(np.abs(run.wheel_torque).max()),
                "saturated": run.saturated,
            }
            print(
                name,
                {k: f"{v:.3g}" if isinstance(v, float) else v for k, v in rows[name].items()},
                flush=True,
            )
    result = {
        "environment": environment("pin", "numpy"),
        "modes": {
            p.name: {"frequency_Hz": abs(p.value) / (2.0 * np.pi), "damping": p.damping}
            for p in (panel, tank)
        },
        "rows": rows,
        "left_relative_to_the_trapezoid": {
            name: {
                key: row[key] / rows[f"{name.split(',')[0]}, trapezoid"][key]
                for key in ("panel_left_mm", "slosh_left_mm", "e_b_left_rad")
            }
            for name, row in rows.items()
        },
    }
    print(write_result("input_shaping", result))


if __name__ == "__main__":
    main()
